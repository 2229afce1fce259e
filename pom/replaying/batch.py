"""A batch of cases: replay of every case by every model, in parallel and with stored results.

Threads share the cases, because the runs of FMUs are separate processes. Many cases are shared by
processes, and each process loads its FMUs. With a scheduler the workers of a dask.distributed
cluster take the calls. They must see the same files. If a worker dies, another worker repeats its
case.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import xarray as xr
from joblib import Parallel, delayed

from flightmech.support.kept_stages.content_hashes import content_hash
from flightmech.support.kept_stages.program import hash_installation
from flightmech.support.kept_stages.sharing import open_cluster
from pom.cases.case import PomCase
from pom.cases.fact_agreement import demand_agreement
from pom.fmu.models import FmuModel, Models
from pom.fmu.run_cache import KeptFlights, RunCache
from pom.judging.measures.modal import mode_table
from pom.probing.aircraft_identity import demand_own_evidence
from pom.replaying.batch_plans import check_plans, make_plans, path_of_case
from pom.replaying.caches import KeptResults, KeptStates, ResultKeys
from pom.replaying.recorded_runs import RecordedRuns, add_recorded_runs
from pom.replaying.replay_case import ReplayPlan, perform_plan
from pom.replaying.worker_processes import Processes, start_processes
from pom.result import PomResult

_Item = TypeVar("_Item")


@dataclass(frozen=True)
class BatchExecution:
    """Settings for the execution of a batch; no result depends on them.

    Attributes
    ----------
    jobs : int
        Cases at the same time, and processes for records that are reconstructed; -1 for one per
        core.
    scheduler : str or None
        Address of a dask.distributed scheduler, ``tcp://host:8786``; its workers take the place of
        `jobs`.
    resume : path or None
        Folder of stored flights, reconstructed records and results. Only flights without failure
        are stored. The key of a flight is the hash of the FMU, its input and the program. The key
        of a result covers all its inputs (`pom.replaying.caches`). Stored items are neither flown
        nor judged again.
    flights : KeptFlights or None
        Store of flights alone, without `resume`. Workers of a cluster do not have it.
    timeout : float
        Wall time allowed per model and case. [s]
    progress : callable or None
        Called with every result in the order of the cases.
    """

    jobs: int = -1
    scheduler: str | None = None
    resume: str | Path | None = None
    flights: KeptFlights | None = None
    timeout: float = 60.0
    progress: Callable[[PomResult], None] | None = None

    @property
    def folder(self) -> Path | None:
        """Absolute path of `resume`, since workers may run in another folder."""
        if self.resume is None:
            return None
        return Path(self.resume).resolve()

    @property
    def flight_store(self) -> KeptFlights | None:
        """Store of flights: the folder, else `flights`."""
        if self.folder is None:
            return self.flights
        return RunCache(self.folder)


def replay_all(
    cases: Sequence[PomCase],
    runs: Mapping[str, str | Path],
    paths: Mapping[str, Any] | None = None,
    *,
    names: Mapping[str, str | Path] | None = None,
    biases: xr.Dataset | None = None,
    evidence: xr.DataTree | None = None,
    recorded: Mapping[str, RecordedRuns] | None = None,
    **execution: Any,
) -> list[PomResult]:
    """Replay every case by every model and judge it.

    Parameters
    ----------
    cases : sequence of PomCase
    runs : mapping of str to path
        Name of a model to its FMU, in the order of the report.
    paths : mapping of str to Path of flighttest.reconstruct or Dataset (time), optional
        Reconstructed paths by the file of the record or its stem. A record without a path is read.
        A raw record is reconstructed.
    names : mapping of str to path, optional
        Name of a model to the table of its names (`replay`).
    biases : Dataset, optional
        Constants of the instruments for records that are reconstructed (`recorded_states`).
    evidence : DataTree, optional
        Database identified from flight (`replay`).
    recorded : mapping of str to RecordedRuns, optional
        By name of a case: recordings of devices, and master runs (`pom.replaying.recorded_runs`).
    **execution
        Attributes of `BatchExecution`: ``jobs``, ``scheduler``, ``resume``, ``flights``,
        ``timeout`` and ``progress``.

    Returns
    -------
    list of PomResult
        In the order of the cases; the same to the last bit for any execution.

    Raises
    ------
    SchemaError
        A model cannot fly a case. All such cases are reported before the first run.  Or the
        evidence is of another aeroplane.
    OutOfRange
        A window is not inside its record, or an input holds a NaN.
    SimulationError
        No scheduler or no worker responds, a worker has another program, the workers of one case
        died repeatedly, or the scheduler ended.
    TypeError
        `execution` has a name that is not an attribute of `BatchExecution`.
    """
    settings = BatchExecution(**execution)
    models, paths = Models(runs, names), paths or {}
    # Report a wrong name table before records are reconstructed, which takes long.
    demand_agreement(cases)
    demand_own_evidence(evidence, cases)
    for case in cases:
        models.of(case)
    records, store = KeptStates(settings.folder, biases), KeptResults(settings.folder)
    result_keys, keys = _make_keys(cases, paths, models=models, records=records, evidence=evidence)
    for k, case in enumerate(cases):
        recordings = (recorded or {}).get(case.name)
        if recordings is not None and keys[k]:
            keys[k] = content_hash(keys[k], recordings)
    stored = [store.read(key) for key in keys]
    new = [k for k, result in enumerate(stored) if result is None]
    jobs = settings.jobs
    if settings.scheduler:
        jobs = 1
    with start_processes(len(new), jobs) as pool:
        plans = make_plans([cases[k] for k in new], paths, records, jobs=settings.jobs, pool=pool)
        check_plans(plans, models)
        # Files that changed since the key was made get a result without a key.
        for k in new:
            if not result_keys.hold(cases[k]):
                keys[k] = ""
        new_keys = [keys[k] for k in new]
        flight_store = settings.flight_store
        # A generator: a plan is removed from memory when its result is complete.
        calls = (
            (
                *(plan, models.of(plan.case), settings.timeout, flight_store, evidence),
                *(store, key, (recorded or {}).get(plan.case.name)),
            )
            for plan, key in zip(_pop_in_order(plans), new_keys, strict=True)
        )
        performed = _perform_calls(calls, settings, pool)
        results = []
        for result in _pop_in_order(stored):
            if result is None:
                result = next(performed)
            results.append(result)
            if settings.progress is not None:
                settings.progress(result)
    return results


def _make_keys(
    cases: Sequence[PomCase],
    paths: Mapping[str, Any],
    *,
    models: Models,
    records: KeptStates,
    evidence: xr.DataTree | None,
) -> tuple[ResultKeys, list[str]]:
    """Return the keys of the results of all cases, and their maker.

    Results without a folder have empty keys: they are neither read nor stored.
    """
    if records.folder is None:
        return ResultKeys(records, "", evidence), [""] * len(cases)
    result_keys = ResultKeys(records, hash_installation(), evidence)
    keys = []
    for case in cases:
        keys.append(result_keys.of(case, path_of_case(case, paths), models.of(case)))
    return result_keys, keys


def _perform_calls(
    calls: Iterable[tuple[Any, ...]], settings: BatchExecution, pool: Processes | None
) -> Iterator[PomResult]:
    """Return the results of calls of `_perform`: by a cluster, by processes or by threads."""
    if settings.scheduler:
        return _perform_on_cluster(calls, settings.scheduler)
    if pool is None:
        return _perform_in_threads(calls, settings.jobs)
    return pool.map(_perform, calls)


def _perform_in_threads(calls: Iterable[tuple[Any, ...]], jobs: int) -> Iterator[PomResult]:
    threads = Parallel(n_jobs=jobs, backend="threading", return_as="generator")
    yield from threads(delayed(_perform)(*call) for call in calls)


def _perform_on_cluster(calls: Iterable[tuple[Any, ...]], scheduler: str) -> Iterator[PomResult]:
    with open_cluster(scheduler) as workers:
        yield from workers.in_order(_perform, calls)


def _perform(
    plan: ReplayPlan,
    models: Mapping[str, FmuModel],
    timeout: float,
    flight_store: KeptFlights | None,
    evidence: xr.DataTree | None,
    store: KeptResults,
    key: str,
    recorded: RecordedRuns | None = None,
) -> PomResult:
    """Return the result of a plan; store it if no model failed."""
    result = perform_plan(plan, models, timeout, flight_store, evidence)
    result = add_recorded_runs(result, plan.states, plan.job, recorded, plan.refusal)
    # A report needs the fitted modes. This process has them from the judgement.
    mode_table(result)
    if not result.failure:
        store.write(key, result)
    return result


def _pop_in_order(items: list[_Item]) -> Iterator[_Item]:
    """Yield items in their order and remove them from the list, so that memory is released."""
    items.reverse()
    while items:
        yield items.pop()
