"""A batch: every case by every model, on all cores or on a cluster, going on where it was
interrupted.

Here the cases are shared out to threads, for the flights run in processes of their own; many cases
to processes, each with FMUs of its own.  With a scheduler the same calls go to the workers of a
dask.distributed cluster, which see the same files; a case whose worker dies is given to another.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager
from itertools import starmap
from pathlib import Path
from typing import Any, TypeVar

import xarray as xr
from joblib import Parallel, delayed, effective_n_jobs
from joblib.externals.loky import ProcessPoolExecutor

from flightmech.errors import SchemaError, SimulationError
from flightmech.support.kept_stages.program import hash_installation
from flightmech.support.kept_stages.sharing import open_cluster
from pom.cases.case import PomCase
from pom.cases.reference_states import read_path_states
from pom.fmu.run_cache import KeptFlights, RunCache
from pom.fmu.simulate import FmuModel, Models
from pom.judging.measures.modal import mode_table
from pom.replaying.caches import KeptResults, KeptStates, ResultKeys
from pom.replaying.replay_case import ReplayPlan, check_plan, perform_plan, plan_of
from pom.result import PomResult

LEAST_SHARE = 40
"""Cases that keep a process busy for some times as long as its start takes."""
_AHEAD = 3  # calls per process that are on their way at the same time
_ONE_THREAD = dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"), "1"
)  # a process has one core


class Processes:
    """Processes at work; made by `start_processes`."""

    def __init__(self, executor: Any, count: int):
        self._executor = executor
        self._count = count

    def map(self, work: Callable[..., Any], calls: Iterable[tuple[Any, ...]]) -> Iterator[Any]:
        """Give what `work` returns for every call, in their order, as soon as it is there.

        Raises
        ------
        SimulationError
            A process ended, such as by a system short of memory.
        """
        try:
            yield from in_order(
                lambda *call: self._executor.submit(work, *call), calls, _AHEAD * self._count
            )
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
    """Give processes for a number of cases, as long as the block lasts; None when there are too few
    cases to share out.

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
    executor = ProcessPoolExecutor(
        count, env=_ONE_THREAD
    )  # with an end of its own: FMUs that its processes have loaded end with them
    try:
        yield Processes(executor, count)
    except BaseException:
        executor.shutdown(wait=True, kill_workers=True)
        raise
    executor.shutdown(wait=True)


def in_order(
    submit: Callable[..., Any], calls: Iterable[tuple[Any, ...]], window: int
) -> Iterator[Any]:
    """Submit calls, no more than a window of them ahead, and give their results in their order."""
    waiting = deque[Any]()
    for call in calls:
        if len(waiting) >= window:
            yield waiting.popleft().result()
        waiting.append(submit(*call))
    while waiting:
        yield waiting.popleft().result()


_Item = TypeVar("_Item")


def replay_all(
    cases: Sequence[PomCase],
    runs: Mapping[str, str | Path],
    paths: Mapping[str, Any] | None = None,
    *,
    names: Mapping[str, str | Path] | None = None,
    biases: xr.Dataset | None = None,
    jobs: int = -1,
    scheduler: str | None = None,
    resume: str | Path | None = None,
    flights: KeptFlights | None = None,
    timeout: float = 60.0,
    evidence: xr.DataTree | None = None,
    progress: Callable[[PomResult], None] | None = None,
) -> list[PomResult]:
    """Replay every case by every model and judge it.

    Parameters
    ----------
    cases : sequence of PomCase
    runs : mapping of str to path
        Name of a model to its FMU, in the order of the report.
    paths : mapping of str to Path of flighttest.reconstruct or Dataset (time), optional
        Reconstructed paths by the file of the record or its stem; a record that has none is read,
        and reconstructed when it is raw.
    names : mapping of str to path, optional
        Name of a model to the table of its names (`replay`).
    biases : Dataset, optional
        Constants of the instruments for records that are reconstructed (`recorded_states`).
    jobs : int
        Cases at the same time, and processes for records that are reconstructed; -1 for one per
        core.
    scheduler : str, optional
        Address of a dask.distributed scheduler, ``tcp://host:8786``; its workers take the place of
        `jobs`.
    resume : path, optional
        Folder that keeps every flight that went well, by the hash of the FMU, of all that it was
        given and of the program that flew it; reconstructed records likewise; and results of which
        every flight went well, by all that they depend on (`pom.replaying.caches`).  What is there
        is neither flown nor judged again.
    flights : KeptFlights, optional
        Where flights alone are kept, without `resume`; no worker of a cluster has it.
    timeout : float
        Wall time allowed per model and case. [s]
    evidence : DataTree, optional
        What flight found (`replay`).
    progress : callable, optional
        Called with every result in the order of the cases, as soon as it is there.

    Returns
    -------
    list of PomResult
        In the order of the cases; the same to the last bit, however the work was shared out.

    Raises
    ------
    SchemaError
        Every case that a model cannot fly, before any is flown.
    OutOfRange
        A window is not inside its record, or an input holds a NaN.
    SimulationError
        No scheduler or no worker answers, workers have another program, those of one case died
        again and again, or the scheduler ended.
    """
    models = Models(runs, names)
    for case in cases:
        models.of(
            case
        )  # a table that does not fit is reported before records are reconstructed, which takes long
    folder = Path(resume).resolve() if resume is not None else None
    records, paths = KeptStates(folder, biases), paths or {}
    kept, by_content = (
        KeptResults(folder),
        ResultKeys(records, hash_installation() if folder is not None else "", evidence),
    )
    keys = [
        by_content.of(case, _given(case, paths), models.of(case)) if folder is not None else ""
        for case in cases
    ]
    known = [kept.read(key) for key in keys]
    new = [
        (case, key) for case, key, result in zip(cases, keys, known, strict=True) if result is None
    ]
    with start_processes(len(new), 1 if scheduler else jobs) as pool:
        plans = _plans([case for case, _ in new], paths, records, jobs, pool)
        _check(plans, models)
        names_kept = [key if by_content.hold(case) else "" for case, key in new]
        store = RunCache(folder) if folder is not None else flights
        calls = (
            (plan, models.of(plan.case), timeout, store, evidence, kept, key)
            for plan, key in zip(_let_go(plans), names_kept, strict=True)
        )
        performed = (
            _on_cluster(calls, scheduler)
            if scheduler
            else _here(calls, jobs)
            if pool is None
            else pool.map(_performed, calls)
        )
        results = []
        for result in (found if found is not None else next(performed) for found in _let_go(known)):
            results.append(result)
            if progress is not None:
                progress(result)
    return results


def _plans(
    cases: list[PomCase],
    paths: Mapping[str, Any],
    records: KeptStates,
    jobs: int,
    pool: Processes | None,
) -> list[ReplayPlan]:
    """Return the plan of every case; a record is read once for all its cases, by processes when
    there are any.
    """
    given = [_given(case, paths) for case in cases]
    groups: dict[tuple[str, str, str], list[PomCase]] = {}
    for case, path in zip(cases, given, strict=True):
        if path is None:
            groups.setdefault(_source(case), []).append(case)
    work = [(group, records) for group in groups.values()]
    read = starmap(_plans_at_hand, work) if pool is None else pool.map(_plans_at_hand, work)
    found = dict(zip(groups, read, strict=True))
    made = _states(
        [groups[source][0] for source, plans in found.items() if plans is None], records, jobs
    )
    found |= {
        source: [plan_of(case, states) for case in groups[source]]
        for source, states in made.items()
    }
    waiting = {source: iter(plans or ()) for source, plans in found.items()}
    return [
        next(waiting[_source(case)]) if path is None else plan_of(case, path)
        for case, path in zip(cases, given, strict=True)
    ]


def _plans_at_hand(cases: list[PomCase], records: KeptStates) -> list[ReplayPlan] | None:
    """Return the plans of cases of one record; None when it has to be reconstructed."""
    states = _at_hand(cases[0], records)
    return None if states is None else [plan_of(case, states) for case in cases]


def _performed(
    plan: ReplayPlan,
    models: Mapping[str, FmuModel],
    timeout: float,
    store: KeptFlights | None,
    evidence: xr.DataTree | None,
    kept: KeptResults,
    key: str,
) -> PomResult:
    """Return the result of a plan, and keep it when every model flew."""
    result = perform_plan(plan, models, timeout, store, evidence)
    mode_table(
        result
    )  # of fits that were made to judge it, by this process: a report needs them again
    if not result.failure:
        kept.write(key, result)
    return result


def _given(case: PomCase, paths: Mapping[str, Any]) -> Any:
    """Return the path that is given for the record of a case; None without one."""
    return paths.get(case.record, paths.get(Path(case.record).stem))


def paths_of_cases(
    cases: Sequence[PomCase], paths: Mapping[str, Any], records: KeptStates, jobs: int
) -> list[Any]:
    """Return the path of every case: the one given, else that of its record, read or reconstructed
    once; parameters as `replay_all`.
    """
    given = [_given(case, paths) for case in cases]
    read = _states(
        [case for case, path in zip(cases, given, strict=True) if path is None], records, jobs
    )
    return [
        read[_source(case)] if path is None else path
        for case, path in zip(cases, given, strict=True)
    ]


def _source(case: PomCase) -> tuple[str, str, str]:
    return case.record, case.names, case.aircraft


def _states(
    cases: Iterable[PomCase], records: KeptStates, jobs: int
) -> dict[tuple[str, str, str], xr.Dataset]:
    """Return the states of the records of cases, each read or reconstructed once; reconstructions
    share the cores.
    """

    first: dict[tuple[str, str, str], PomCase] = {}
    for case in cases:
        first.setdefault(_source(case), case)
    found = {source: _at_hand(case, records) for source, case in first.items()}
    raw = [source for source, states in found.items() if states is None]
    work = (delayed(records.make)(first[source]) for source in raw)
    made = dict(zip(raw, Parallel(n_jobs=jobs if len(raw) > 1 else 1)(work), strict=True))
    return {source: made[source] if states is None else states for source, states in found.items()}


def _at_hand(case: PomCase, records: KeptStates) -> xr.Dataset | None:
    states = read_path_states(case.record)
    return records.read(case) if states is None else states


def _check(plans: Iterable[ReplayPlan], models: Models) -> None:
    """Demand that every model can fly every case; what a model lacks is stated once, with the cases
    that need it.
    """
    cases: dict[tuple[str, str, str], list[str]] = {}
    for plan in plans:
        for name, model in models.of(plan.case).items():
            try:
                check_plan(plan, model)
            except SchemaError as error:
                for text in error.problems:
                    cases.setdefault((error.what, name, text), []).append(plan.case.name)
    if cases:
        problems = [
            f"{what} ({name}): {text}; case {', '.join(dict.fromkeys(found))}"
            for (what, name, text), found in cases.items()
        ]
        raise SchemaError("replay", problems)


def _let_go(items: list[_Item]) -> Iterator[_Item]:
    """Give items in their order and keep none: the result of a case takes the place of its states
    in memory.
    """
    items.reverse()
    while items:
        yield items.pop()


def _here(calls: Iterable[tuple[Any, ...]], jobs: int) -> Iterator[PomResult]:

    yield from Parallel(n_jobs=jobs, backend="threading", return_as="generator")(
        delayed(_performed)(*call) for call in calls
    )


def _on_cluster(calls: Iterable[tuple[Any, ...]], scheduler: str) -> Iterator[PomResult]:
    with open_cluster(scheduler) as workers:
        yield from workers.in_order(_performed, calls)
