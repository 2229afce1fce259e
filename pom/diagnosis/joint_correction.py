"""Diagnoses of several cases, in threads or processes, with their joint correction and ranking."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, cast

import pandas as pd
import xarray as xr
from joblib import Parallel, delayed, effective_n_jobs

from flightmech.aircraft.aircraft import Aircraft
from flightmech.support.kept_stages.sharing import process_pool
from flightmech.support.kept_stages.stages import Kept, Stages
from pom.cases.case import PomCase
from pom.diagnosis.culprits.project_ranking import ProjectRanking, rank_project
from pom.diagnosis.diagnosis import diagnose_bench
from pom.diagnosis.joint_search import join_tables
from pom.diagnosis.kept_diagnosis import Diagnosed, Known, LateBench
from pom.diagnosis.swap_judgement import Judged
from pom.diagnosis.swap_models import SwapModels
from pom.diagnosis.swap_runs import SwapBench

SWAPS = "swaps"
"""Stage of the judgements of a case by their content.

With another final model only those swaps are flown whose content changed.
"""

LEAST_SHARE = 4
"""Fewest cases of a process; they take some times as long as its start."""

# A case that is slow to fly takes so many times as long: circuits that move, legs on the ground.
_SLOW_FACTOR = 5.0


@dataclass(frozen=True)
class ProjectDiagnosis:
    """Diagnosis of all cases of a project.

    Attributes
    ----------
    tables : dict of str to DataFrame
        By name of the case, as `join_diagnoses` returns them.
    ranking : ProjectRanking or None
        The terms ranked over all cases; None without a case.
    """

    tables: dict[str, pd.DataFrame]
    ranking: ProjectRanking | None


def join_diagnoses(
    diagnoses: Mapping[str, pd.DataFrame],
    cases: Iterable[PomCase],
    prior: xr.DataTree,
    final: xr.DataTree,
    aircraft: Mapping[str, Aircraft],
    paths: Mapping[str, Any],
    apriori: Aircraft | None = None,
) -> dict[str, pd.DataFrame]:
    """Return diagnoses with the further terms that the corrected model needs.

    With these terms every case passes that the final model passes.

    Parameters
    ----------
    diagnoses : mapping of str to DataFrame
        Name of the case to its table of `diagnose`.
    cases : iterable of PomCase
        The cases of the diagnoses.
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
        The tables. A case for which terms were added has further rows of the stage ``joint``: the
        corrected model without them (``term`` empty), then with one after the other. The last row
        is the corrected model of all cases.

    Notes
    -----
    None of the added terms can be left out: a case that the final model passes would not pass.
    """
    models = swap_models(prior, final, aircraft, apriori)
    benches = {}
    for case in cases:
        benches[case.name] = SwapBench.of(case, models[case.name], paths.get(case.name))
    return join_tables(diagnoses, benches)


def diagnose_all(
    cases: Sequence[PomCase],
    prior: xr.DataTree,
    final: xr.DataTree,
    aircraft: Mapping[str, Aircraft],
    paths: Mapping[str, Any],
    apriori: Aircraft | None = None,
    jobs: int = -1,
) -> dict[str, pd.DataFrame]:
    """Return the tables of `join_diagnoses` of all cases.

    The models are compiled once for all cases, and no run of a diagnosis is flown again.

    Parameters
    ----------
    cases, prior, final, aircraft, paths, apriori
        As in `join_diagnoses`.
    jobs : int
        Cases diagnosed at the same time; -1: one per processor.
    """
    stages = Stages()
    return diagnose_project(
        cases,
        stages.given(prior),
        stages.given(final),
        aircraft=stages.given(aircraft),
        apriori=stages.given(apriori),
        paths={case.name: stages.given(paths.get(case.name)) for case in cases},
        jobs=jobs,
        stages=stages,
        ranked=False,
    ).tables


def diagnose_project(
    cases: Sequence[PomCase],
    prior: Kept[xr.DataTree],
    final: Kept[xr.DataTree],
    *,
    aircraft: Kept[Mapping[str, Aircraft]],
    apriori: Kept[Aircraft | None],
    paths: Mapping[str, Kept[Any]],
    jobs: int,
    stages: Stages,
    ranked: bool = True,
) -> ProjectDiagnosis:
    """Return the tables of `diagnose_all` and the ranking of the terms; each case is a stage.

    The judgements of a case for the joint correction and the ranking are stored as well. The
    evidence of the ranking is the final database, whose nodes from flight have standard errors.
    """
    inputs = _StageInputs(cases, prior, final, aircraft=aircraft, apriori=apriori, paths=paths)
    mixed = Kept(
        make=lambda: (swap_models(prior.value, final.value, aircraft.value, apriori.value),)
    )
    # Each process gets the pickled models once, and compiles them once.
    parcel = Kept(make=lambda: (pickle.dumps(mixed.value),))
    processes = min(effective_n_jobs(jobs), len(cases) // LEAST_SHARE)
    in_threads = processes < 2 and stages.local
    workers = jobs if in_threads else processes
    cases_by_name = {case.name: case for case in cases}
    diagnosed: list[str] = []
    # Threads share the benches with the joint correction. Other processes do not return them.
    benches: dict[str, SwapBench] | None = {} if in_threads else None

    def arguments(name: str) -> tuple[Any, ...]:
        diagnosed.append(name)
        earlier: dict[str, Judged] | None = None
        if stages.store is not None:
            earlier = stages.recall(SWAPS, inputs.swaps[name], {})
        models = mixed.value if in_threads else parcel.value
        return cases_by_name[name], models, paths[name].value, earlier, benches

    results = stages.each(
        "diagnosis",
        inputs.diagnoses,
        _diagnose_case,
        arguments=arguments,
        jobs=workers,
        threads=in_threads,
    )
    # The judgements of the new diagnoses serve jobs with another final model.
    for name in diagnosed:
        stages.remember(SWAPS, inputs.swaps[name], results[name].value.by_content())

    late_benches: dict[str, LateBench] = {}

    def search(method: Callable[[Mapping[str, LateBench]], Any]) -> Any:
        """Return the result of a search over all cases, and store the choices that it flew."""
        if not late_benches:
            for case in cases:
                result = results[case.name].value
                judgements: Known = stages.recall("judgements", inputs.diagnoses[case.name], {})
                make = partial(
                    _make_bench, case, benches, result, mixed=mixed, path=paths[case.name]
                )
                late_benches[case.name] = LateBench(result, judgements, make)
        counts = {name: len(bench.known) for name, bench in late_benches.items()}
        found = method(late_benches)
        # A bench has more judgements afterwards if the search had to fly new choices.
        for name, bench in late_benches.items():
            if len(bench.known) > counts[name]:
                stages.remember("judgements", inputs.diagnoses[name], bench.known)
        return found

    def join() -> dict[str, pd.DataFrame]:
        tables = {case.name: results[case.name].value.table for case in cases}
        return search(lambda late: join_tables(tables, late, jobs))

    def rank() -> ProjectRanking:
        return search(lambda late: rank_project(late, final.value, jobs))

    # The searches fly further choices, so that their inputs are those of all diagnoses.
    joint_inputs = {"cases": inputs.diagnoses, "diagnoses": results}
    tables = stages.one("joint correction", joint_inputs, join).value
    ranking: ProjectRanking | None = None
    if ranked and cases:
        ranking = stages.one("ranking over all cases", joint_inputs, rank).value
    return ProjectDiagnosis(tables, ranking)


class _StageInputs:
    """Inputs of the stages of a diagnosis, by name of the case.

    Attributes
    ----------
    diagnoses : dict of str to dict
        Inputs of the diagnoses, the longest case first.
    swaps : dict of str to dict
        Inputs of the judgements by content. A swap depends on the swapped terms of the final model,
        which are its content, and not on the other terms of that model.
    """

    def __init__(
        self,
        cases: Sequence[PomCase],
        prior: Kept[xr.DataTree],
        final: Kept[xr.DataTree],
        *,
        aircraft: Kept[Mapping[str, Aircraft]],
        apriori: Kept[Aircraft | None],
        paths: Mapping[str, Kept[Any]],
    ):
        models = {
            "a-priori database": prior,
            "final database": final,
            "aircraft": aircraft,
            "a-priori aircraft": apriori,
        }
        # Without an a-priori aircraft it is the final one.
        start_aircraft: Kept[Any] = apriori
        if apriori.value is None:
            start_aircraft = aircraft
        start = {"a-priori database": prior, "a-priori aircraft": start_aircraft}
        self.diagnoses: dict[str, dict[str, Any]] = {}
        self.swaps: dict[str, dict[str, Any]] = {}
        for case in sorted(cases, key=_estimate_duration, reverse=True):
            used = {
                "case": case.without_texts(),
                "files of the case": case.contents(),
                "record": paths[case.name],
            }
            self.diagnoses[case.name] = used | models
            self.swaps[case.name] = used | start


def _make_bench(
    case: PomCase,
    benches: Mapping[str, SwapBench] | None,
    result: Diagnosed,
    *,
    mixed: Kept[dict[str, SwapModels]],
    path: Kept[Any],
) -> SwapBench:
    """Return the bench of a diagnosed case: the bench of its diagnosis, if it is in memory."""
    if benches and case.name in benches:
        return benches[case.name]
    return SwapBench.of(case, mixed.value[case.name], path.value, step=result.step)


def _diagnose_case(
    case: PomCase,
    models: Mapping[str, SwapModels] | bytes,
    path: Any,
    before: Mapping[str, Judged] | None,
    benches: dict[str, SwapBench] | None,
) -> Diagnosed:
    """Return the stored part of a diagnosis.

    `models` are by name of the case, pickled for another process. `before` has the judgements of
    an earlier job (`SwapBench.before`). The bench is added to `benches`.
    """
    if isinstance(models, bytes):
        models = _unpickle_models(models)
    bench = SwapBench.of(case, models[case.name], path, before)
    if benches is not None:
        benches[case.name] = bench
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
        As in `diagnose_all`. Processes share the work if each has at least `LEAST_SHARE` cases,
        else threads do.
    models : mapping of str to SwapModels
        By name of the case.
    **options
        Of `diagnose_bench`.
    """
    order = sorted(cases, key=_estimate_duration, reverse=True)
    workers = effective_n_jobs(jobs)
    processes = min(workers, len(cases) // LEAST_SHARE)
    calls = []
    if processes > 1:
        parcel = pickle.dumps(models)
        for case in order:
            calls.append(delayed(_rank_in_process)(case, parcel, paths.get(case.name), options))
        ranked = process_pool(processes, batch_size=1, pre_dispatch="all")(calls)
        # Compiled models stay in their process, so the benches get the models of this process.
        for case, (bench, _) in zip(order, ranked, strict=True):
            bench.models = models[case.name]
    else:
        for case in order:
            calls.append(delayed(_rank)(case, models[case.name], paths.get(case.name), options))
        threads = min(workers, len(cases)) or 1
        ranked = Parallel(n_jobs=threads, backend="threading", batch_size=1)(calls)
    by_name = {case.name: result for case, result in zip(order, ranked, strict=True)}
    return {case.name: by_name[case.name] for case in cases}


def _rank(
    case: PomCase, models: SwapModels, path: Any, options: Mapping[str, Any]
) -> tuple[SwapBench, pd.DataFrame]:
    bench = SwapBench.of(case, models, path)
    return bench, diagnose_bench(bench, **options)


def _rank_in_process(
    case: PomCase, parcel: bytes, path: Any, options: Mapping[str, Any]
) -> tuple[SwapBench, pd.DataFrame]:
    """Return the same as `_rank`, but the bench has no models."""
    bench, table = _rank(case, _unpickle_models(parcel)[case.name], path, options)
    bench.models = cast(SwapModels, None)
    return bench, table


@lru_cache(maxsize=1)
def _unpickle_models(parcel: bytes) -> dict[str, SwapModels]:
    """Return the models of all cases, unpickled and so compiled once in a process."""
    return pickle.loads(parcel)


def _estimate_duration(case: PomCase) -> float:
    """Return the approximate time to fly a case; the longest cases start first."""
    duration = case.window[1] - case.window[0]
    if case.drive.surfaces != "recorded" or case.drive.trim == "ground":
        return _SLOW_FACTOR * duration
    return duration


def swap_models(
    prior: xr.DataTree,
    final: xr.DataTree,
    aircraft: Mapping[str, Aircraft],
    apriori: Aircraft | None = None,
) -> dict[str, SwapModels]:
    """Return the mixtures of both models by name of the case; cases of one aircraft share them."""
    by_aircraft: dict[int, SwapModels] = {}
    models = {}
    for name, craft in aircraft.items():
        # Aircraft are compared by identity: a comparison of their tables would take long.
        if id(craft) not in by_aircraft:
            by_aircraft[id(craft)] = SwapModels.of(prior, final, (apriori or craft, craft))
        models[name] = by_aircraft[id(craft)]
    return models
