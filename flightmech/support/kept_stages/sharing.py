"""Calls shared out to the cores of this machine, or to the workers of a dask.distributed cluster:
the same results either way.
"""

from __future__ import annotations

import logging
import socket
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any
from urllib.parse import urlsplit

from joblib import Parallel, delayed

from flightmech.errors import SchemaError, SimulationError
from flightmech.support.kept_stages.program import hash_installation

WAIT = 20.0
"""How long a scheduler may take to answer and to have a worker. [s]"""
_AHEAD = 4  # calls per core of the cluster that are on their way at the same time


class Cores:
    """The cores of this machine."""

    def unordered(
        self,
        function: Callable[..., Any],
        calls: Iterable[tuple[Any, ...]],
        jobs: int,
        threads: bool,
    ) -> Iterator[tuple[int, Any]]:
        """Give place and result of every call as soon as it is there.

        Parameters
        ----------
        function : callable
        calls : iterable of tuple
            Arguments.
        jobs : int
            Processes or threads at the same time; -1 for one per core.
        threads : bool
            Threads instead of processes: where numbers are crunched by libraries that let others
            run.
        """
        if jobs == 1:  # one after the other, without what shares them out
            for place, call in enumerate(calls):
                yield _placed(place, function, *call)
            return

        work = (delayed(_placed)(place, function, *call) for place, call in enumerate(calls))
        yield from Parallel(
            n_jobs=jobs, backend="threading" if threads else None, return_as="generator_unordered"
        )(work)


class Cluster:
    """The workers of a dask.distributed cluster; made by `open_cluster`."""

    def __init__(self, client: Any) -> None:
        self._client = client

    def in_order(
        self, function: Callable[..., Any], calls: Iterable[tuple[Any, ...]]
    ) -> Iterator[Any]:
        """Give the results of calls in their order, with few calls ahead of the one that is waited
        for.
        """
        waiting = deque[Any]()
        for call in calls:
            if len(waiting) >= self._window:
                yield waiting.popleft().result()
            waiting.append(self._submit(function, *call))
        while waiting:
            yield waiting.popleft().result()

    def unordered(
        self,
        function: Callable[..., Any],
        calls: Iterable[tuple[Any, ...]],
        jobs: int,
        threads: bool,
    ) -> Iterator[tuple[int, Any]]:
        """Give place and result of every call as soon as it is there; the workers take the place of
        `jobs` and `threads`.
        """
        from distributed import as_completed

        left = iter(enumerate(calls))
        first = [
            self._submit(_placed, place, function, *call)
            for (place, call), _ in zip(left, range(self._window), strict=False)
        ]
        running = as_completed(first)
        for future in running:
            yield future.result()
            for place, call in left:
                running.add(self._submit(_placed, place, function, *call))
                break

    @property
    def _window(self) -> int:
        return max(1, _AHEAD * sum(self._client.ncores().values()))

    def _submit(self, function: Callable[..., Any], *call: Any) -> Any:
        with warnings.catch_warnings():
            warnings.filterwarnings(
                "ignore", "Sending large graph", UserWarning
            )  # a record is as large as it is
            return self._client.submit(function, *call, pure=False)


def _placed(place: int, function: Callable[..., Any], *call: Any) -> tuple[int, Any]:
    return place, function(*call)


def demand_scheduler(address: str) -> None:
    """Raise when no cluster can be used at an address, before any work is done.

    Raises
    ------
    SchemaError
        dask.distributed is not installed.
    SimulationError
        Nothing answers at the address.
    """
    if find_spec("distributed") is None:
        raise SchemaError(
            "scheduler", ["dask.distributed is not installed; pip install 'aeromatch[cluster]'"]
        )
    place = urlsplit(address)
    try:
        host, port = place.hostname, place.port
    except ValueError as error:
        raise SchemaError("scheduler", [f"{address!r}: {error}; write tcp://HOST:PORT"]) from error
    if host is None or port is None:
        return  # an address of another kind, which dask.distributed resolves
    end = time.monotonic() + WAIT
    while True:  # a scheduler that has just been started does not listen yet
        try:
            socket.create_connection((host, port), WAIT).close()
            return
        except OSError as error:
            if time.monotonic() > end:
                advice = "start a scheduler and workers, or leave --scheduler out"
                raise SimulationError(f"no cluster at {address}: {error}; {advice}") from error
        time.sleep(0.1)


@contextmanager
def open_cluster(scheduler: str) -> Iterator[Cluster]:
    """Give the workers of a scheduler as long as the block lasts.

    Parameters
    ----------
    scheduler : str
        Address of a dask.distributed scheduler, ``tcp://host:8786``.

    Raises
    ------
    SchemaError
        dask.distributed is not installed.
    SimulationError
        No scheduler or no worker answers, workers have another program, those of one call died
        again and again, or the scheduler ended.
    """
    try:
        from distributed import CancelledError, Client, KilledWorker
        from distributed.comm import CommClosedError
    except ImportError as error:
        raise SchemaError(
            "scheduler", ["dask.distributed is not installed; pip install 'aeromatch[cluster]'"]
        ) from error
    with _quiet(
        "distributed", "distributed.client", "distributed.comm"
    ):  # what they report comes as one error below
        try:
            client = Client(scheduler, timeout=WAIT)
        except (OSError, ValueError) as error:
            raise SimulationError(
                f"no cluster at {scheduler}: {error}; start a scheduler and workers, or "
                f"leave --scheduler out"
            ) from error
        with client:
            _check_workers(client, scheduler)
            try:
                yield Cluster(client)
            except KilledWorker as error:
                raise SimulationError(
                    f"the cluster lost its workers on one case again and again: {error}"
                ) from error
            except (CancelledError, CommClosedError) as error:
                advice = (
                    "start one and run the batch again; with --resume what was flown is not "
                    "flown again"
                )
                raise SimulationError(
                    f"the scheduler at {scheduler} ended while the batch ran; {advice}"
                ) from error


@contextmanager
def _quiet(*names: str) -> Iterator[None]:
    """Let loggers report what is critical only."""
    loggers = [logging.getLogger(name) for name in names]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


def _check_workers(client: Any, scheduler: str) -> None:
    """Wait for a worker, and refuse workers that would judge by another program."""
    try:
        client.wait_for_workers(1, timeout=WAIT)
    except TimeoutError as error:
        raise SimulationError(
            f"the scheduler at {scheduler} has no worker after {WAIT:g} s; start some"
        ) from error
    others = [
        worker
        for worker, found in client.run(hash_installation).items()
        if found != hash_installation()
    ]
    if others:
        raise SimulationError(
            f"{', '.join(sorted(others))}: another version of aeromatch (any file of it) or "
            f"of a library that it counts with (FMPy, NumPy, "
            "SciPy, pandas, xarray, h5py, Jinja2, typst), or another kind of machine than "
            "here; install the same on the workers"
        )
