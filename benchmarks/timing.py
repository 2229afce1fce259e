"""Time of a piece of work, for the benchmarks next to this file."""

import time
from collections.abc import Callable


def best(work: Callable[[], object], repeats: int = 5) -> float:
    """Shortest CPU time of `repeats` calls. [s]"""
    times = []
    for _ in range(repeats):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)
