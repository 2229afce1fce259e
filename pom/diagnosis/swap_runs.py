"""The bench on which terms are swapped: one case, what differs between two models, and every choice
of it replayed and judged once.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import SchemaError
from flightmech.support.arrays import rms
from pom.cases.case import PomCase
from pom.cases.job import ReplayJob
from pom.diagnosis.term_swaps import SwapModels
from pom.judging.signals import Comparison, RunSignals, signals_of_run
from pom.judging.verdict import judge_match
from pom.replaying.kernel_replay import replay_choices
from pom.replaying.replay_case import helping_channels, judged_channels, plan_of
from pom.replaying.trim import TrimLimit, beyond_limits, trim_limits
from pom.result import group_verdicts, status_of
from pom.tolerances.channels import WRAPPED, output_of

# second differences of an input above so many of their medians, and above `LEAST_JUMP` of its
# range, are a jump
JUMP = 10.0
LEAST_JUMP = 0.02
LEAST_RANGE = 1e-6  # [SI] of an input: what is below is rounding, as a wind that blows level


def thin_job(job: ReplayJob, step: float) -> ReplayJob:
    """Return a job whose samples are as far apart as they can be within `step` [s], which becomes
    its longest internal step.

    First and last sample stay as they are: the model is trimmed on the one and ends on the other.
    A math pilot keeps all samples.
    """
    parameters = {**job.parameters, "mode.step": step}
    count = job.time.size
    every = (
        1
        if job.pilot or count < 2
        else int(step / float(np.median(np.diff(job.time))) * (1.0 + 1e-6))
    )
    if every < 2 or count < 2 * every:
        return replace(job, parameters=parameters)
    kept = np.unique([*range(0, count, every), count - 1, *_jumps(job.inputs.values())])
    before, share = _between(kept, np.arange(count))
    weight = _hats(before, share, np.ones(count), kept.size)
    inputs = {}
    for name, values in job.inputs.items():
        mean = _hats(before, share, values, kept.size) / weight
        mean[[0, -1]] = values[[0, -1]]
        inputs[name] = mean
    return replace(job, time=job.time[kept], inputs=inputs, parameters=parameters)


def _jumps(inputs: Iterable[np.ndarray]) -> np.ndarray:
    """Return the samples next to which an input jumps, and that sample itself."""
    found = [np.empty(0, int)]
    for values in inputs:
        bend = np.abs(np.diff(values, 2))
        found.append(
            1
            + np.flatnonzero(
                bend
                > np.fmax(JUMP * np.median(bend), LEAST_JUMP * max(np.ptp(values), LEAST_RANGE))
            )
        )
    at = np.concatenate(found)
    return np.concatenate([at - 1, at, at + 1])


def _between(kept: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return behind which of the kept places each wanted one lies, and which share of the way to
    the next.
    """
    before = np.clip(np.searchsorted(kept, wanted, side="right") - 1, 0, kept.size - 2)
    return before, (wanted - kept[before]) / np.diff(kept)[before]


def _hats(before: np.ndarray, share: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """Return the sums of values (sample,) weighed by the hat functions (count,) at the kept
    samples.
    """
    return np.bincount(before, (1.0 - share) * values, count) + np.bincount(
        before + 1, share * values, count
    )


def at_samples(
    outputs: Mapping[str, np.ndarray], kept: np.ndarray, time: np.ndarray
) -> dict[str, np.ndarray]:
    """Return outputs (run, kept) by name at all samples (run, time), along lines; angles the way
    round that is below half a turn.
    """
    if kept.size == time.size:
        return dict(outputs)
    before, share = _between(kept, time)
    found = {}
    for name, values in outputs.items():
        rise = np.diff(values, axis=1)
        if name in WRAPPED:
            rise = np.angle(np.exp(1j * rise))
        found[name] = values[:, before] + share * rise[:, before]
    return found


# [half widths] of a criterion that fails without a number, such as a mode that is not there; no
# mismatch counts more
CEILING = 10.0
MATCHED = (
    "pass",
    "limits_exceeded",
)  # verdicts of a model within tolerance; of the second the trim is beyond its usual limits
OTHERS = "others"  # in the shares: all terms without a share of their own


def criteria_of(table: pd.DataFrame) -> list[str]:
    """Return the names of the judged criteria of a diagnosis."""
    return [
        str(column).removesuffix(" ratio")
        for column in table.columns
        if str(column).endswith(" ratio")
    ]


def waterfall(table: pd.DataFrame, criterion: str = "") -> pd.DataFrame:
    """Return the way from the mismatch of the a-priori model to that of the final one, share by
    share.

    Parameters
    ----------
    table : DataFrame
        From `diagnose`.
    criterion : str, optional
        A judged criterion; the total mismatch without it.

    Returns
    -------
    DataFrame
        One row per share, in the order of the table: ``term``, ``start`` and ``stop`` (mismatch
        before and after it, in half widths), ``explained`` and ``stderr`` (share of the gap and its
        standard error).  Empty when the diagnosis has no shares.
    """
    prefix = f"{criterion} " if criterion else ""
    rows = table[table["stage"] == "share"]
    first = table.loc[table["stage"] == "prior", f"{prefix}mismatch"].to_numpy(float)
    stop = rows[f"{prefix}mismatch"].to_numpy(float)
    start = np.append(np.fmin(first, CEILING), stop)[: len(stop)]
    found = {"term": rows["term"].to_list(), "start": start, "stop": stop}
    return pd.DataFrame(
        found | {name: rows[f"{prefix}{name}"].to_numpy(float) for name in ("explained", "stderr")}
    )


def ranking(table: pd.DataFrame) -> pd.DataFrame:
    """Return the terms of every criterion, those first that explain most of its mismatch.

    Parameters
    ----------
    table : DataFrame
        From `diagnose`.

    Returns
    -------
    DataFrame
        ``criterion`` (empty: the total mismatch), ``rank`` from 1, ``term``, ``explained`` and
        ``stderr`` (Shapley share of the gap and its standard error; NaN where the criterion has no
        gap), ``change`` (of the mismatch, in half widths; negative: towards the flight).
    """
    found = []
    for criterion in ("", *criteria_of(table)):
        steps = waterfall(table, criterion)
        steps = steps.assign(
            criterion=criterion, change=steps["stop"] - steps["start"]
        ).sort_values("change", kind="stable")
        found.append(steps.assign(rank=np.arange(1, len(steps) + 1)))
    return pd.concat(found, ignore_index=True)[
        ["criterion", "rank", "term", "explained", "stderr", "change"]
    ]


LONG_STEPS = (
    0.08,
    0.04,
    0.02,
)  # [s] longest steps of a swap; the first that is as good as `STEP`, of the models themselves, is taken
# with wheels on the ground: when one lifts off or strikes differs more between two swaps than
# between the two models
GROUND_STEPS = LONG_STEPS[-1:]
# half widths, or part of the number where that is more: by how much both models may be judged
# otherwise with it
STEP_ERROR = 2e-3
TRIM_WEIGHT = 0.1  # a trim that moves by its whole limit counts as much as a tenth of the mismatch


@dataclass(frozen=True)
class Judged:
    """What a choice of terms and parts from the final model makes of the a-priori one.

    Attributes
    ----------
    verdict : str
        Status of the case.
    mismatch, ratio : dict of str to float
        By judged criterion: rms of difference over half width of a time history, the ratio itself
        of a scalar; largest ratio. [1]
    total : float
        Root mean square of the mismatches of the groups, of each group the best alternative. [1]
    moved : float
        How far the judged outputs are from those of the a-priori model: largest rms of a channel
        over that of its mismatch (a-priori model less flight, or less final model, the larger), or
        a tenth of a trim over its limit; infinite for a run that failed. [1]
    change : dict of str to float
        By judged output: rms of its difference from that of the a-priori model, of which `moved` is
        made; empty for a run that failed. [SI]
    """

    verdict: str
    mismatch: dict[str, float]
    ratio: dict[str, float]
    total: float
    moved: float = np.inf
    change: dict[str, float] = field(default_factory=dict, repr=False)

    @property
    def matched(self) -> bool:
        """Whether the case is within tolerance, whatever its trim."""
        return self.verdict in MATCHED

    def counted(self, criteria: Iterable[str]) -> np.ndarray:
        """Return the total mismatch and that of every criterion as they count, at most `CEILING` (1
        + criterion,).
        """
        return np.array(
            [
                np.fmin(mismatch, CEILING)
                for mismatch in (
                    self.total,
                    *(self.mismatch.get(name, CEILING) for name in criteria),
                )
            ]
        )


def nearest_choice(choice: Collection[str], idle: Collection[str]) -> frozenset[str]:
    """Return the choice with all idle terms, or with none of them.

    All idle terms are swapped if `choice` swaps more than half of them.
    """
    others = frozenset(choice).difference(idle)
    swapped = frozenset(choice).intersection(idle)
    return others | frozenset(idle) if 2 * len(swapped) > len(idle) else others


@dataclass
class SwapBench:
    """A case, the two models, and every choice of what differs between them, flown and judged once.

    Attributes
    ----------
    case : PomCase
    job : Job
    states : Dataset (time)
        The flight over the window. [SI]
    flight : Signals
        The same by channel.
    channels : frozenset of str
        What the criteria are computed from, what a math pilot applies, and the trims that have a
        limit.
    limits : dict of str to TrimLimit
        Of the trim, by quantity.
    models : SwapModels
    terms, parts : tuple of str
        What differs and can matter in this case.
    flown : Job
        The same as `job` with the longest steps that judge both models alike
        (`long_steps.thinned`).
    idle : dict of str to float
        Terms that are not flown alone (`screening.screen_idle_terms`), with the bound of what each may move,
        as `Judged.moved`: a choice takes all of them or none, whichever is nearer.
    known : dict of frozenset of str to Judged
        What was flown, by choice.
    before : dict of str to Judged or None
        What an earlier job flew, by the content of the choice; it is not flown again.  None: nobody
        needs contents.
    contents : dict of str to frozenset of str
        Choices by all that decides their flights next to case and a-priori model.
    step : float or None
        Longest step of `flown`, 0 for that of the models themselves; None: to be found. [s]
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
        """Return the bench of a case, on which both models are flown already; `path` as in
        `replay`, `step` of a bench of the same case and models where there was one.

        Raises
        ------
        SchemaError
            Databases and aircraft of one of the models do not belong together.
        """
        plan = plan_of(case, path)
        count, states = plan.job.time.size, plan.states.data_vars
        flight = {
            str(name): np.broadcast_to(item.values, count)
            for name, item in states.items()
            if item.ndim < 2
        }
        limits = trim_limits(plan.case, flight)
        limited = (f"trim.{name}" for name in limits)
        moved = (f"applied.{loop.control}" for loop in plan.job.pilot)
        channels = frozenset(
            {*judged_channels(plan.case), *helping_channels(plan.case), *moved, *limited}
        )
        driven = case.drive.level == "recorded"  # surfaces that are driven feel no hinge moment
        terms = tuple(name for name in models.terms if not (driven and name.startswith("Ch_")))
        parts = _parts(case, flight, models.parts)
        return cls(
            plan.case,
            plan.job,
            plan.states,
            signals_of_run(case, flight, plan.job.time),
            channels,
            limits,
            models,
            terms,
            parts,
            before=before,
            step=step,
        )

    def __post_init__(self) -> None:
        self.flown = self.job
        self._match = Comparison(self.case, self.job.time, self.flight, self.flight)
        self._begin()

    @property
    def names(self) -> tuple[str, ...]:
        """Everything that can be swapped."""
        return (*self.terms, *self.parts)

    @property
    def whole(self) -> SwapBench:
        """The bench itself, as of `LateBench`."""
        return self

    def judged(self, choices: Iterable[Collection[str]], exact: bool = False) -> list[Judged]:
        """Return the judgement of every choice of names; those that the bench does not know yet are
        flown together.

        With `exact` a choice takes idle terms one by one, as it has them.
        """
        keys = [
            frozenset(choice) if exact else nearest_choice(choice, self.idle) for choice in choices
        ]
        self._recall(key for key in dict.fromkeys(keys) if key not in self.known)
        for key, flown in self._fly(key for key in dict.fromkeys(keys) if key not in self.known):
            self.known[key] = self._judge(*flown)
        return [self.known[key] for key in keys]

    def _recall(self, choices: Iterable[frozenset[str]]) -> None:
        """Take over what an earlier job flew with the same content."""
        if self.before is None:
            return
        for choice in choices:
            content = self._content(choice)
            self.contents[content] = choice
            if (found := self.before.get(content)) is not None:
                # the scale of what moved is that of the final model, which may be another one
                moved = self._moved(found.change) if found.change else found.moved
                self.known[choice] = replace(found, moved=moved)

    def _content(self, choice: frozenset[str]) -> str:
        """Return the hash of all that decides the flight of a choice next to the case and the
        a-priori model: longest step, and what is taken of the final model.
        """
        content = self.models.content
        steps = f"{self.flown.time.size} {self.flown.parameters.get('mode.step')}"
        taken = "".join(content[name] for name in sorted(choice))
        return sha256(f"{steps} {content['']}{taken}".encode()).hexdigest()

    def _fly(
        self, choices: Iterable[frozenset[str]]
    ) -> Iterator[tuple[frozenset[str], tuple[dict[str, np.ndarray], str]]]:
        """Give every choice with its outputs and why its run failed; those with the same compiled
        parts are flown together.
        """
        together: dict[frozenset[str], list[frozenset[str]]] = defaultdict(list)
        for choice in choices:
            together[self.models.compiled_parts(choice)].append(choice)
        for parts, group in together.items():
            yield from zip(group, zip(*self._flown(parts, group), strict=True), strict=True)

    def _begin(self) -> None:
        """Fly both models, with the longest steps that are as good, and keep what the effect of a
        swap is compared with.
        """
        for names in ((), self.names):  # a swap may make no aircraft, the models themselves have to
            self.models.compiled(self.models.compiled_parts(names))
        (start, prior), (end, final) = self._ends_with_long_steps()
        self.known.update({frozenset(): prior, frozenset(self.names): final})
        for name, values in start.items():
            if name.startswith("trim."):
                self._start[name], self._size[name] = (
                    values[:1],
                    self.limits[name.removeprefix("trim.")].size / TRIM_WEIGHT,
                )
            else:
                others = [run[name] for run in (end, self.flight.raw) if name in run]
                self._start[name], self._size[name] = (
                    values,
                    float(np.fmax.reduce([0.0, *(rms(_apart(name, values, o)) for o in others)])),
                )

    def _ends_with_long_steps(self) -> list[tuple[dict[str, np.ndarray], Judged]]:
        """Return `_ends` with the longest steps that judge both models alike, which are found here
        unless they are known.
        """
        if self.step is not None:
            self.flown = thin_job(self.job, self.step) if self.step else self.job
            return self._ends()
        self.step, ends = 0.0, self._ends()
        if "mode.step" in self.job.parameters:
            return ends
        for step in GROUND_STEPS if _touching(self.case, self.flight.raw) else LONG_STEPS:
            self.flown = thin_job(self.job, step)
            longer = self._ends()
            if all(_agree(one, other) for (_, one), (_, other) in zip(ends, longer, strict=True)):
                self.step = step
                return longer
        self.flown = self.job
        return ends

    def _ends(self) -> list[tuple[dict[str, np.ndarray], Judged]]:
        """Return outputs and judgement of the a-priori model and of the final one."""
        ends = [frozenset(), frozenset(self.names)]
        flown = dict(self._fly(ends))
        return [(flown[end][0], self._judge(*flown[end])) for end in ends]

    def _flown(
        self, parts: frozenset[str], choices: Sequence[frozenset[str]]
    ) -> tuple[list[dict[str, np.ndarray]], list[str]]:
        """Return the outputs of choices with the same compiled parts, and why runs failed."""
        try:
            sim = self.models.compiled(parts)
        except SchemaError as error:  # tables of two engines that make no engine together
            nothing = {name: np.full(self.job.time.size, np.nan) for name in self.flight}
            return [nothing] * len(choices), [str(error)] * len(choices)
        wanted = sorted({output_of(channel, sim.outputs) for channel in self.channels})
        chosen = [self._without_own(self.models.choice(choice)) for choice in choices]
        outputs, failures = replay_choices(sim, self.flown, chosen, wanted)
        outputs = at_samples(outputs, self.flown.time, self.job.time)
        outputs |= {
            loop.control: outputs[f"applied.{loop.control}"]
            for loop in self.job.pilot
            if f"applied.{loop.control}" in outputs
        }
        return [
            {name: values[k] for name, values in outputs.items()} for k in range(len(choices))
        ], failures

    def _without_own(self, parameters: Mapping[str, float]) -> dict[str, float]:
        """Return parameters without those that the case gives, such as the condition of the runway."""
        own = parameters.keys() & self.job.parameters.keys()
        return (
            {name: value for name, value in parameters.items() if name not in own}
            if own
            else dict(parameters)
        )

    def _judge(self, outputs: Mapping[str, np.ndarray], failure: str) -> Judged:
        mismatch: dict[str, float] = {}
        ratio: dict[str, float] = {}
        verdicts: dict[str, str] = {}
        groups: dict[str, float] = {}
        failed = bool(failure or beyond_limits(self.limits, outputs, demanded=True))
        exceeded = any(
            remark.kind == "trim" for remark in beyond_limits(self.limits, outputs, demanded=False)
        )
        outcomes = judge_match(self._match.against(outputs))
        for criterion in self.case.criteria:
            found = outcomes[criterion.name]
            verdicts[criterion.name] = "invalid" if failed and criterion.applies else found.verdict
            if found.verdict not in ("pass", "fail", "invalid"):
                continue
            ratio[criterion.name] = found.worst_ratio
            mismatch[criterion.name] = (
                found.rms if np.isfinite(found.rms) else found.worst_ratio
            )  # of a curve, of a number
            counted = float(np.fmin(mismatch[criterion.name], CEILING))
            groups[criterion.group] = min(groups.get(criterion.group, CEILING), counted)
        total = float(np.sqrt(np.mean(np.square(list(groups.values()))))) if groups else np.nan
        change = {} if failure else self._changes(outputs)
        moved = np.inf if failure else self._moved(change)
        verdict = status_of(group_verdicts(self.case, verdicts), exceeded)
        return Judged(verdict, mismatch, ratio, total, moved, change)

    def _changes(self, outputs: Mapping[str, np.ndarray]) -> dict[str, float]:
        """Return the rms by which outputs differ from those of the a-priori model."""
        return {
            name: float(rms(_apart(name, outputs[name][: start.size], start)))
            if name in outputs
            else np.inf
            for name, start in self._start.items()
        }

    def _moved(self, changes: Mapping[str, float]) -> float:
        """Return how far outputs are from those of the a-priori model."""
        found = 0.0
        for name, change in changes.items():
            if change != 0.0:
                found = max(
                    found,
                    change / self._size[name]
                    if self._size[name] > 0.0 and np.isfinite(change)
                    else np.inf,
                )
        return found


def _parts(
    case: PomCase, flight: Mapping[str, np.ndarray], parts: Iterable[str]
) -> tuple[str, ...]:
    """Return the parts that can matter: engines that the thrust does not drive, gear that touches
    the ground.
    """
    felt = {
        "engine": case.drive.engine != "thrust",
        "gear": _touching(case, flight),
        "circuit": case.drive.surfaces != "recorded",
    }
    return tuple(name for name in parts if felt.get(name.split("/")[0], True))


def _touching(case: PomCase, flight: Mapping[str, np.ndarray]) -> bool:
    """Return whether a wheel is on the ground."""
    return case.drive.trim == "ground" or any(
        (flight[name] > 0.5).any() for name in flight if name.startswith("wow_")
    )


def _apart(name: str, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the difference of two time histories, of an angle the way round that is below half a
    turn.
    """
    return np.angle(np.exp(1j * (one - other))) if name in WRAPPED else one - other


def _agree(one: Judged, other: Judged) -> bool:
    """Whether two judgements differ by no more than `STEP_ERROR`."""
    close = [
        np.allclose(
            [*mine.values()], [*theirs.values()], rtol=STEP_ERROR, atol=STEP_ERROR, equal_nan=True
        )
        for mine, theirs in ((one.mismatch, other.mismatch), (one.ratio, other.ratio))
        if mine.keys() == theirs.keys()
    ]
    return one.verdict == other.verdict and len(close) == 2 and all(close)
