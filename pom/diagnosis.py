"""Which terms of the final model explain the miss of the a-priori model: the term swap of LR-743, section 5.2, made systematic.

Every term that differs is put alone from the final database into the a-priori one and the case is replayed by the
kernel, with the inputs, the initial state and the trim of the case.  Then terms are added one by one, the best first,
until the case passes or nothing helps any more.

One compiled model holds the differing terms of both databases; the scale parameters of the terms, 0 or 1, choose.  Parts of the
aircraft that differ (`flightmech.parts`: tables of the engines, legs of the gear ...) are exchanged in the same way, by a
compiled model for every choice of parts.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import aerodb
import flightmech
from flightmech import Aircraft
from flightmech.errors import SimulationError
from flightmech.parts import different_parts, swap_parts

from .case import PomCase
from .drive import Job, job_of
from .flight import flight_states
from .result import group_verdicts, status_of
from .tolerance import difference, half_width
from .verdict import judge

LEAST_SHARE = 0.02  # of the gap: an addition that closes less is not worth a correction
CANDIDATES = 16  # single swaps that change most, for better or worse: they are tried again in every round of the sequence
CEILING = 10.0  # miss of a criterion that fails without a number, such as a mode that is not there; no miss counts more
_FINAL = "_of_final"


def diagnose(
    case: PomCase, prior: xr.DataTree, final: xr.DataTree, aircraft: Aircraft, path: Any = None, apriori: Aircraft | None = None
) -> pd.DataFrame:
    """Rank the terms, and the parts of the aircraft, by how much of the miss of `prior` each closes.

    Parameters
    ----------
    case : PomCase
    prior, final : DataTree
        Two databases of one aircraft.
    aircraft : Aircraft
        Of the final model.
    path : Path of flighttest.reconstruct or Dataset (time), optional
        As in `replay`.
    apriori : Aircraft, optional
        Of the a-priori model, when its engines, gear or control circuits are others.

    Returns
    -------
    DataFrame
        Columns ``stage term closes verdict`` and, for every judged criterion, its ``miss`` (rms of difference over
        half width for a time history, the ratio itself for a scalar) and ``ratio`` (largest).  ``closes`` is the share
        of the gap between the total misses of `prior` and `final` (root mean square over the groups, of each group the
        best alternative, at most `CEILING`); NaN when `final` is no better.  Stages: ``prior`` and ``final``; ``single``, one row per
        term, best first; ``sequence``, terms added one after the other, each row with all before it.
    """
    bench = _Bench.of(case, prior, final, (apriori or aircraft, aircraft), path)
    start, end = bench.score("prior", ""), bench.score("final", "", [*bench.terms, *bench.parts])
    gap = start.total - end.total
    singles = sorted((bench.score("single", name, [name]) for name in (*bench.terms, *bench.parts)), key=_total)
    felt = sorted(singles, key=lambda row: -abs(_total(row) - start.total))[:CANDIDATES]
    rows = [start, end, *singles, *_sequence(bench, start, gap, [row.term for row in felt])]
    return pd.DataFrame([row.record(start.total, gap) for row in rows])


@dataclass(frozen=True)
class _Score:
    """A choice of terms: miss and ratio per criterion, and the total miss."""

    stage: str
    term: str
    verdict: str
    miss: dict[str, float]
    ratio: dict[str, float]
    total: float

    def record(self, prior: float, gap: float) -> dict[str, Any]:
        closes = (prior - self.total) / gap if gap > 0.0 else np.nan
        found: dict[str, Any] = {"stage": self.stage, "term": self.term, "closes": closes, "verdict": self.verdict}
        for name in self.miss:
            found |= {f"{name} miss": self.miss[name], f"{name} ratio": self.ratio[name]}
        return found


def _total(score: _Score) -> float:
    return score.total if np.isfinite(score.total) else np.inf


def _sequence(bench: _Bench, start: _Score, gap: float, candidates: list[str]) -> list[_Score]:
    """Return the greedy sequence, cut where it is best, without the terms that turned out not to be needed.

    An addition that does not help by itself is taken all the same when nothing better is there, because the next may need it;
    what is gained has to be worth `LEAST_SHARE` of the gap for every term in the end.
    """
    if start.verdict == "pass" or not gap > 0.0:
        return []
    names: list[str] = []
    path = [start]
    while path[-1].verdict != "pass" and len(names) < len(candidates):
        trials = [bench.score("sequence", name, [*names, name]) for name in candidates if name not in names]
        path.append(min(trials, key=_total))
        names.append(path[-1].term)
    best = min(range(len(path)), key=lambda k: (path[k].verdict != "pass", path[k].total))
    needed, reached = names[:best], path[best]
    for name in reversed(names[:best]):
        without = bench.score("sequence", name, [other for other in needed if other != name])
        if (without.verdict == "pass") >= (reached.verdict == "pass") and without.total - reached.total < LEAST_SHARE * gap:
            needed.remove(name)
    return [bench.score("sequence", name, needed[: k + 1]) for k, name in enumerate(needed)]


@dataclass(frozen=True)
class _Bench:
    """A case, a database that holds the differing terms of both, and what differs: terms, then parts of the aircraft."""

    case: PomCase
    job: Job
    flight: dict[str, np.ndarray]
    both: xr.DataTree
    aircraft: tuple[Aircraft, Aircraft]
    terms: tuple[str, ...]
    parts: tuple[str, ...]
    sims: dict[frozenset[str], Any] = field(default_factory=dict)

    @classmethod
    def of(cls, case: PomCase, prior: xr.DataTree, final: xr.DataTree, aircraft: tuple[Aircraft, Aircraft], path: Any) -> _Bench:
        states = flight_states(case, path)
        job = job_of(case, states)
        flight = {str(name): np.broadcast_to(item.values, job.time.size) for name, item in states.data_vars.items() if item.ndim < 2}
        names = tuple(differing(prior, final))
        theirs = aerodb.terms(final)
        both = aerodb.replace_terms(prior, {name + _FINAL: theirs[name] for name in names if name in theirs})
        return cls(case, job, flight, both, aircraft, names, _parts(case, flight, aircraft))

    def sim(self, names: Collection[str]) -> Any:
        """Return the compiled model with those of the named parts that are of the final aircraft."""
        chosen = frozenset(names) & frozenset(self.parts)
        if chosen not in self.sims:
            prior, final = self.aircraft
            self.sims[chosen] = flightmech.compile(swap_parts(prior, final, [name for name in self.parts if name in chosen]), self.both)
        return self.sims[chosen]

    def score(self, stage: str, term: str, names: Collection[str] = ()) -> _Score:
        """Replay with the terms and parts `names` taken from the final model and judge."""
        outputs, failure = fly(self.sim(names), replace(self.job, parameters={**self.job.parameters, **self._scales(names)}))
        miss: dict[str, float] = {}
        ratio: dict[str, float] = {}
        verdicts: dict[str, str] = {}
        groups: dict[str, float] = {}
        for criterion in self.case.criteria:
            found = judge(self.case, criterion, self.job.time, self.flight, outputs)
            verdicts[criterion.name] = "invalid" if failure and criterion.applies else found.verdict
            if found.verdict not in ("pass", "fail", "invalid"):
                continue
            ratio[criterion.name] = miss[criterion.name] = found.worst_ratio
            if criterion.measure == "trace":
                miss[criterion.name] = self._rms(criterion, outputs)
            counted = float(np.fmin(miss[criterion.name], CEILING))
            groups[criterion.group] = min(groups.get(criterion.group, CEILING), counted)
        total = float(np.sqrt(np.mean(np.square(list(groups.values()))))) if groups else np.nan
        return _Score(stage, term, status_of(group_verdicts(self.case, verdicts)), miss, ratio, total)

    def _scales(self, names: Collection[str]) -> dict[str, float]:
        scales = {}
        for name in self.terms:
            scales[f"term.{name.replace('/', '.')}"] = 0.0 if name in names else 1.0
            scales[f"term.{name.replace('/', '.')}{_FINAL}"] = 1.0 if name in names else 0.0
        return scales

    def _rms(self, criterion, outputs: dict[str, np.ndarray]) -> float:
        """Return the root mean square of difference over half width in the window."""
        time = self.job.time
        mask = (time >= criterion.window[0] - 1e-9) & (time <= criterion.window[1] + 1e-9)
        flight, model = self.flight[criterion.channel][mask], outputs[criterion.channel][mask]
        return float(np.sqrt(np.mean(np.square(difference(criterion.channel, flight, model) / half_width(criterion, flight)))))


def _parts(case: PomCase, flight: Mapping[str, np.ndarray], aircraft: tuple[Aircraft, Aircraft]) -> tuple[str, ...]:
    """Return the parts that differ and can matter: engines that the thrust does not drive, gear that touches the ground."""
    touching = case.drive.trim == "ground" or any((flight[name] > 0.5).any() for name in flight if name.startswith("wow_"))
    felt = {"engine": case.drive.engine != "thrust", "gear": touching, "circuit": case.drive.surfaces != "recorded"}
    return tuple(name for name in different_parts(*aircraft) if felt.get(name.split("/")[0], True))


def fly(sim: Any, job: Job) -> tuple[dict[str, np.ndarray], str]:
    """Replay a job by the kernel itself.

    Parameters
    ----------
    sim : SimModel
        From `flightmech.compile`.
    job : Job

    Returns
    -------
    outputs : dict of str to array (time,)
    failure : str
        Empty when the run went to its end.
    """
    inputs = {name: ("time", values) for name, values in job.inputs.items() if name in sim.inputs}
    parameters = {name: value for name, value in job.parameters.items() if name in sim.parameters}
    try:
        found = flightmech.simulate(sim, xr.Dataset(inputs, coords={"time": job.time}), parameters)
    except SimulationError as error:
        return {name: np.full(job.time.size, np.nan) for name in sim.outputs}, str(error)
    return {str(name): item.values for name, item in found.data_vars.items()}, ""


def differing(prior: xr.DataTree, final: xr.DataTree) -> list[str]:
    """Return the names of the terms that are not the same in both databases, or only in one of them."""
    ours, theirs = aerodb.terms(prior), aerodb.terms(final)
    return [name for name in {**ours, **theirs} if not _same(ours.get(name), theirs.get(name))]


def _same(a: xr.Dataset | None, b: xr.Dataset | None) -> bool:
    if a is None or b is None:
        return False
    tables = [name for name in ("value", "K1", "K2") if name in a or name in b]
    rules = all(a.attrs.get(key) == b.attrs.get(key) for key in ("regressors", "outside", "power", "exponent", "floor"))
    return rules and all(name in a and name in b and a[name].equals(b[name]) for name in tables)


def swap_terms(prior: xr.DataTree, final: xr.DataTree, names: Iterable[str]) -> xr.DataTree:
    """Return `prior` with the named terms as they are in `final`; a term that `final` does not have is taken out.

    Names that are terms of neither, such as parts of the aircraft, are passed over.
    """
    theirs, ours = aerodb.terms(final), aerodb.terms(prior)
    names = [name for name in names if name in theirs or name in ours]
    swapped = aerodb.replace_terms(prior, {name: theirs[name] for name in names if name in theirs}, "term swap")
    gone = [name for name in names if name not in theirs]
    return aerodb.delete_terms(swapped, gone, "term swap") if gone else swapped


def corrected_terms(diagnoses: Iterable[pd.DataFrame]) -> list[str]:
    """Return the terms and parts that the sequences of several diagnoses needed, in the order of the share each closes alone.

    Parameters
    ----------
    diagnoses : iterable of DataFrame
        From `diagnose`.

    Notes
    -----
    The corrected database of LR-743 is ``swap_terms(prior, final, corrected_terms(diagnoses))``, its aircraft
    ``flightmech.swap_parts`` with the same names; each takes what is its own.
    """
    share: dict[str, float] = {}
    for table in diagnoses:
        single = table[table["stage"] == "single"]
        alone = dict(zip(single["term"], single["closes"], strict=True))
        for name in table.loc[table["stage"] == "sequence", "term"]:
            share[name] = max(share.get(name, -np.inf), alone[name])
    return sorted(share, key=lambda name: -share[name])
