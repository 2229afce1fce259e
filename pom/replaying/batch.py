"""A batch of cases: replay of every case by every model, in parallel and with stored results.

Threads share the cases, because the runs of FMUs are separate processes. Many cases are shared by
processes, and each process loads its FMUs. With a scheduler the workers of a dask.distributed
cluster take the calls. They must see the same files. If a worker dies, another worker repeats its
case.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import starmap
from pathlib import Path
from typing import Any, TypeVar

import xarray as xr
from joblib import Parallel, delayed, effective_n_jobs
from joblib.externals.loky import ProcessPoolExecutor

from flightmech.errors import SchemaError, SimulationError
from flightmech.support.kept_stages.content_hashes import content_hash
from flightmech.support.kept_stages.program import hash_installation
from flightmech.support.kept_stages.sharing import open_cluster, process_pool
from pom.cases.case import PomCase
from pom.cases.fact_agreement import demand_agreement
from pom.cases.reference_states import read_path_states
from pom.fmu.models import FmuModel, Models
from pom.fmu.run_cache import KeptFlights, RunCache
from pom.judging.measures.modal import mode_table
from pom.replaying.caches import KeptResults, KeptStates, ResultKeys
from pom.replaying.recorded_runs import RecordedRuns, add_recorded_runs
from pom.replaying.replay_case import ReplayPlan, check_plan, perform_plan, plan_of
from pom.result import PomResult

LEAST_SHARE = 40
"""Fewest cases of a process; they take some times as long as its start."""
_AHEAD = 3  # submitted calls per process
# Each process has one core, so numerical libraries get one thread.
_ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"), "1")

_Item = TypeVar("_Item")
_Source = tuple[str, str, str]  # record, name map and aircraft of a case


class Processes:
    """Running worker processes; `start_processes` makes them."""

    def __init__(self, executor: Any, count: int):
        self._executor = executor
        self._count = count

    def map(self, work: Callable[..., Any], calls: Iterable[tuple[Any, ...]]) -> Iterator[Any]:
        """Yield the results of `work` for every call, in the order of the calls.

        Raises
        ------
        SimulationError
            A process ended unexpectedly, for example because the system lacks memory.
        """

        def submit(*call: Any) -> Any:
            return self._executor.submit(work, *call)

        try:
            yield from in_order(submit, calls, _AHEAD * self._count)
        except BrokenExecutor as error:
            advice = (
                "run the batch again, with fewer jobs when memory is short; with --resume "
                "what is done is not done again"
            )
            raise SimulationError(
                f"a process that shares the work of the batch ended ({error}); {advice}"
            ) from error


@contextmanager
def start_processes(cases: int, jobs: int) -> Iterator[Processes | None]:
    """Provide processes for a number of cases inside the block; None if there are few cases.

    Parameters
    ----------
    cases : int
    jobs : int
        Processes at the same time; -1 for one per core.  A process has `LEAST_SHARE` cases at
        least.
    """
    count = min(effective_n_jobs(jobs), cases // LEAST_SHARE)
    if count < 2:
        yield None
        return
    # A separate executor ends with the block, and with it the FMUs that its processes loaded.
    executor = ProcessPoolExecutor(count, env=_ONE_THREAD)
    try:
        yield Processes(executor, count)
    except BaseException:
        executor.shutdown(wait=True, kill_workers=True)
        raise
    executor.shutdown(wait=True)


def in_order(
    submit: Callable[..., Any], calls: Iterable[tuple[Any, ...]], window: int
) -> Iterator[Any]:
    """Submit at most `window` calls ahead, and yield the results in the order of the calls."""
    waiting = deque[Any]()
    for call in calls:
        if len(waiting) >= window:
            yield waiting.popleft().result()
        waiting.append(submit(*call))
    while waiting:
        yield waiting.popleft().result()


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
        A model cannot fly a case. All such cases are reported before the first run.
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
        plans = _make_plans([cases[k] for k in new], paths, records, jobs=settings.jobs, pool=pool)
        _check_plans(plans, models)
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
        keys.append(result_keys.of(case, _path_of(case, paths), models.of(case)))
    return result_keys, keys


def _make_plans(
    cases: list[PomCase],
    paths: Mapping[str, Any],
    records: KeptStates,
    *,
    jobs: int,
    pool: Processes | None,
) -> list[ReplayPlan]:
    """Return the plan of every case; a record is read once for all its cases."""
    groups: dict[_Source, list[PomCase]] = {}
    for case in cases:
        if _path_of(case, paths) is None:
            groups.setdefault(_source_of(case), []).append(case)
    calls = [(group, records) for group in groups.values()]
    if pool is None:
        read: Iterable[list[ReplayPlan] | None] = starmap(_plan_stored_record, calls)
    else:
        read = pool.map(_plan_stored_record, calls)
    plans = dict(zip(groups, read, strict=True))
    raw = []
    for source, group_plans in plans.items():
        if group_plans is None:
            raw.append(groups[source][0])
    for source, states in _read_states(raw, records, jobs).items():
        plans[source] = [plan_of(case, states) for case in groups[source]]
    # Plans of a record are in the order of its cases.
    next_plans = {source: iter(group_plans or ()) for source, group_plans in plans.items()}
    ordered = []
    for case in cases:
        path = _path_of(case, paths)
        if path is None:
            ordered.append(next(next_plans[_source_of(case)]))
        else:
            ordered.append(plan_of(case, path))
    return ordered


def _plan_stored_record(cases: list[PomCase], records: KeptStates) -> list[ReplayPlan] | None:
    """Return the plans of cases of one record; None if it has to be reconstructed."""
    states = _read_stored_states(cases[0], records)
    if states is None:
        return None
    return [plan_of(case, states) for case in cases]


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
    result = add_recorded_runs(result, plan.states, plan.job, recorded)
    # A report needs the fitted modes. This process has them from the judgement.
    mode_table(result)
    if not result.failure:
        store.write(key, result)
    return result


def paths_of_cases(
    cases: Sequence[PomCase], paths: Mapping[str, Any], records: KeptStates, jobs: int
) -> list[Any]:
    """Return the path of every case: from `paths`, else the states of its record.

    Parameters
    ----------
    cases, paths, jobs
        As in `replay_all`. Each record is read or reconstructed once.
    records : KeptStates
        Store of reconstructed states.
    """
    # Each record is read once, before the paths are put in the order of the cases.
    without_path = [case for case in cases if _path_of(case, paths) is None]
    states = _read_states(without_path, records, jobs)
    case_paths = []
    for case in cases:
        path = _path_of(case, paths)
        if path is None:
            path = states[_source_of(case)]
        case_paths.append(path)
    return case_paths


def _path_of(case: PomCase, paths: Mapping[str, Any]) -> Any:
    """Return the path for the record of a case; None without one."""
    return paths.get(case.record, paths.get(Path(case.record).stem))


def _source_of(case: PomCase) -> _Source:
    """Return the files that determine the states of a case."""
    return case.record, case.names, case.aircraft


def _read_states(
    cases: Iterable[PomCase], records: KeptStates, jobs: int
) -> dict[_Source, xr.Dataset]:
    """Return the states of all records; raw records are reconstructed in parallel."""
    first_cases: dict[_Source, PomCase] = {}
    for case in cases:
        first_cases.setdefault(_source_of(case), case)
    stored: dict[_Source, xr.Dataset | None] = {}
    raw: list[_Source] = []
    for source, case in first_cases.items():
        stored[source] = _read_stored_states(case, records)
        if stored[source] is None:
            raw.append(source)
    # One record does not repay the start of a process.
    if len(raw) <= 1:
        jobs = 1
    work = (delayed(records.make)(first_cases[source]) for source in raw)
    reconstructed = dict(zip(raw, process_pool(jobs)(work), strict=True))
    # Keep the order of the cases: the reconstructed records are anywhere among them.
    all_states = {}
    for source, states in stored.items():
        if states is None:
            states = reconstructed[source]
        all_states[source] = states
    return all_states


def _read_stored_states(case: PomCase, records: KeptStates) -> xr.Dataset | None:
    """Return the states in the record or in the store; None if it has to be reconstructed."""
    states = read_path_states(case.record)
    if states is None:
        return records.read(case)
    return states


def _check_plans(plans: Iterable[ReplayPlan], models: Models) -> None:
    """Raise if a model cannot fly a case; every problem is reported once, with its cases."""
    cases: dict[tuple[str, str, str], list[str]] = {}
    for plan in plans:
        for name, model in models.of(plan.case).items():
            try:
                check_plan(plan, model)
            except SchemaError as error:
                for text in error.problems:
                    cases.setdefault((error.what, name, text), []).append(plan.case.name)
    if cases:
        problems = []
        for (what, name, text), case_names in cases.items():
            unique = ", ".join(dict.fromkeys(case_names))
            problems.append(f"{what} ({name}): {text}; case {unique}")
        raise SchemaError("replay", problems)


def _pop_in_order(items: list[_Item]) -> Iterator[_Item]:
    """Yield items in their order and remove them from the list, so that memory is released."""
    items.reverse()
    while items:
        yield items.pop()
