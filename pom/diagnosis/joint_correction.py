"""The corrected model of several cases together: the terms that one case requires change another.

The union of what single cases need is judged on every case.  For one that is judged worse than with
the final model, everything else is taken from the final model too and then left out again as far as
the verdict stays, in halves and quarters, that first without which the final model suffers least
[ZellerHildebrandt2002]; what remains is added.  This repeats until every case is judged as well as
with the final model.

References
----------
.. [ZellerHildebrandt2002] A. Zeller, R. Hildebrandt, Simplifying and isolating failure-inducing input, IEEE Trans. Software Eng.
   28(2), 2002.
"""

from __future__ import annotations

import pickle
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any, cast

import pandas as pd
import xarray as xr
from joblib import Parallel, delayed, effective_n_jobs

from flightmech.aircraft.aircraft import Aircraft
from flightmech.support.kept_stages.stages import Kept, Stages
from pom.cases.case import PomCase
from pom.diagnosis.corrected_model import corrected_terms
from pom.diagnosis.diagnosis import DiagnosisRows, diagnose_bench
from pom.diagnosis.kept_diagnosis import Diagnosed, LateBench
from pom.diagnosis.screening import screen_idle_terms
from pom.diagnosis.swap_judgement import MATCHED, Judged
from pom.diagnosis.swap_models import SwapModels
from pom.diagnosis.swap_runs import SwapBench

SWAPS = "swaps"
"""Stage of what the swaps of a case gave, by their content: with another final model only those are flown that take what changed of it."""

LEAST_SHARE = 4
"""Cases that keep a process busy for some times as long as its start takes."""


def join_diagnoses(
    diagnoses: Mapping[str, pd.DataFrame],
    cases: Iterable[PomCase],
    prior: xr.DataTree,
    final: xr.DataTree,
    aircraft: Mapping[str, Aircraft],
    paths: Mapping[str, Any],
    apriori: Aircraft | None = None,
) -> dict[str, pd.DataFrame]:
    """Return diagnoses with the terms that the corrected model needs further for every case to pass
    that the final model passes.

    Parameters
    ----------
    diagnoses : mapping of str to DataFrame
        Name of the case to its table of `diagnose`.
    cases : iterable of PomCase
        Those of the diagnoses.
    prior, final : DataTree
        The databases that were diagnosed.
    aircraft : mapping of str to Aircraft
        Of the final model, by name of the case.
    paths : mapping of str to Path of flighttest.reconstruct or Dataset (time)
        By name of the case; as in `diagnose`.
    apriori : Aircraft, optional
        As in `diagnose`.

    Returns
    -------
    dict of str to DataFrame
        The tables.  That of a case for which terms were added has further rows of the stage
        ``joint``: the corrected model without them (``term`` empty), then with one after the other,
        the last row being the corrected model of all cases.

    Notes
    -----
    None of the added terms can be left out alone: a case that the final model passes would not pass.
    """
    models = swap_models(prior, final, aircraft, apriori)
    return join_tables(
        diagnoses,
        {case.name: SwapBench.of(case, models[case.name], paths.get(case.name)) for case in cases},
    )


def diagnose_all(
    cases: Sequence[PomCase],
    prior: xr.DataTree,
    final: xr.DataTree,
    aircraft: Mapping[str, Aircraft],
    paths: Mapping[str, Any],
    apriori: Aircraft | None = None,
    jobs: int = -1,
) -> dict[str, pd.DataFrame]:
    """Return the tables of `join_diagnoses` of all cases: compiled once for all, and what a
    diagnosis flew is not flown again.

    Parameters
    ----------
    cases, prior, final, aircraft, paths, apriori
        As in `join_diagnoses`.
    jobs : int
        Cases diagnosed at the same time; -1: one per processor.
    """
    at_hand = Stages()
    models = (
        at_hand.given(prior),
        at_hand.given(final),
        at_hand.given(aircraft),
        at_hand.given(apriori),
    )
    flown = {case.name: at_hand.given(paths.get(case.name)) for case in cases}
    return diagnosed_cases(cases, *models, flown, jobs, at_hand)


def diagnosed_cases(
    cases: Sequence[PomCase],
    prior: Kept[xr.DataTree],
    final: Kept[xr.DataTree],
    aircraft: Kept[Mapping[str, Aircraft]],
    apriori: Kept[Aircraft | None],
    paths: Mapping[str, Kept[Any]],
    jobs: int,
    stages: Stages,
) -> dict[str, pd.DataFrame]:
    """Return the tables of `diagnose_all`, each case a stage; what cases judge for each other is
    kept with them.
    """

    mixed = Kept(
        make=lambda: (swap_models(prior.value, final.value, aircraft.value, apriori.value),)
    )
    parcel = Kept(make=lambda: (pickle.dumps(mixed.value),))
    processes = min(effective_n_jobs(jobs), len(cases) // LEAST_SHARE)
    threads = processes < 2 and stages.local
    common = {
        "a-priori database": prior,
        "final database": final,
        "aircraft": aircraft,
        "a-priori aircraft": apriori,
    }
    inputs = {
        case.name: {"case": case, "record": paths[case.name], **common}
        for case in sorted(cases, key=_length, reverse=True)
    }
    named = {case.name: case for case in cases}
    # a swap depends on what it takes of the final model, not on the rest of it
    at_start = {"a-priori database": prior, "a-priori aircraft": apriori}
    if apriori.value is None:  # then it is that of the final model
        at_start["a-priori aircraft"] = aircraft
    swaps = {case.name: {"case": case, "record": paths[case.name], **at_start} for case in cases}
    diagnosed: list[str] = []
    made: dict[str, SwapBench] | None = {} if threads else None

    def arguments(name: str) -> tuple[Any, ...]:
        diagnosed.append(name)
        nothing: dict[str, Judged] = {}
        before = stages.recall(SWAPS, swaps[name], nothing) if stages.store is not None else None
        models = mixed.value if threads else parcel.value
        return named[name], models, paths[name].value, before, made

    found = stages.each(
        "diagnosis", inputs, _diagnosed, arguments, jobs if threads else processes, threads
    )
    for name in diagnosed:
        stages.remember(SWAPS, swaps[name], found[name].value.by_content())
    benches: dict[str, LateBench] = {}
    for case in cases:

        def make(case: PomCase = case) -> SwapBench:
            if made and case.name in made:
                return made[case.name]
            step = found[case.name].value.step
            return SwapBench.of(case, mixed.value[case.name], paths[case.name].value, step=step)

        benches[case.name] = LateBench(
            found[case.name].value, stages.recall("judgements", inputs[case.name], {}), make
        )
    before = {name: len(bench.known) for name, bench in benches.items()}
    tables = join_tables({case.name: found[case.name].value.table for case in cases}, benches, jobs)
    for name, bench in benches.items():
        if len(bench.known) > before[name]:
            stages.remember("judgements", inputs[name], bench.known)
    return tables


def _diagnosed(
    case: PomCase,
    models: Mapping[str, SwapModels] | bytes,
    path: Any,
    before: Mapping[str, Judged] | None,
    made: dict[str, SwapBench] | None,
) -> Diagnosed:
    """Return what is kept of a diagnosis; models by name of the case, as a parcel in another
    process, and what an earlier job flew (`SwapBench.before`).  In this process `made` gets the bench.
    """
    mixed = _unpacked(models) if isinstance(models, bytes) else models
    bench = SwapBench.of(case, mixed[case.name], path, before)
    if made is not None:
        made[case.name] = bench
    return Diagnosed.of(bench, diagnose_bench(bench))


def rank_all(
    cases: Sequence[PomCase],
    models: Mapping[str, SwapModels],
    paths: Mapping[str, Any],
    jobs: int = -1,
    **options: Any,
) -> dict[str, tuple[SwapBench, pd.DataFrame]]:
    """Return the bench of every case and its table of `diagnose_bench`, by name of the case.

    Parameters
    ----------
    cases, paths, jobs
        As in `diagnose_all`.  Processes share the work where each has `LEAST_SHARE` cases at least,
        else threads do.
    models : mapping of str to SwapModels
        By name of the case.
    **options
        Of `diagnose_bench`.
    """

    order = sorted(cases, key=_length, reverse=True)
    workers = effective_n_jobs(jobs)
    if (processes := min(workers, len(cases) // LEAST_SHARE)) > 1:
        parcel = pickle.dumps(models)
        calls = (
            delayed(_ranked_elsewhere)(case, parcel, paths.get(case.name), options)
            for case in order
        )
        found = Parallel(n_jobs=processes, batch_size=1, pre_dispatch="all")(calls)
        for case, (bench, _) in zip(order, found, strict=True):
            bench.models = models[case.name]
    else:
        calls = (
            delayed(_ranked)(case, models[case.name], paths.get(case.name), options)
            for case in order
        )
        found = Parallel(n_jobs=min(workers, len(cases)) or 1, backend="threading", batch_size=1)(
            calls
        )
    by_name = {case.name: one for case, one in zip(order, found, strict=True)}
    return {case.name: by_name[case.name] for case in cases}


def _ranked(
    case: PomCase, models: SwapModels, path: Any, options: Mapping[str, Any]
) -> tuple[SwapBench, pd.DataFrame]:
    bench = SwapBench.of(case, models, path)
    return bench, diagnose_bench(bench, **options)


def _ranked_elsewhere(
    case: PomCase, parcel: bytes, path: Any, options: Mapping[str, Any]
) -> tuple[SwapBench, pd.DataFrame]:
    """Return the same in another process, but the bench without its models: what is compiled stays
    there.
    """
    bench, table = _ranked(case, _unpacked(parcel)[case.name], path, options)
    bench.models = cast(SwapModels, None)
    return bench, table


@lru_cache(maxsize=1)
def _unpacked(parcel: bytes) -> dict[str, SwapModels]:
    """Return the models of all cases, once in a process, so that each is compiled once there."""
    return pickle.loads(parcel)


def _length(case: PomCase) -> float:
    """Return roughly how long a case takes to fly, so that none of the longest starts last."""
    slow = (
        case.drive.surfaces != "recorded" or case.drive.trim == "ground"
    )  # circuits that move, legs on the ground
    return (case.window[1] - case.window[0]) * (5.0 if slow else 1.0)


def swap_models(
    prior: xr.DataTree,
    final: xr.DataTree,
    aircraft: Mapping[str, Aircraft],
    apriori: Aircraft | None = None,
) -> dict[str, SwapModels]:
    """Return the mixtures of both models by name of the case; cases of one aircraft share theirs."""
    made = {
        key: SwapModels.of(prior, final, (apriori or one, one))
        for key, one in {id(one): one for one in aircraft.values()}.items()
    }
    return {name: made[id(one)] for name, one in aircraft.items()}


def join_tables(
    diagnoses: Mapping[str, pd.DataFrame],
    benches: Mapping[str, SwapBench | LateBench],
    jobs: int = 1,
) -> dict[str, pd.DataFrame]:
    """Return the tables of `join_diagnoses` of benches by name of the case; what all of them fly
    they fly at the same time in threads.
    """
    reached = {
        name: bench for name, bench in benches.items() if _verdict(bench, bench.names) in MATCHED
    }
    union = corrected_terms(diagnoses.values())
    added = _added(reached, union, jobs)
    everything = {*union, *(name for names in added.values() for name in names)}
    return {
        name: _with_rows(table, benches[name], everything, added.get(name, []))
        for name, table in diagnoses.items()
    }


def _added(
    benches: Mapping[str, SwapBench | LateBench], union: Sequence[str], jobs: int
) -> dict[str, list[str]]:
    """Return what is added to the union, by a case that needs it; only cases that need something."""

    taken, added = set(union), dict[str, str]()  # term: case
    failing = True
    while failing:
        failing = False
        # as if nothing were added: a bench keeps what it has flown
        Parallel(n_jobs=jobs, backend="threading")(
            delayed(_verdict)(bench, frozenset(taken)) for bench in benches.values()
        )
        for name, bench in benches.items():
            if not _as_good(bench, taken):
                further = _least(bench, taken)
                added |= dict.fromkeys(further, name)
                taken.update(further)
                failing = True  # what passed before may be changed by what was added

    def needing(term: str) -> str | None:
        """Return a case that needs a term; first that for which it was added."""
        names = [added[term], *benches]
        return next((name for name in names if not _as_good(benches[name], taken - {term})), None)

    for term in reversed(list(added)):
        if needing(term) is None:
            taken.remove(term)
            del added[term]
    found: dict[str, list[str]] = {}
    for term in added:
        found.setdefault(needing(term) or added[term], []).append(term)
    return found


def _verdict(bench: SwapBench | LateBench, names: Collection[str]) -> str:
    """Return the verdict with these terms and parts of the final model, as far as the case feels
    them.
    """
    (found,) = bench.judged([[name for name in bench.names if name in names]], exact=True)
    return found.verdict


def _as_good(bench: SwapBench | LateBench, names: Collection[str]) -> bool:
    """Whether the case is judged as well as with the whole final model."""
    return _verdict(bench, names) in ("pass", _verdict(bench, bench.names))


def _least(bench: SwapBench | LateBench, taken: Collection[str]) -> list[str]:
    """Return names, next to those taken, of which none can be left out."""
    free = [name for name in bench.names if name not in taken]
    screen_idle_terms(bench.whole)
    without = bench.judged([[other for other in bench.names if other != name] for name in free])
    loss = {
        name: (not found.matched, found.total) for name, found in zip(free, without, strict=True)
    }
    kept = sorted(free, key=lambda name: loss[name])
    waiting = [kept]
    while waiting:
        part = waiting.pop()
        rest = [name for name in kept if name not in part]
        if _as_good(bench, {*taken, *rest}):
            kept = rest
        elif len(part) > 1:
            half = len(part) // 2
            waiting += [part[half:], part[:half]]
    return kept


def _with_rows(
    table: pd.DataFrame,
    bench: SwapBench | LateBench,
    everything: Collection[str],
    added: Sequence[str],
) -> pd.DataFrame:
    """Return a diagnosis with the rows of the stage ``joint``."""
    if not added:
        return table
    base = [name for name in bench.names if name in everything and name not in added]
    start, end, *found = bench.judged(
        [(), bench.names, *([*base, *added[:k]] for k in range(len(added) + 1))], exact=True
    )
    rows = DiagnosisRows(start, end)
    for name, one in zip(["", *added], found, strict=True):
        rows.add("joint", name, one)
    return pd.concat([table, pd.DataFrame(rows.rows)], ignore_index=True)
