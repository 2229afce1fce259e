"""The bench on which terms are swapped: one case, what differs between two models, and every choice of it replayed and judged once."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

import aerodb
import flightmech
from flightmech import Aircraft
from flightmech.aircraft.parts import different_parts, swap_parts
from flightmech.errors import SchemaError

from ..cases.case import PomCase
from ..cases.job import Job
from ..judging.verdict import judge_all
from ..replaying.kernel_replay import fly
from ..replaying.replay_case import plan_of, shown_channels
from ..replaying.trim_state import OBSERVED, beyond_limits, trim_limits
from ..result import group_verdicts, status_of
from ..tolerances.derived_channels import output_of
from .swap_table import CEILING, MATCHED
from .term_swaps import differing

_FINAL = "_of_final"


@dataclass(frozen=True)
class Judged:
    """What a choice of terms and parts from the final model makes of the a-priori one.

    Attributes
    ----------
    verdict : str
        Status of the case.
    mismatch, ratio : dict of str to float
        By judged criterion: rms of difference over half width of a time history, the ratio itself of a scalar; largest ratio. [1]
    total : float
        Root mean square of the mismatches of the groups, of each group the best alternative. [1]
    """

    verdict: str
    mismatch: dict[str, float]
    ratio: dict[str, float]
    total: float

    @property
    def matched(self) -> bool:
        """Whether the case is within tolerance, whatever its trim."""
        return self.verdict in MATCHED

    def counted(self, criteria: Iterable[str]) -> np.ndarray:
        """Return the total mismatch and that of every criterion as they count, at most `CEILING` (1 + criterion,)."""
        return np.array([np.fmin(mismatch, CEILING) for mismatch in (self.total, *(self.mismatch.get(name, CEILING) for name in criteria))])


@dataclass(frozen=True)
class Bench:
    """A case, a database that holds the differing terms of both models, and what differs: terms, then parts of the aircraft.

    The scale parameters of the terms, 0 or 1, choose among the terms of one compiled model; every choice of parts is a compiled
    model of its own.
    """

    case: PomCase
    job: Job
    flight: dict[str, np.ndarray]
    channels: frozenset[str]
    both: xr.DataTree
    aircraft: tuple[Aircraft, Aircraft]
    terms: tuple[str, ...]
    parts: tuple[str, ...]
    _sims: dict[frozenset[str], Any] = field(default_factory=dict)
    _known: dict[frozenset[str], Judged] = field(default_factory=dict)

    @classmethod
    def of(cls, case: PomCase, prior: xr.DataTree, final: xr.DataTree, aircraft: tuple[Aircraft, Aircraft], path: Any) -> Bench:
        """Return the bench of a case; `aircraft` a priori and final, `path` as in `replay`."""
        plan = plan_of(case, path)
        count, states = plan.job.time.size, plan.states.data_vars
        flight = {str(name): np.broadcast_to(item.values, count) for name, item in states.items() if item.ndim < 2}
        channels = frozenset({*flight, *shown_channels(plan.case, plan.states), *OBSERVED})
        driven = case.drive.level == "recorded"  # surfaces that are driven feel no hinge moment
        names = tuple(name for name in differing(prior, final) if not (driven and name.startswith("Ch_")))
        theirs = aerodb.terms(final)
        both = aerodb.replace_terms(prior, {name + _FINAL: theirs[name] for name in names if name in theirs})
        return cls(plan.case, plan.job, flight, channels, both, aircraft, names, _parts(case, flight, aircraft))

    @property
    def names(self) -> tuple[str, ...]:
        """Everything that can be swapped."""
        return (*self.terms, *self.parts)

    def judged(self, choices: Iterable[Collection[str]]) -> list[Judged]:
        """Return the judgement of every choice of names; those that the bench does not know yet are flown together."""
        keys = [frozenset(choice) for choice in choices]
        waiting: dict[frozenset[str], list[frozenset[str]]] = defaultdict(list)
        for key in dict.fromkeys(keys):
            if key not in self._known:
                waiting[key & frozenset(self.parts)].append(key)
        for parts, new in waiting.items():
            self._known.update(zip(new, self._flown(parts, new), strict=True))
        return [self._known[key] for key in keys]

    def _flown(self, parts: frozenset[str], choices: Sequence[frozenset[str]]) -> list[Judged]:
        """Return the judgement of choices with the same parts."""
        try:
            sim = self._sim(parts)
        except SchemaError as error:  # tables of two engines that make no engine together
            return [self._judge({name: np.full(self.job.time.size, np.nan) for name in self.flight}, str(error))] * len(choices)
        wanted = sorted({output_of(channel, sim.outputs) for channel in self.channels})
        outputs, failures = fly(sim, self.job, [self._scales(choice) for choice in choices], wanted)
        outputs |= {loop.control: outputs[f"applied.{loop.control}"] for loop in self.job.pilot if f"applied.{loop.control}" in outputs}
        return [self._judge({name: values[k] for name, values in outputs.items()}, text) for k, text in enumerate(failures)]

    def _sim(self, parts: frozenset[str]) -> Any:
        """Return the compiled model with those parts of the final aircraft."""
        if parts not in self._sims:
            chosen = [name for name in self.parts if name in parts]
            self._sims[parts] = flightmech.compile(swap_parts(*self.aircraft, chosen), self.both)
        return self._sims[parts]

    def _scales(self, names: Collection[str]) -> dict[str, float]:
        scales = {}
        for name in self.terms:
            scales[f"term.{name.replace('/', '.')}"] = 0.0 if name in names else 1.0
            scales[f"term.{name.replace('/', '.')}{_FINAL}"] = 1.0 if name in names else 0.0
        return scales

    def _judge(self, outputs: Mapping[str, np.ndarray], failure: str) -> Judged:
        mismatch: dict[str, float] = {}
        ratio: dict[str, float] = {}
        verdicts: dict[str, str] = {}
        groups: dict[str, float] = {}
        limits = trim_limits(self.case, self.flight)
        failed = bool(failure or beyond_limits(limits, outputs, demanded=True))
        exceeded = any(remark.kind == "trim" for remark in beyond_limits(limits, outputs, demanded=False))
        outcomes = judge_all(self.case, self.job.time, self.flight, outputs)
        for criterion in self.case.criteria:
            found = outcomes[criterion.name]
            verdicts[criterion.name] = "invalid" if failed and criterion.applies else found.verdict
            if found.verdict not in ("pass", "fail", "invalid"):
                continue
            ratio[criterion.name] = found.worst_ratio
            mismatch[criterion.name] = found.rms if np.isfinite(found.rms) else found.worst_ratio  # of a curve, of a number
            counted = float(np.fmin(mismatch[criterion.name], CEILING))
            groups[criterion.group] = min(groups.get(criterion.group, CEILING), counted)
        total = float(np.sqrt(np.mean(np.square(list(groups.values()))))) if groups else np.nan
        return Judged(status_of(group_verdicts(self.case, verdicts), exceeded), mismatch, ratio, total)


def _parts(case: PomCase, flight: Mapping[str, np.ndarray], aircraft: tuple[Aircraft, Aircraft]) -> tuple[str, ...]:
    """Return the parts that differ and can matter: engines that the thrust does not drive, gear that touches the ground."""
    touching = case.drive.trim == "ground" or any((flight[name] > 0.5).any() for name in flight if name.startswith("wow_"))
    felt = {"engine": case.drive.engine != "thrust", "gear": touching, "circuit": case.drive.surfaces != "recorded"}
    return tuple(name for name in different_parts(*aircraft) if felt.get(name.split("/")[0], True))
