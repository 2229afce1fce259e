"""Worker processes that share the cases of a batch."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager
from typing import Any

from joblib import effective_n_jobs
from joblib.externals.loky import ProcessPoolExecutor

from flightmech.errors import SimulationError

LEAST_SHARE = 40
"""Fewest cases of a process; they take some times as long as its start."""
_AHEAD = 3  # submitted calls per process
# Each process has one core, so numerical libraries get one thread.
_ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"), "1")


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
