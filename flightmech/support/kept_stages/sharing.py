"""Parallel calls on the cores of this machine, or on the workers of a dask.distributed cluster.

The results are the same.
"""

from __future__ import annotations

import logging
import os
import socket
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from itertools import islice
from typing import Any
from urllib.parse import urlsplit

from joblib import Parallel, delayed

from flightmech.errors import SchemaError, SimulationError
from flightmech.support.kept_stages.program import hash_installation

WAIT = 20.0
"""Time limit for the answer of a scheduler, and for its first worker. [s]"""
# submitted calls per core of the cluster
_AHEAD = 4


def process_pool(jobs: int, **options: Any) -> Parallel:
    """Return a pool of processes for which relative paths mean what they mean here.

    joblib keeps its processes for the next pool. Without this the kept ones would stay in the
    folder in which they were started, when the program changes its folder in between.

    Parameters
    ----------
    jobs : int
        Number of processes, -1 for one per core.
    **options
        Of `joblib.Parallel`.
    """
    return Parallel(n_jobs=jobs, initializer=os.chdir, initargs=(os.getcwd(),), **options)


class Cores:
    """The cores of this machine."""

    def unordered(
        self,
        function: Callable[..., Any],
        calls: Iterable[tuple[Any, ...]],
        jobs: int,
        threads: bool,
    ) -> Iterator[tuple[int, Any]]:
        """Yield index and result of each call as soon as it is complete.

        Parameters
        ----------
        function : callable
        calls : iterable of tuple
            Arguments of each call.
        jobs : int
            Number of parallel processes or threads, -1 for one per core.
        threads : bool
            Threads instead of processes, for functions that release the interpreter lock.
        """
        if jobs == 1:
            # without the overhead of joblib
            for i, call in enumerate(calls):
                yield _call_indexed(i, function, *call)
            return
        work = (delayed(_call_indexed)(i, function, *call) for i, call in enumerate(calls))
        if threads:
            pool = Parallel(n_jobs=jobs, backend="threading", return_as="generator_unordered")
        else:
            pool = process_pool(jobs, return_as="generator_unordered")
        yield from pool(work)


class Cluster:
    """The workers of a dask.distributed cluster, from `open_cluster`."""

    def __init__(self, client: Any) -> None:
        self._client = client

    def in_order(
        self, function: Callable[..., Any], calls: Iterable[tuple[Any, ...]]
    ) -> Iterator[Any]:
        """Yield the results of calls in their order. Few calls are submitted ahead."""
        futures = deque[Any]()
        for call in calls:
            if len(futures) >= self._window:
                yield futures.popleft().result()
            futures.append(self._submit(function, *call))
        while futures:
            yield futures.popleft().result()

    def unordered(
        self,
        function: Callable[..., Any],
        calls: Iterable[tuple[Any, ...]],
        jobs: int,
        threads: bool,
    ) -> Iterator[tuple[int, Any]]:
        """Yield index and result of each call as soon as it is complete.

        The number of workers replaces `jobs` and `threads`.
        """
        from distributed import as_completed

        indexed = enumerate(calls)
        first = []
        for i, call in islice(indexed, self._window):
            first.append(self._submit(_call_indexed, i, function, *call))
        running = as_completed(first)
        for future in running:
            yield future.result()
            # one new call for each complete call
            for i, call in islice(indexed, 1):
                running.add(self._submit(_call_indexed, i, function, *call))

    @property
    def _window(self) -> int:
        return max(1, _AHEAD * sum(self._client.ncores().values()))

    def _submit(self, function: Callable[..., Any], *call: Any) -> Any:
        with warnings.catch_warnings():
            # a call has a whole record as argument
            warnings.filterwarnings("ignore", "Sending large graph", UserWarning)
            return self._client.submit(function, *call, pure=False)


def _call_indexed(i: int, function: Callable[..., Any], *call: Any) -> tuple[int, Any]:
    return i, function(*call)


def demand_scheduler(address: str) -> None:
    """Raise if there is no cluster at an address, before any work is done.

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
    url = urlsplit(address)
    try:
        host, port = url.hostname, url.port
    except ValueError as error:
        raise SchemaError("scheduler", [f"{address!r}: {error}; write tcp://HOST:PORT"]) from error
    if host is None or port is None:
        # an address of another kind, which dask.distributed resolves
        return
    end = time.monotonic() + WAIT
    # repeated, because a scheduler that has just been started does not listen yet
    while True:
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
    """Yield the workers of a scheduler for the duration of the block.

    Parameters
    ----------
    scheduler : str
        Address of a dask.distributed scheduler, ``tcp://host:8786``.

    Raises
    ------
    SchemaError
        dask.distributed is not installed.
    SimulationError
        No scheduler or no worker answers, the workers have another program, several workers died
        in the same call, or the scheduler ended.
    """
    try:
        from distributed import CancelledError, Client, KilledWorker
        from distributed.comm import CommClosedError
    except ImportError as error:
        raise SchemaError(
            "scheduler", ["dask.distributed is not installed; pip install 'aeromatch[cluster]'"]
        ) from error
    # their messages are replaced by the errors below
    with _limit_to_critical("distributed", "distributed.client", "distributed.comm"):
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
def _limit_to_critical(*names: str) -> Iterator[None]:
    """Limit loggers to critical messages inside the block."""
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
    """Wait for a worker, and raise if a worker has another program."""
    try:
        client.wait_for_workers(1, timeout=WAIT)
    except TimeoutError as error:
        raise SimulationError(
            f"the scheduler at {scheduler} has no worker after {WAIT:g} s; start some"
        ) from error
    hashes = client.run(hash_installation)
    others = sorted(worker for worker in hashes if hashes[worker] != hash_installation())
    if others:
        raise SimulationError(
            f"{', '.join(others)}: another version of aeromatch (any file of it) or "
            f"of a library that it counts with (FMPy, NumPy, "
            "SciPy, pandas, xarray, h5py, Jinja2, typst), or another kind of machine than "
            "here; install the same on the workers"
        )
