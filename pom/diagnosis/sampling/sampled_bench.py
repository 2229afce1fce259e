"""Judgement of a model against a flight, and against flights that draws of the aeroplane give."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import xarray as xr

from flightmech.names import WRAPPED
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import PARAMETER
from pom.cases.case import PomCase
from pom.cases.job import ReplayJob
from pom.diagnosis.sampling.draws import INERTIA, InstrumentErrors
from pom.judging.signals import Comparison, find_event, signals_of_run
from pom.judging.verdict import band_widths, judge_all
from pom.replaying.kernel_replay import fly_once
from pom.replaying.replay_case import ReplayPlan
from pom.replaying.replay_channels import sampled_channels, shown_channels, unwrapped_near
from pom.replaying.trim import OBSERVED, beyond_limits, trim_limits
from pom.samples import QUANTILES
from pom.status import group_verdicts, judged_groups, status_of
from pom.tolerances.bands import Invalid, Judgement, NotJudged, unwrapped_difference
from pom.tolerances.channels import output_of

Traces = dict[str, np.ndarray]


@dataclass
class SampledRun:
    """Judged run of one model.

    Attributes
    ----------
    outputs, difference : dict of str to array (time,)
        Outputs with a tolerance band, and differences of the model from the record. [SI]
    outcomes : mapping of str to Judgement
        By criterion.
    status : str
        One of `pom.result.STATUSES`.
    groups : mapping of str to str
        Group of every judged criterion.
    trim : dict of str to float
        Trim quantities over their limits; for a draw, their differences over the limits. [1]
    failure : str
        Why the run has no judgement; empty for a judged run.
    decides : float
        Worst ratio over the groups, of each group the best alternative; NaN if none is judged. [1]
    """

    outputs: Traces
    difference: Traces
    outcomes: Mapping[str, Judgement]
    status: str
    groups: Mapping[str, str]
    trim: dict[str, float] = field(default_factory=dict)
    failure: str = ""
    decides: float = field(init=False)

    def __post_init__(self) -> None:
        # The best alternative judges a group, and the worst group decides.
        best: dict[str, float] = {}
        for name, group in self.groups.items():
            ratio = self.ratio(name)
            if math.isfinite(ratio):
                best[group] = min(best.get(group, math.inf), ratio)
        self.decides = max(best.values(), default=math.nan)

    def ratio(self, criterion: str) -> float:
        """Return the ratio of a criterion; NaN if it is not judged."""
        outcome = self.outcomes.get(criterion)
        if outcome is None or outcome.verdict not in ("pass", "fail"):
            return math.nan
        return outcome.worst_ratio

    def number(self, criterion: str) -> float:
        """Return the ratio of a criterion; also NaN if it fails for another reason."""
        outcome = self.outcomes.get(criterion)
        if outcome is not None and outcome.fails_without_ratio:
            return math.nan
        return self.ratio(criterion)

    @property
    def deciding_number(self) -> float:
        """`decides`; also NaN for a run that fails for another reason than its ratios."""
        if self.status == "fail" and not self.decides > 1.0:
            return math.nan
        return self.decides

    def signed(self, criterion: str) -> float:
        """Return the ratio with the sign of model minus flight."""
        ratio = self.ratio(criterion)
        if not math.isfinite(ratio):
            return ratio
        return math.copysign(ratio, self.outcomes[criterion].worst)


class SampledBench:
    """A case with its flight, on which models of the same aircraft and terms are judged.

    Attributes
    ----------
    plan : Plan
    model : SimModel
        The model without a draw.
    channels : list of str
        Outputs that are recorded of a run.
    flight : dict of str to array (time,)
        The flight. [SI]
    instruments : InstrumentErrors
    tolerance : Dataset (time)
        Half widths of the tolerance bands. [SI]
    groups : dict of str to str
        Group of every judged criterion.
    traced : dict of str to str
        Channel of every criterion that judges a time history.
    """

    def __init__(
        self,
        plan: ReplayPlan,
        model: SimModel,
        channels: list[str],
        flight: Traces,
        instruments: InstrumentErrors,
    ):
        self.plan = plan
        self.model = model
        self.channels = channels
        self.flight = flight
        self.instruments = instruments
        self.limits = trim_limits(plan.case, flight)
        # Sizes of the trim quantities that a tuning limits: the smaller of both limits, unless the
        # case file allows a trim beyond the usual one.
        self.trim_sizes = {}
        for name, limit in self.limits.items():
            size = limit.size
            if not limit.allowed:
                size = min(limit.size, limit.usual)
            if math.isfinite(size):
                self.trim_sizes[name] = size
        self.tolerance = band_widths(plan.case, plan.job.time, flight)
        judged = [c for c in plan.case.criteria if c.applies and c.measure != "setup"]
        self.groups = {criterion.name: criterion.group for criterion in judged}
        self.traced = {}
        for criterion in judged:
            if criterion.measure == "trace" and criterion.channel in self.tolerance:
                self.traced[criterion.name] = criterion.channel

    @classmethod
    def of(cls, plan: ReplayPlan, model: SimModel, instruments: InstrumentErrors) -> SampledBench:
        """Return the bench of a case."""
        flight = sampled_channels(plan.states)
        outputs = set(OBSERVED)
        for channel in shown_channels(plan.case, plan.states):
            outputs.add(output_of(channel, model.outputs))
        channels = sorted(outputs.intersection(model.outputs))
        return cls(plan, model, channels, flight=flight, instruments=instruments)

    @cached_property
    def own(self) -> tuple[Traces, str]:
        """Outputs of the model without a draw, and why its run failed."""
        return self.flown(self.model, self.plan.job)

    def flown(self, model: SimModel, job: ReplayJob) -> tuple[Traces, str]:
        """Return the outputs of a model, and why its run failed."""
        outputs, failure = fly_once(model, job, self.channels)
        return _with_applied_controls(outputs, job), failure

    def run(self, model: SimModel, draw: np.ndarray) -> SampledRun:
        """Judge a model against the flight, with one draw (error,) of the errors of its input."""
        outputs, failure = self.flown(model, self.instruments.job(self.plan.job, draw))
        trim = {name: values for name, values in outputs.items() if name.startswith("trim.")}
        return self._judge_run(
            self.plan.case, self.flight, outputs, outputs=outputs, trim=trim, failure=failure
        )

    def matched(self, model: SimModel, draw: np.ndarray, random: np.random.Generator) -> SampledRun:
        """Judge the model without a draw against the record of a drawn aeroplane.

        Parameters
        ----------
        model : SimModel
            The drawn aeroplane.
        draw : array (error,)
            Drawn errors of the instruments.
        random : Generator
            Source of the noise of the record.
        """
        nominal, nominal_failure = self.own
        outputs, failure = self.flown(model, self.instruments.job(self.plan.job, draw))
        record = self.instruments.recorded(self._select_flight_channels(outputs), draw, random)
        # The trim of the drawn aeroplane is the reference of that of the model.
        trim = {}
        for name, values in outputs.items():
            if name.startswith("trim."):
                trim[name] = nominal[name] - values
        return self._judge_run(
            self._move_events(outputs),
            record,
            nominal,
            outputs=outputs,
            trim=trim,
            failure=nominal_failure or failure,
        )

    def _judge_run(
        self,
        case: PomCase,
        flight: Traces,
        model: Traces,
        *,
        outputs: Traces,
        trim: Traces,
        failure: str,
    ) -> SampledRun:
        """Judge a model against a flight; a failed run or a refused trim makes it invalid."""
        outcomes = judge_all(case, self.plan.job.time, flight, model)
        # A trim beyond a demanded limit refuses the run; beyond a usual one it is a remark.
        refusals = beyond_limits(self.limits, trim, demanded=True)
        refused = failure or "; ".join(remark.text for remark in refusals)
        usual = beyond_limits(self.limits, trim, demanded=False)
        exceeded = any(remark.kind == "trim" for remark in usual)
        verdicts = {}
        for criterion in case.criteria:
            verdicts[criterion.name] = outcomes[criterion.name].verdict
            if refused and criterion.applies:
                verdicts[criterion.name] = "invalid"
        if refused:
            invalid = {}
            for name, outcome in outcomes.items():
                invalid[name] = replace(outcome, verdict=verdicts[name])
            outcomes = invalid
        difference = {}
        for channel in self.traced.values():
            if channel in model and channel in flight:
                difference[channel] = unwrapped_difference(channel, flight[channel], model[channel])
        # Over their limits, so that a tuning can limit them like the ratios of criteria.
        trim_ratios = {}
        for name, size in self.trim_sizes.items():
            if f"trim.{name}" in trim:
                trim_ratios[name] = float(trim[f"trim.{name}"][0]) / size
        status = status_of(judged_groups(group_verdicts(case, verdicts)), exceeded)
        return SampledRun(
            outputs={name: outputs[name] for name in self.tolerance if name in outputs},
            difference=difference,
            outcomes=outcomes,
            status=status,
            groups=self.groups,
            trim=trim_ratios,
            failure=refused,
        )

    def _select_flight_channels(self, outputs: Traces) -> Traces:
        """Return the channels of the flight, from the outputs of the draw where it has them."""
        signals = signals_of_run(self.plan.case, outputs, self.plan.job.time)
        return {name: signals.get(name, values) for name, values in self.flight.items()}

    def _move_events(self, outputs: Traces) -> PomCase:
        """Return the case with its events, such as touchdown, at the times of the draw."""
        case, time = self.plan.case, self.plan.job.time
        events = dict(case.events)
        match = Comparison.of(case, time, self.flight, outputs)
        for event in events:
            # An event that the draw does not have keeps the time of the flight.
            with contextlib.suppress(NotJudged, Invalid):
                events[event] = find_event(match, event).model
        return replace(case, events=events)

    def deciding(self, run: SampledRun) -> list[str]:
        """Return the criterion of every group that is the best of its alternatives in a run."""
        best: dict[str, str] = {}
        for name, group in self.groups.items():
            ratio = run.ratio(name)
            if math.isfinite(ratio) and (group not in best or ratio < run.ratio(best[group])):
                best[group] = name
        return list(best.values())

    def decides(self, run: SampledRun) -> str:
        """Return the criterion whose ratio decides a run; empty if none is judged."""
        return max(self.deciding(run), key=run.ratio, default="")

    def signed(self, criterion: str, runs: list[SampledRun]) -> np.ndarray:
        """Return the signed ratio of a criterion over the draws (draw,).

        The ratio of a time history is taken at one instant for all draws: where its mean square
        over the draws is largest. The instant of the largest ratio changes between draws. That
        ratio is not linear in the errors, because it has no sign.
        """
        channel = self.traced.get(criterion, "")
        if not all(channel in run.difference for run in runs):
            return np.array([run.signed(criterion) for run in runs])
        half_width = self.tolerance[channel].values
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.stack([run.difference[channel] for run in runs]) / half_width
        # No band at a sample: the sample is not judged.
        ratio[:, ~np.isfinite(half_width)] = 0.0
        # The mean square needs at least one judged sample.
        square = np.zeros(ratio.shape[1])
        if np.isfinite(ratio).any():
            square = np.nanmean(np.square(ratio), axis=0)
        return ratio[:, int(np.argmax(square))]

    def fan(self, runs: list[SampledRun]) -> xr.Dataset:
        """Return the quantiles over the runs of all channels with a band (quantile, time)."""
        quantiles = {}
        for name in map(str, self.tolerance):
            traces = []
            for run in runs:
                # A failed run has no trace.
                if name not in run.outputs or not np.isfinite(run.outputs[name]).all():
                    continue
                trace = run.outputs[name]
                if name in WRAPPED:
                    trace = unwrapped_near(trace, self.flight[name])
                traces.append(trace)
            if traces:
                values = np.quantile(np.stack(traces), QUANTILES, axis=0)
                quantiles[name] = (("quantile", "time"), values)
        coords = {"quantile": list(QUANTILES), "time": self.plan.job.time}
        return xr.Dataset(quantiles, coords=coords)


def with_inertia(job: ReplayJob, model: SimModel) -> ReplayJob:
    """Return a job with explicit moments of inertia: its values, else those of the model."""
    inertia = {row.name: row.value for row in model.entries(PARAMETER) if row.name in INERTIA}
    return replace(job, parameters={**inertia, **job.parameters})


def _with_applied_controls(outputs: Traces, job: ReplayJob) -> Traces:
    """Return outputs; a control of the math pilot has its applied position."""
    applied = {}
    for loop in job.pilot:
        if f"applied.{loop.control}" in outputs:
            applied[loop.control] = outputs[f"applied.{loop.control}"]
    return {**outputs, **applied}
