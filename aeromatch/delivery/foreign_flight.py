"""Flights of check cases by foreign programs in a child process: the FMU of a package, and JSBSim.

The child gets all cases as one file of arrays on standard input. It answers with a frame of numbers
for each case (`pom.fmu.worker.messages`).
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import SimulationError
from flightmech.support.foreign_code.process import (
    ForeignRun,
    module_command,
    run_foreign,
    sandbox_for,
)
from pom.fmu.limits import read_worker_limits
from pom.fmu.worker.messages import read_reply, reply_bytes

# Wall time of the start of a child, and of one flight. [s]
_START, _FLIGHT = 60.0, 60.0
# Largest text in a frame, and its head. [byte]
_SPARE = 100_000

Case = tuple[xr.Dataset, Mapping[str, float]]
Job = dict[str, np.ndarray]


def fly_in_child(
    module: str, jobs: Sequence[Job], shapes: Sequence[tuple[int, int]], readable: Sequence[Path]
) -> list[np.ndarray | str]:
    """Return the outputs (time, output) of every job, or the text of its failure.

    Parameters
    ----------
    module : str
        Program of the child, which calls `answer_jobs`.
    jobs : sequence of dict of str to array
    shapes : sequence of (int, int)
        Of the outputs.
    readable : sequence of Path
        Files that the child reads; they are its arguments.
    """
    content = io.BytesIO()
    arrays: dict[str, Any] = {"count": len(jobs)}
    for i, job in enumerate(jobs):
        arrays |= {f"{i} {name}": values for name, values in job.items()}
    np.savez(content, **arrays)
    limits = read_worker_limits()
    files = [str(path.resolve()) for path in readable]
    done = run_foreign(
        module_command(module, *files),
        content.getvalue(),
        timeout=_START + _FLIGHT * len(jobs),
        limits=limits.of_process(),
        most=sum(8 * rows * columns + _SPARE for rows, columns in shapes),
        sandbox=sandbox_for(limits.is_sandboxed(), files),
    )
    return list(_read_replies(done, shapes))


def _read_replies(
    done: ForeignRun, shapes: Sequence[tuple[int, int]]
) -> Iterator[np.ndarray | str]:
    stream = io.BytesIO(done.output)
    for number, shape in enumerate(shapes):
        text, columns = done.failure or "it gave no answer", None
        with suppress(EOFError, ValueError):
            text, columns = read_reply(stream.read, number, shape)
        if columns is not None and not text:
            yield columns
        elif done.printed and done.failure:
            yield f"{text}; it printed: {done.printed}"
        else:
            yield text or "it gave no numbers"


def answer_jobs(fly: Callable[[Job], np.ndarray]) -> None:
    """Read the jobs on standard input, fly them, and write the answers to standard output."""
    # What a program prints goes to standard error.
    replies = os.dup(1)
    os.dup2(2, 1)
    with np.load(io.BytesIO(sys.stdin.buffer.read())) as content:
        arrays = dict(content)
    for number in range(int(arrays["count"])):
        prefix = f"{number} "
        job = {}
        for name, values in arrays.items():
            if name.startswith(prefix):
                job[name.removeprefix(prefix)] = values
        try:
            answer = reply_bytes(number, "", fly(job))
        except Exception as error:
            answer = reply_bytes(number, str(error) or type(error).__name__, np.empty((0, 0)))
        unsent = memoryview(answer)
        while unsent:
            unsent = unsent[os.write(replies, unsent) :]


def demand_flight(flight: np.ndarray | str, program: str) -> np.ndarray:
    """Return the outputs of a flight.

    Raises
    ------
    SimulationError
        It failed.
    """
    if isinstance(flight, str):
        raise SimulationError(f"{program}: {flight}")
    return flight
