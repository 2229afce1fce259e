"""The bench for term swaps: a case, two models, and each choice of their differences judged
once.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError
from flightmech.names import WRAPPED
from flightmech.support.arrays import rms
from pom.cases.case import PomCase
from pom.cases.job import ReplayJob
from pom.diagnosis.sample_thinning import at_samples, thin_job
from pom.diagnosis.swap_judgement import CEILING, Judged, nearest_choice
from pom.diagnosis.swap_models import SwapModels
from pom.judging.signals import Comparison, RunSignals, signals_of_run
from pom.judging.verdict import judge_match
from pom.replaying.kernel_replay import replay_choices
from pom.replaying.replay_case import plan_of
from pom.replaying.replay_channels import helping_channels, judged_channels, sampled_channels
from pom.replaying.trim import TrimLimit, beyond_limits, trim_limits
from pom.status import group_verdicts, judged_groups, status_of
from pom.tolerances.channels import output_of

# [s] Candidates for the longest step of a swap run. The bench uses the first candidate that is as
# good as the step of the models.
LONG_STEPS: tuple[float, ...] = (0.08, 0.04, 0.02)
# With wheels on the ground only the shortest candidate: the instant of lift-off or touchdown
# differs more between two swaps than between the two models.
GROUND_STEPS = LONG_STEPS[-1:]
# [half widths, or relative if that is more] Largest change of the judgement of both models by a
# longer step.
STEP_ERROR = 2e-3
TRIM_WEIGHT = 0.1  # A trim change of its whole limit counts as a tenth of the mismatch.

Outputs = dict[str, np.ndarray]
Run = tuple[Outputs, str]  # outputs, and why the run failed


@dataclass
class SwapBench:
    """A case, its two models, and judged runs with every requested choice of their differences.

    Attributes
    ----------
    case : PomCase
    job : Job
    states : Dataset (time)
        The flight over the window. [SI]
    flight : Signals
        Channels of the flight.
    channels : frozenset of str
        Channels that the criteria use, controls of a math pilot, and trims with a limit.
    limits : dict of str to TrimLimit
        Limits of the trim, by quantity.
    models : SwapModels
    terms, parts : tuple of str
        Terms and parts that differ and can matter in this case.
    flown : Job
        Copy of `job` with the longest steps that judge both models alike (`thin_job`).
    idle : dict of str to float
        Terms that are not flown alone (`screening.screen_idle_terms`). The value bounds what each
        may move, as `Judged.moved`. A choice takes all of them or none, whichever is nearer.
    known : dict of frozenset of str to Judged
        Judgements of the runs, by choice.
    before : dict of str to Judged or None
        Judgements of an earlier job, by the content of the choice. These choices are not flown
        again. None: contents are not needed.
    contents : dict of str to frozenset of str
        Choices by the hash of their content (`_hash_content`).
    step : float or None
        Longest step of `flown`, 0 for the step of the models; None: the bench searches it. [s]
    """

    case: PomCase
    job: ReplayJob
    states: xr.Dataset
    flight: RunSignals
    channels: frozenset[str]
    limits: dict[str, TrimLimit]
    models: SwapModels
    terms: tuple[str, ...]
    parts: tuple[str, ...]
    flown: ReplayJob = field(init=False, repr=False)
    idle: dict[str, float] = field(default_factory=dict)
    _match: Comparison = field(init=False, repr=False)
    known: dict[frozenset[str], Judged] = field(default_factory=dict, repr=False)
    before: Mapping[str, Judged] | None = field(default=None, repr=False)
    contents: dict[str, frozenset[str]] = field(default_factory=dict, repr=False)
    step: float | None = None
    _start: dict[str, np.ndarray] = field(default_factory=dict, repr=False)
    _size: dict[str, float] = field(default_factory=dict, repr=False)

    @classmethod
    def of(
        cls,
        case: PomCase,
        models: SwapModels,
        path: Any,
        before: Mapping[str, Judged] | None = None,
        step: float | None = None,
    ) -> SwapBench:
        """Return the bench of a case, with runs of both models.

        Parameters
        ----------
        case : PomCase
        models : SwapModels
        path
            As in `replay`.
        before, step : optional
            Attributes of the bench; `step` from an earlier bench of the same case and models.

        Raises
        ------
        SchemaError
            Databases and aircraft of one of the models do not belong together.
        OutOfRange
            The clock of the record has a gap in the window.
        """
        plan = plan_of(case, path).demand()
        flight = sampled_channels(plan.states)
        limits = trim_limits(plan.case, flight)
        channels = {*judged_channels(plan.case), *helping_channels(plan.case)}
        channels.update(f"applied.{loop.control}" for loop in plan.job.pilot)
        channels.update(f"trim.{name}" for name in limits)
        return cls(
            case=plan.case,
            job=plan.job,
            states=plan.states,
            flight=signals_of_run(case, flight, plan.job.time),
            channels=frozenset(channels),
            limits=limits,
            models=models,
            terms=_relevant_terms(case, models.terms),
            parts=_relevant_parts(case, flight, models.parts),
            before=before,
            step=step,
        )

    def __post_init__(self) -> None:
        self.flown = self.job
        self._match = Comparison(self.case, self.job.time, self.flight, self.flight)
        self._fly_models()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all terms and parts that can be swapped."""
        return (*self.terms, *self.parts)

    @property
    def sizes(self) -> dict[str, float]:
        """Scale of every judged output, as `Judged.moved` uses it. [SI]"""
        return self._size

    @property
    def whole(self) -> SwapBench:
        """The bench itself; counterpart of `LateBench.whole`."""
        return self

    def judged(self, choices: Iterable[Collection[str]], exact: bool = False) -> list[Judged]:
        """Return the judgement of every choice of names; new choices are flown together.

        With `exact` a choice is flown with exactly its idle terms, not with all or none of them.
        """
        if exact:
            keys = [frozenset(choice) for choice in choices]
        else:
            keys = [nearest_choice(choice, self.idle) for choice in choices]
        self._reuse_judgements(self._unknown_choices(keys))
        for key, (outputs, failure) in self._fly_choices(self._unknown_choices(keys)):
            self.known[key] = self._judge_run(outputs, failure)
        return [self.known[key] for key in keys]

    def _unknown_choices(self, choices: Iterable[frozenset[str]]) -> list[frozenset[str]]:
        """Return choices without a judgement, each once, in their order."""
        return [choice for choice in dict.fromkeys(choices) if choice not in self.known]

    def _reuse_judgements(self, choices: Iterable[frozenset[str]]) -> None:
        """Copy the judgements that an earlier job made of the same content."""
        if self.before is None:
            return
        for choice in choices:
            content = self._hash_content(choice)
            self.contents[content] = choice
            earlier = self.before.get(content)
            if earlier is None:
                continue
            change = earlier.moved
            if earlier.change:
                # The final model sets the scale of `moved`, and it may have changed.
                change = self._scaled_change(earlier.change)
            self.known[choice] = replace(earlier, moved=change)

    def _hash_content(self, choice: frozenset[str]) -> str:
        """Return the hash of the longest step and of the swapped parts of the final model.

        Together with the case and the a-priori model they determine the run of the choice.
        """
        content = self.models.content
        steps = f"{self.flown.time.size} {self.flown.parameters.get('mode.step')}"
        swapped = "".join(content[name] for name in sorted(choice))
        return sha256(f"{steps} {content['']}{swapped}".encode()).hexdigest()

    def _fly_choices(
        self, choices: Iterable[frozenset[str]]
    ) -> Iterator[tuple[frozenset[str], Run]]:
        """Yield every choice with its run; choices with the same compiled parts run together."""
        groups: dict[frozenset[str], list[frozenset[str]]] = defaultdict(list)
        for choice in choices:
            groups[self.models.compiled_parts(choice)].append(choice)
        for parts, group in groups.items():
            outputs, failures = self._fly_group(parts, group)
            yield from zip(group, zip(outputs, failures, strict=True), strict=True)

    def _fly_models(self) -> None:
        """Fly both models with the longest suitable steps, and store the scale of each output."""
        for names in ((), self.names):
            # A swap may give an invalid aircraft, but both models have to compile.
            self.models.compiled(self.models.compiled_parts(names))
        (start, prior), (end, final) = self._search_long_steps()
        self.known.update({frozenset(): prior, frozenset(self.names): final})
        for name, values in start.items():
            if name.startswith("trim."):
                limit = self.limits[name.removeprefix("trim.")]
                self._start[name], self._size[name] = values[:1], limit.size / TRIM_WEIGHT
                continue
            # Scale of a channel: its larger rms difference from the final model and the flight.
            sizes = [0.0]
            for run in (end, self.flight.raw):
                if name in run:
                    sizes.append(rms(_difference(name, values, run[name])))
            self._start[name], self._size[name] = values, float(np.fmax.reduce(sizes))
        # The final model was judged before the scales were known; its change follows from them.
        if np.isfinite(final.moved):
            changes = self._rms_changes(end)
            moved = self._scaled_change(changes)
            self.known[frozenset(self.names)] = replace(final, change=changes, moved=moved)

    def _search_long_steps(self) -> list[tuple[Outputs, Judged]]:
        """Return `_fly_ends` with the longest steps that judge both models alike.

        A known `step` is not searched again.
        """
        if self.step is not None:
            if self.step:
                self.flown = thin_job(self.job, self.step)
            else:
                self.flown = self.job
            return self._fly_ends()
        self.step, ends = 0.0, self._fly_ends()
        if "mode.step" in self.job.parameters:
            return ends
        candidates = LONG_STEPS
        if _has_ground_contact(self.case, self.flight.raw):
            candidates = GROUND_STEPS
        for step in candidates:
            self.flown = thin_job(self.job, step)
            coarse = self._fly_ends()
            pairs = zip(ends, coarse, strict=True)
            if all(fine.agrees_with(thin, STEP_ERROR) for (_, fine), (_, thin) in pairs):
                self.step = step
                return coarse
        self.flown = self.job
        return ends

    def _fly_ends(self) -> list[tuple[Outputs, Judged]]:
        """Return outputs and judgement of the a-priori model and of the final model."""
        ends = [frozenset(), frozenset(self.names)]
        runs = dict(self._fly_choices(ends))
        return [(runs[end][0], self._judge_run(*runs[end])) for end in ends]

    def _fly_group(
        self, parts: frozenset[str], choices: Sequence[frozenset[str]]
    ) -> tuple[list[Outputs], list[str]]:
        """Return the outputs of choices with the same compiled parts, and why runs failed."""
        try:
            sim = self.models.compiled(parts)
        except SchemaError as error:
            # For example tables of two engines that do not fit together.
            nan = {name: np.full(self.job.time.size, np.nan) for name in self.flight}
            return [nan] * len(choices), [str(error)] * len(choices)
        names = sorted({output_of(channel, sim.outputs) for channel in self.channels})
        parameters = []
        for choice in choices:
            parameters.append(self._without_job_parameters(self.models.choice(choice)))
        outputs, failures = replay_choices(sim, self.flown, parameters, names)
        outputs = at_samples(outputs, self.flown.time, self.job.time)
        # The judged position of a control with a math pilot is the applied position.
        applied = {}
        for loop in self.job.pilot:
            if f"applied.{loop.control}" in outputs:
                applied[loop.control] = outputs[f"applied.{loop.control}"]
        outputs |= applied
        # From one array per output (choice, time) to the outputs of each choice.
        runs = []
        for k in range(len(choices)):
            runs.append({name: values[k] for name, values in outputs.items()})
        return runs, failures

    def _without_job_parameters(self, parameters: Mapping[str, float]) -> dict[str, float]:
        """Return parameters that the case does not set; it may set the runway condition."""
        fixed = self.job.parameters
        return {name: value for name, value in parameters.items() if name not in fixed}

    def _judge_run(self, outputs: Mapping[str, np.ndarray], failure: str) -> Judged:
        """Return the judgement of one run."""
        mismatch: dict[str, float] = {}
        ratio: dict[str, float] = {}
        verdicts: dict[str, str] = {}
        groups: dict[str, float] = {}
        failed = bool(failure or beyond_limits(self.limits, outputs, demanded=True))
        usual = beyond_limits(self.limits, outputs, demanded=False)
        exceeded = any(remark.kind == "trim" for remark in usual)
        outcomes = judge_match(self._match.against(outputs))
        for criterion in self.case.criteria:
            outcome = outcomes[criterion.name]
            verdicts[criterion.name] = outcome.verdict
            if failed and criterion.applies:
                verdicts[criterion.name] = "invalid"
            # The other verdicts have no number.
            if outcome.verdict not in ("pass", "fail", "invalid"):
                continue
            ratio[criterion.name] = outcome.worst_ratio
            # The rms of a time history; a scalar has only its ratio.
            mismatch[criterion.name] = outcome.rms
            if not np.isfinite(outcome.rms):
                mismatch[criterion.name] = outcome.worst_ratio
            counted = float(np.fmin(mismatch[criterion.name], CEILING))
            groups[criterion.group] = min(groups.get(criterion.group, CEILING), counted)
        total = np.nan
        if groups:
            total = float(np.sqrt(np.mean(np.square(list(groups.values())))))
        changes: dict[str, float] = {}
        largest_change = np.inf
        if not failure:
            changes = self._rms_changes(outputs)
            largest_change = self._scaled_change(changes)
        verdict = status_of(judged_groups(group_verdicts(self.case, verdicts)), exceeded)
        return Judged(verdict, mismatch, ratio, total=total, moved=largest_change, change=changes)

    def _rms_changes(self, outputs: Mapping[str, np.ndarray]) -> dict[str, float]:
        """Return the rms differences of outputs from those of the a-priori model."""
        changes = {}
        for name, start in self._start.items():
            changes[name] = np.inf
            if name in outputs:
                changes[name] = float(rms(_difference(name, outputs[name][: start.size], start)))
        return changes

    def _scaled_change(self, changes: Mapping[str, float]) -> float:
        """Return the largest change over its scale; infinite if it has no scale."""
        largest = 0.0
        for name, change in changes.items():
            if change == 0.0:
                continue
            scaled = np.inf
            if self._size[name] > 0.0 and np.isfinite(change):
                scaled = change / self._size[name]
            largest = max(largest, scaled)
        return largest


def _relevant_terms(case: PomCase, terms: Iterable[str]) -> tuple[str, ...]:
    """Return the terms that can matter: recorded surfaces do not respond to hinge moments."""
    if case.drive.level != "recorded":
        return tuple(terms)
    return tuple(name for name in terms if not name.startswith("Ch_"))


def _relevant_parts(
    case: PomCase, flight: Mapping[str, np.ndarray], parts: Iterable[str]
) -> tuple[str, ...]:
    """Return the parts that can matter; an engine does not matter if thrust drives the model."""
    relevant = {
        "engine": case.drive.engine not in ("thrust", "none"),
        "gear": _has_ground_contact(case, flight),
        "circuit": case.drive.surfaces != "recorded",
    }
    # A part of another kind, such as the fuel, can always matter.
    return tuple(name for name in parts if relevant.get(name.split("/")[0], True))


def _has_ground_contact(case: PomCase, flight: Mapping[str, np.ndarray]) -> bool:
    """Whether a wheel is on the ground at any time."""
    if case.drive.trim == "ground":
        return True
    wheels = [flight[name] for name in flight if name.startswith("wow_")]
    return any((weight_on_wheel > 0.5).any() for weight_on_wheel in wheels)


def _difference(name: str, values: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Return the difference of two time histories; of angles along the shorter arc."""
    if name in WRAPPED:
        return np.angle(np.exp(1j * (values - reference)))
    return values - reference
