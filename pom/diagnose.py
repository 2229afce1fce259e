"""Which terms of the final model explain the miss of the a-priori model: the term swap of LR-743, section 5.2, made systematic.

Every term that differs is put alone from the final database into the a-priori one and the case is replayed by the
kernel, with the inputs, the initial state and the trim of the case.  Then terms are added one by one, the best first,
until the case passes or nothing helps any more.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import aerodb
import flightmech
from flightmech import Aircraft

from .case import PomCase
from .drive import Job, job_of
from .flight import flight_states
from .replay import assemble
from .result import PomResult

LEAST_SHARE = 0.02  # of the gap: an addition that closes less is not worth a correction


@dataclass(frozen=True)
class _Bench:
    """A case made ready: what is needed to score a database."""

    case: PomCase
    aircraft: Aircraft
    states: xr.Dataset
    job: Job

    def fly(self, db: xr.DataTree) -> PomResult:
        """Replay the case by the kernel with a database."""
        outputs, failure = fly(flightmech.compile(self.aircraft, db), self.job)
        return assemble(self.case, self.states, self.job, {"model": outputs}, {"model": failure})


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
    except flightmech.errors.SimulationError as error:
        return {name: np.full(job.time.size, np.nan) for name in sim.outputs}, str(error)
    return {str(name): np.broadcast_to(item.values, job.time.size) for name, item in found.data_vars.items()}, ""


def diagnose(case: PomCase, prior: xr.DataTree, final: xr.DataTree, aircraft: Aircraft, path: Any = None) -> pd.DataFrame:
    """Rank the terms by how much of the miss of `prior` each closes.

    Parameters
    ----------
    case : PomCase
    prior, final : DataTree
        Two databases of one aircraft.
    aircraft : Aircraft
    path : Path of flighttest.reconstruct or Dataset (time), optional
        As in `replay`.

    Returns
    -------
    DataFrame
        Columns ``stage term closes verdict`` and, for every judged criterion, its ``miss`` (rms of difference over
        half width for a time history, the ratio itself for a scalar) and ``ratio`` (largest).  ``closes`` is the share
        of the gap between the total misses of `prior` and `final` (root mean square over the groups, of each group the
        best alternative).  Stages: ``prior`` and ``final``; ``single``, one row per term, best first; ``sequence``, the
        terms added one after the other, every row with all before it.
    """
    states = flight_states(case, path)
    bench = _Bench(case, aircraft, states, job_of(case, states))
    rows = [_Row.of("prior", "", bench.fly(prior)), _Row.of("final", "", bench.fly(final))]
    gap = rows[0].total - rows[1].total
    singles = [_Row.of("single", name, bench.fly(swap_terms(prior, final, [name]))) for name in differing(prior, final)]
    singles.sort(key=lambda row: row.total if np.isfinite(row.total) else np.inf)
    rows += singles + _sequence(bench, prior, final, rows[0], gap, [row.term for row in singles if row.total < rows[0].total])
    return pd.DataFrame([row.record(rows[0].total, gap) for row in rows])


def _sequence(bench: _Bench, prior: xr.DataTree, final: xr.DataTree, start: _Row, gap: float, candidates: list[str]) -> list[_Row]:
    """Return the greedy sequence; candidates are those that help alone, then any of them that helps together."""
    chosen: list[_Row] = []
    best = start
    while best.verdict != "pass" and candidates:
        before = [row.term for row in chosen]
        trials = [_Row.of("sequence", name, bench.fly(swap_terms(prior, final, [*before, name]))) for name in candidates]
        leading = min(trials, key=lambda row: row.total if np.isfinite(row.total) else np.inf)
        if not best.total - leading.total > LEAST_SHARE * gap:
            break
        chosen.append(leading)
        candidates = [name for name in candidates if name != leading.term]
        best = leading
    return chosen


@dataclass(frozen=True)
class _Row:
    """Score of one database: miss and ratio per criterion, and the total miss."""

    stage: str
    term: str
    verdict: str
    miss: dict[str, float]
    ratio: dict[str, float]
    total: float

    @classmethod
    def of(cls, stage: str, term: str, result: PomResult) -> _Row:
        miss, ratio, groups = {}, {}, {}
        for _, row in result.verdict.iterrows():
            if row["verdict"] not in ("pass", "fail", "invalid"):
                continue
            name = str(row["criterion"])
            ratio[name] = float(row["worst_ratio"])
            miss[name] = _rms(result, row) if row["measure"] == "trace" else ratio[name]
            groups[row["group"]] = np.fmin(groups.get(row["group"], np.nan), miss[name])
        total = float(np.sqrt(np.mean(np.square(list(groups.values()))))) if groups else np.nan
        return cls(stage, term, result.status("model"), miss, ratio, total)

    def record(self, prior: float, gap: float) -> dict[str, Any]:
        closes = (prior - self.total) / gap if gap > 0.0 else np.nan
        found: dict[str, Any] = {"stage": self.stage, "term": self.term, "closes": closes, "verdict": self.verdict}
        for name in self.miss:
            found |= {f"{name} miss": self.miss[name], f"{name} ratio": self.ratio[name]}
        return found


def _rms(result: PomResult, row: pd.Series) -> float:
    """Return the root mean square of difference over half width of a time history in its window."""
    channel = row["channel"]
    width = result.tolerance[channel].sel(time=slice(row["window_start"] - 1e-9, row["window_stop"] + 1e-9))
    error = result.signals[channel].sel(run="model") - result.signals[channel].sel(run="flight")
    return float(np.sqrt(np.mean(np.square((error / width).dropna("time").values)))) if bool(error.notnull().all()) else float("nan")


def differing(prior: xr.DataTree, final: xr.DataTree) -> list[str]:
    """Return the names of the terms that are not the same in both databases, or only in one of them."""
    ours, theirs = aerodb.terms(prior), aerodb.terms(final)
    return [name for name in {**ours, **theirs} if not _same(ours.get(name), theirs.get(name))]


def _same(a: xr.Dataset | None, b: xr.Dataset | None) -> bool:
    if a is None or b is None:
        return False
    tables = [name for name in ("value", "K1", "K2") if name in a or name in b]
    rules = [leaf.attrs.get(key) for key in ("regressors", "outside") for leaf in (a, b)]
    return rules[0] == rules[1] and rules[2] == rules[3] and all(name in a and name in b and a[name].equals(b[name]) for name in tables)


def swap_terms(prior: xr.DataTree, final: xr.DataTree, names: Iterable[str]) -> xr.DataTree:
    """Return `prior` with the named terms as they are in `final`; a term that `final` does not have is taken out."""
    names = list(names)
    theirs = aerodb.terms(final)
    swapped = aerodb.replace_terms(prior, {name: theirs[name] for name in names if name in theirs}, "term swap")
    gone = [name for name in names if name not in theirs]
    return aerodb.delete_terms(swapped, gone, "term swap") if gone else swapped


def corrected_terms(diagnoses: Iterable[pd.DataFrame]) -> list[str]:
    """Return the terms that the sequences of several diagnoses needed, in the order of the share each closes alone.

    Parameters
    ----------
    diagnoses : iterable of DataFrame
        From `diagnose`.

    Examples
    --------
    The corrected database of LR-743: ``swap_terms(prior, final, corrected_terms(diagnoses))``.
    """
    share: dict[str, float] = {}
    for table in diagnoses:
        alone = _shares(table)
        for name in table.loc[table["stage"] == "sequence", "term"]:
            share[name] = max(share.get(name, -np.inf), alone.get(name, 0.0))
    return sorted(share, key=lambda name: -share[name])


def _shares(table: pd.DataFrame) -> dict[str, float]:
    single: Sequence[tuple[str, float]] = table.loc[table["stage"] == "single", ["term", "closes"]].itertuples(index=False, name=None)
    return dict(single)
