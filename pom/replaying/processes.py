"""Processes of this machine that share the work of a batch."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager
from typing import Any

from flightmech.errors import SimulationError

LEAST_SHARE = 40
"""Cases that keep a process busy for some times as long as its start takes."""
_AHEAD = 3  # calls per process that are on their way at the same time
_ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"), "1")  # a process has one core


class Processes:
    """Processes at work; made by `processes`."""

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
            yield from in_order(lambda *call: self._executor.submit(work, *call), calls, _AHEAD * self._count)
        except BrokenExecutor as error:
            advice = "run the batch again, with fewer jobs when memory is short; with --resume what is done is not done again"
            raise SimulationError(f"a process that shares the work of the batch ended ({error}); {advice}") from error


@contextmanager
def processes(cases: int, jobs: int) -> Iterator[Processes | None]:
    """Give processes for a number of cases, as long as the block lasts; None when there are too few cases to share out.

    Parameters
    ----------
    cases : int
    jobs : int
        Processes at the same time; -1 for one per core.  A process has `LEAST_SHARE` cases at least.
    """
    from joblib import effective_n_jobs
    from joblib.externals.loky import ProcessPoolExecutor

    count = min(effective_n_jobs(jobs), cases // LEAST_SHARE)
    if count < 2:
        yield None
        return
    executor = ProcessPoolExecutor(count, env=_ONE_THREAD)  # with an end of its own: FMUs that its processes have loaded end with them
    try:
        yield Processes(executor, count)
    except BaseException:
        executor.shutdown(wait=True, kill_workers=True)
        raise
    executor.shutdown(wait=True)


def in_order(submit: Callable[..., Any], calls: Iterable[tuple[Any, ...]], window: int) -> Iterator[Any]:
    """Submit calls, no more than a window of them ahead, and give their results in their order."""
    waiting = deque[Any]()
    for call in calls:
        if len(waiting) >= window:
            yield waiting.popleft().result()
        waiting.append(submit(*call))
    while waiting:
        yield waiting.popleft().result()
