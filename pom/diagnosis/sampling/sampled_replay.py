"""One case flown by the draws of one model.

Given the flights, the aeroplane is a draw of the posterior.  Each draw is flown in the place of the
aeroplane: with the inputs, start and mass that the record states less the errors of the
instruments, recorded with these errors, and the model is judged against it.
"""

from __future__ import annotations

import contextlib
import math
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from joblib import Parallel, delayed

from flightmech.aircraft.aircraft import Aircraft, read_aircraft
from flightmech.errors import SchemaError, UnknownName
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import PARAMETER
from pom.cases.case import PomCase
from pom.cases.job import ReplayJob
from pom.diagnosis.sampling.draws import INERTIA, DrawnModels, InstrumentErrors
from pom.diagnosis.sampling.shares import contribution_changes, regressors_of_draws, variance_shares
from pom.fmu.run_cache import FileState
from pom.fmu.simulate import Models
from pom.judging.signals import Comparison, find_event, signals_of_run
from pom.judging.verdict import band_widths, judge_all
from pom.replaying.batch import paths_of_cases, replay_all
from pom.replaying.caches import KeptStates
from pom.replaying.kernel_replay import fly_once
from pom.replaying.replay_case import ReplayPlan, plan_of, shown_channels, unwrapped_near
from pom.replaying.trim import OBSERVED, beyond_limits, solve_trim_surfaces, trim_limits
from pom.result import PomResult, group_verdicts, status_of
from pom.samples import QUANTILES, SampledReplay
from pom.tolerances.bands import Invalid, Judgement, NotJudged, unwrapped_difference
from pom.tolerances.channels import WRAPPED, output_of, source_signals

Traces = dict[str, np.ndarray]


def replay_draws(
    plan: ReplayPlan,
    models: DrawnModels,
    aircraft: Aircraft | None = None,
    errors: Mapping[str, float] | None = None,
    jobs: int = 1,
) -> SampledReplay:
    """Fly a case by every draw of the aeroplane and judge the model against each as `pom.replay`
    judges it against the flight.

    Parameters
    ----------
    plan : Plan
        Of `pom.replaying.plan_of`; its trim surfaces stay as they are.
    models : DrawnModels
    aircraft, errors
        Of `InstrumentErrors.of`.
    jobs : int
        Threads; -1 for one per core.  The samples do not depend on it.

    Raises
    ------
    SchemaError
        The case has a control law, whose FMU the kernel does not fly.
    """

    if plan.job.law is not None:
        raise SchemaError(
            "samples",
            [f"case {plan.case.name}: its control law is an FMU, which the kernel does not fly"],
        )
    plan = replace(plan, job=with_inertia(plan.job, models.model))
    compared = {
        source
        for channel in shown_channels(plan.case, plan.states)
        for source in (channel, *source_signals(channel))
    }
    bench = SampledBench.of(
        plan, models.model, InstrumentErrors.of(plan.job, plan.states, aircraft, errors, compared)
    )
    bench.own  # noqa: B018 - once, before the threads
    sizes = bench.instruments.draws(models.count, models.seed)
    with Parallel(n_jobs=jobs, backend="threading") as pool:
        noise = np.random.default_rng([models.seed, zlib.crc32(plan.case.name.encode())]).spawn(
            models.count
        )
        runs = list(
            pool(
                delayed(bench.matched)(*draw)
                for draw in zip(models.models, sizes, noise, strict=True)
            )
        )
    names = [
        criterion.name
        for criterion in plan.case.criteria
        if any(np.isfinite(run.signed(criterion.name)) for run in runs)
    ]
    changes = contribution_changes(
        models.database, models.nodes, plan.states, plan.case.drive.level != "recorded"
    )
    found = regressors_of_draws(changes, dict(zip(bench.instruments.names, sizes.T, strict=True)))
    return SampledReplay(
        seed=models.seed,
        database=models.source,
        status=tuple(run.status for run in runs),
        decides=np.array([run.decides for run in runs]),
        ratio=pd.DataFrame(
            {name: [run.ratio(name) for run in runs] for name in names}, dtype=float
        ),
        shares=variance_shares({name: bench.signed(name, runs) for name in names}, found),
        fan=bench.fan(runs),
    )


class SampledRun:
    """One model, flown and judged.

    Attributes
    ----------
    outputs, difference : dict of str to array (time,)
        Channels with a band of what was flown, and how far the model is from the record. [SI]
    outcomes : mapping of str to Outcome
        By criterion.
    status : str
        One of `pom.result.STATUSES`.
    decides : float
        Ratio that decides. [1]
    trim : dict of str to float
        Trim quantities, against a draw what they differ by, over their limits. [1]
    """

    def __init__(
        self,
        outputs: Traces,
        difference: Traces,
        outcomes: Mapping[str, Judgement],
        status: str,
        groups: Mapping[str, str],
    ):
        self.outputs, self.difference, self.outcomes, self.status = (
            outputs,
            difference,
            outcomes,
            status,
        )
        self.trim: dict[str, float] = {}
        self.failure = ""
        best: dict[str, float] = {}
        for name, group in groups.items():
            if math.isfinite(ratio := self.ratio(name)):
                best[group] = min(best.get(group, math.inf), ratio)
        self.decides = max(best.values(), default=math.nan)

    def ratio(self, criterion: str) -> float:
        """Return the ratio of a criterion; NaN where it is not judged."""
        outcome = self.outcomes.get(criterion)
        return (
            outcome.worst_ratio
            if outcome is not None and outcome.verdict in ("pass", "fail")
            else math.nan
        )

    def signed(self, criterion: str) -> float:
        """Return the ratio with the sign of model minus flight."""
        ratio = self.ratio(criterion)
        return (
            math.copysign(ratio, self.outcomes[criterion].worst) if math.isfinite(ratio) else ratio
        )


class SampledBench:
    """A case on which models are judged: against its flight, and against those that draws of the
    aeroplane would have given.
    """

    def __init__(
        self,
        plan: ReplayPlan,
        model: SimModel,
        channels: list[str],
        flight: Traces,
        instruments: InstrumentErrors,
    ):
        self.plan, self.model, self.channels, self.flight, self.instruments = (
            plan,
            model,
            channels,
            flight,
            instruments,
        )
        self.limits = trim_limits(plan.case, flight)
        sizes = {
            name: limit.size if limit.allowed else min(limit.size, limit.usual)
            for name, limit in self.limits.items()
        }
        self.trim_sizes = {name: size for name, size in sizes.items() if math.isfinite(size)}
        self.tolerance = band_widths(plan.case, plan.job.time, flight)
        judged = [c for c in plan.case.criteria if c.applies and c.measure != "setup"]
        self.groups = {criterion.name: criterion.group for criterion in judged}
        self.traced = {
            c.name: c.channel
            for c in judged
            if c.measure == "trace" and c.channel in self.tolerance
        }

    @classmethod
    def of(cls, plan: ReplayPlan, model: SimModel, instruments: InstrumentErrors) -> SampledBench:
        """Return the bench of a case; any model of the same aircraft and terms can be flown on it."""
        count = plan.job.time.size
        flight = {
            str(name): np.broadcast_to(item.values, count)
            for name, item in plan.states.items()
            if item.ndim < 2
        }
        wanted = {
            *(
                output_of(channel, model.outputs)
                for channel in shown_channels(plan.case, plan.states)
            ),
            *OBSERVED,
        }
        return cls(
            plan,
            model,
            sorted(name for name in wanted if name in model.outputs),
            flight,
            instruments,
        )

    @cached_property
    def own(self) -> tuple[Traces, str]:
        """Outputs of the model itself, and why it did not come to the end."""
        return self.flown(self.model, self.plan.job)

    def flown(self, model: SimModel, job: ReplayJob) -> tuple[Traces, str]:
        """Return the outputs of a model, and why it did not come to the end."""
        found, failure = fly_once(model, job, self.channels)
        return _as_applied(found, job), failure

    def run(self, model: SimModel, draw: np.ndarray) -> SampledRun:
        """Return a model, flown with the drive of one draw (error,) of the instruments and judged
        against the flight.
        """
        outputs, failure = self.flown(model, self.instruments.job(self.plan.job, draw))
        trim = {name: values for name, values in outputs.items() if name.startswith("trim.")}
        return self._judged(self.plan.case, self.flight, outputs, outputs, trim, failure)

    def matched(self, model: SimModel, draw: np.ndarray, random: np.random.Generator) -> SampledRun:
        """Return the model itself, judged against the record of a draw: an aeroplane `model` and
        errors (error,) of the instruments.
        """
        own, refused = self.own
        outputs, failure = self.flown(model, self.instruments.job(self.plan.job, draw))
        flight = self.instruments.recorded(self._as_flight(outputs), draw, random)
        trim = {
            name: own[name] - values for name, values in outputs.items() if name.startswith("trim.")
        }
        return self._judged(
            self._with_events(outputs), flight, own, outputs, trim, refused or failure
        )

    def _judged(
        self,
        case: PomCase,
        flight: Traces,
        model: Traces,
        shown: Traces,
        trim: Traces,
        failure: str,
    ) -> SampledRun:
        """Return a model judged against a flight; a failed run and a trim beyond what the case
        demands carry no judgement.
        """
        outcomes = judge_all(case, self.plan.job.time, flight, model)
        refused = failure or "; ".join(
            remark.text for remark in beyond_limits(self.limits, trim, demanded=True)
        )
        exceeded = bool(
            [
                remark
                for remark in beyond_limits(self.limits, trim, demanded=False)
                if remark.kind == "trim"
            ]
        )
        verdicts = {
            c.name: "invalid" if refused and c.applies else outcomes[c.name].verdict
            for c in case.criteria
        }
        if refused:
            outcomes = {
                name: replace(outcome, verdict=verdicts[name]) for name, outcome in outcomes.items()
            }
        off = {
            c: unwrapped_difference(c, flight[c], model[c])
            for c in self.traced.values()
            if c in model and c in flight
        }
        kept = {name: shown[name] for name in self.tolerance if name in shown}
        run = SampledRun(
            kept, off, outcomes, status_of(group_verdicts(case, verdicts), exceeded), self.groups
        )
        run.failure = refused
        run.trim = {
            name: float(trim[f"trim.{name}"][0]) / size
            for name, size in self.trim_sizes.items()
            if f"trim.{name}" in trim
        }
        return run

    def _as_flight(self, outputs: Traces) -> Traces:
        """Return the channels that the flight has, of the draw where it has or forms them."""
        seen = signals_of_run(self.plan.case, outputs, self.plan.job.time)
        return {name: seen.get(name, values) for name, values in self.flight.items()}

    def _with_events(self, outputs: Traces) -> PomCase:
        """Return the case with what the aeroplane does (touchdown, full stop) at the instants of
        the draw.
        """
        case, time = self.plan.case, self.plan.job.time
        events = dict(case.events)
        match = Comparison.of(case, time, self.flight, outputs)
        for event in events:
            with contextlib.suppress(NotJudged, Invalid):
                events[event] = find_event(match, event).model
        return replace(case, events=events)

    def deciding(self, run: SampledRun) -> list[str]:
        """Return the criterion of every group that is the best of its alternatives in a run."""
        best: dict[str, str] = {}
        for name, group in self.groups.items():
            if math.isfinite(run.ratio(name)) and (
                group not in best or run.ratio(name) < run.ratio(best[group])
            ):
                best[group] = name
        return list(best.values())

    def decides(self, run: SampledRun) -> str:
        """Return the criterion whose ratio decides a run; empty when none is judged."""
        return max(self.deciding(run), key=run.ratio, default="")

    def signed(self, criterion: str, runs: list[SampledRun]) -> np.ndarray:
        """Return the signed ratio of a criterion over the draws.

        Of a time history at the instant where its mean square over the draws is largest: the
        instant of the worst changes from draw to draw, and its ratio, which has no sign, is not
        linear in the errors.
        """
        channel = self.traced.get(criterion, "")
        if not all(channel in run.difference for run in runs):
            return np.array([run.signed(criterion) for run in runs])
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = (
                np.stack([run.difference[channel] for run in runs]) / self.tolerance[channel].values
            )
        ratio[:, ~np.isfinite(self.tolerance[channel].values)] = 0.0
        square = (
            np.nanmean(np.square(ratio), axis=0)
            if np.isfinite(ratio).any()
            else np.zeros(ratio.shape[1])
        )
        return ratio[:, int(np.argmax(square))]

    def fan(self, runs: list[SampledRun]) -> xr.Dataset:
        """Return the quantiles of the channels with a band."""
        found = {}
        for name in map(str, self.tolerance):
            traces = [
                run.outputs[name]
                for run in runs
                if name in run.outputs and np.isfinite(run.outputs[name]).all()
            ]
            if traces:
                values = np.stack(
                    [
                        unwrapped_near(trace, self.flight[name]) if name in WRAPPED else trace
                        for trace in traces
                    ]
                )
                found[name] = (("quantile", "time"), np.quantile(values, QUANTILES, axis=0))
        return xr.Dataset(found, coords={"quantile": list(QUANTILES), "time": self.plan.job.time})


def with_inertia(job: ReplayJob, model: SimModel) -> ReplayJob:
    """Return a job that states the moments of inertia which it leaves to the model."""
    stated = {row.name: row.value for row in model.entries(PARAMETER) if row.name in INERTIA}
    return replace(job, parameters={**stated, **job.parameters})


def _as_applied(outputs: Traces, job: ReplayJob) -> Traces:
    """Return outputs with what the math pilot moves at its true position."""
    moved = [loop.control for loop in job.pilot if f"applied.{loop.control}" in outputs]
    return {**outputs, **{name: outputs[f"applied.{name}"] for name in moved}}


def replay_sampled(
    cases: Sequence[PomCase],
    runs: Mapping[str, str | Path],
    databases: Mapping[str, str | Path | xr.DataTree],
    count: int,
    seed: int = 0,
    paths: Mapping[str, Any] | None = None,
    *,
    names: Mapping[str, str | Path] | None = None,
    errors: Mapping[str, float] | None = None,
    biases: xr.Dataset | None = None,
    jobs: int = -1,
    resume: str | Path | None = None,
    timeout: float = 60.0,
    progress: Callable[[PomResult], None] | None = None,
    **options: Any,
) -> list[PomResult]:
    """Replay every case by every model and judge it, as `replay_all`, and then by draws of the
    models whose databases are given.

    Parameters
    ----------
    cases, runs, paths, names, biases, jobs, resume, timeout, progress
        As in `replay_all`.
    databases : mapping of str to path or DataTree
        Name of a model to the database that its FMU was made from, with standard errors; a model
        without is not sampled.
    count : int
        Number of draws.
    seed : int
    errors : mapping, optional
        Relative standard errors of ``mass`` and ``thrust`` (`InstrumentErrors.of`).
    **options
        Others of `replay_all`.

    Returns
    -------
    list of PomResult
        In the order of the cases, with ``samples``; the same for any number of jobs.  A case with a
        control law has none.

    Raises
    ------
    UnknownName
        A database for a model that is not there.
    SchemaError, OutOfRange, SimulationError
        As `replay_all` and `DrawnModels.of`.
    """
    unknown = [name for name in databases if name not in runs]
    if unknown:
        raise UnknownName(unknown[0], runs, "model", "a database is that of a model")
    for name, database in databases.items():
        drawn_models(
            runs[name], database, count, seed
        )  # what they refuse is reported before the flights
    kept = Path(resume).resolve() if resume is not None else None
    states = paths_of_cases(cases, paths or {}, KeptStates(kept, biases), jobs)
    given: dict[str, Any] = {case.record: path for case, path in zip(cases, states, strict=True)}
    results = replay_all(
        cases, runs, given, names=names, jobs=jobs, resume=resume, timeout=timeout, **options
    )
    draw = {"count": count, "seed": seed, "errors": errors, "names": names, "timeout": timeout}
    found = []
    for case, result in zip(cases, results, strict=True):
        samples = (
            {}
            if case.law
            else samples_of_case(case, given[case.record], runs, databases, draw, jobs)
        )
        found.append(replace(result, samples=samples))
        if progress is not None:
            progress(found[-1])
    return found


def samples_of_case(
    case: PomCase,
    path: Any,
    runs: Mapping[str, str | Path],
    databases: Mapping[str, str | Path | xr.DataTree],
    draw: Mapping[str, Any],
    jobs: int,
) -> dict[str, SampledReplay]:
    """Return the samples of one case by model; a model whose trim surfaces cannot be solved has
    none.

    Parameters
    ----------
    case, path, runs, databases, jobs
        As in `replay_sampled`, of one case.
    draw : mapping
        ``count``, ``seed``, ``errors``, ``names`` and ``timeout`` of `replay_sampled`.
    """
    models, aircraft = (
        Models(runs, draw.get("names")).of(case),
        _aircraft(case.aircraft) if case.aircraft else None,
    )
    samples: dict[str, SampledReplay] = {}
    for name, database in databases.items():
        plan = plan_of(case, path)
        job, _, failure = solve_trim_surfaces(
            plan.job, plan.case.drive.trim_surfaces, models[name], draw.get("timeout", 60.0)
        )
        if not failure:
            drawn = drawn_models(runs[name], database, draw["count"], draw["seed"])
            samples[name] = replay_draws(
                ReplayPlan(plan.case, plan.states, job), drawn, aircraft, draw.get("errors"), jobs
            )
    return samples


def drawn_models(
    fmu: str | Path, database: str | Path | xr.DataTree, count: int, seed: int
) -> DrawnModels:
    """Return `DrawnModels.of`, made once in a process for all cases of a batch."""
    files = [Path(item) for item in (fmu, database) if not isinstance(item, xr.DataTree)]
    key = (
        *(FileState.of(file) for file in files),
        id(database) if isinstance(database, xr.DataTree) else 0,
        count,
        seed,
    )
    if key not in _drawn:
        while len(_drawn) >= _MOST_DRAWN:
            _drawn.pop(next(iter(_drawn)))
        _drawn[key] = (
            DrawnModels.of(fmu, database, count, seed),
            database,
        )  # the database keeps its identity as long as this
    return _drawn[key][0]


_MOST_DRAWN = 4  # models whose draws are held
_drawn: dict[Any, tuple[DrawnModels, Any]] = {}


@lru_cache(maxsize=8)
def _aircraft(file: str) -> Aircraft:
    """Return the aircraft of cases, read once."""
    return read_aircraft(file)
