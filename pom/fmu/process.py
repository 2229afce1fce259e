"""Child processes of FMUs, which are reused for the next job of the same file.

A process that crashed or hung is replaced. An FMU is untrusted. Its process has a session of its
own, which ends with all processes that it started. Its replies are numbered frames of text and
numbers (`pom.fmu.worker.messages`), with the size of the job, within the time limit. `WorkerLimits`
limits its memory, its files and its processes, and states its sandbox.
"""

from __future__ import annotations

import atexit
import os
import pickle
import shutil
import subprocess
import tempfile
import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from flightmech.support.foreign_code.process import ForeignProcess, module_command, write_whole
from flightmech.support.temporary_names import remove_leftovers, temporary_name
from pom.fmu.limits import WorkerLimits, read_worker_limits, sandboxed
from pom.fmu.run_cache import FileState
from pom.fmu.worker.messages import list_moved_controls, read_reply

KEPT = max(8, 4 * (os.cpu_count() or 1))  # most children that wait for work at the same time
# Another program killed the child, such as a system that lacks memory. The job is repeated once.
KILLED = "crashed: signal SIGKILL"
# Folder of the unpacked FMU in the sandbox, where /tmp is its own.
_INSIDE = "/tmp/fmu"


@dataclass(frozen=True)
class Reply:
    """Result of a job.

    Attributes
    ----------
    outputs : array (time, output)
        NaN after a failure.
    error : str
        Text of the failure, empty without a failure.
    moved : dict of str to array (time,)
        Corrections of the math pilot and positions of the control law, by control. [SI]
    """

    outputs: np.ndarray
    error: str
    moved: dict[str, np.ndarray] = field(default_factory=dict)


# The job never reached the process, so that a second one may get it.
_UNSENT = "the job could not be sent"


class Child:
    """A child process with one loaded FMU. One thread at a time may use it (`hire_worker`)."""

    def __init__(self, fmu: str | Path):
        self._fmu = Path(fmu)
        self._foreign: ForeignProcess | None = None
        self._readable: frozenset[str] = frozenset()
        self._folder = ""
        self._conversation: threading.Thread | None = None
        self._number = 0

    def run(self, job: Mapping[str, Any], timeout: float, once: bool = False) -> Reply:
        """Fly a job. A crash or a time-out is a reply, not an error.

        Parameters
        ----------
        job : mapping
            As in `pom.fmu.worker.replay_job`.
        timeout : float
            Wall time allowed. [s]
        once : bool
            Whether the process ends with the job, because it cannot instantiate the FMU twice.

        Raises
        ------
        SchemaError
            The environment has invalid limits (`read_worker_limits`).
        """
        answer = self._send_job(job, timeout)
        if isinstance(answer, str) and answer.startswith((KILLED, _UNSENT)):
            self.close()
            answer = self._send_job(job, timeout)
        if once or isinstance(answer, str):
            self.close()
        count = len(job["outputs"])
        nan = np.full((len(job["time"]), count), np.nan)
        if isinstance(answer, str):
            return Reply(nan, answer)
        error, columns = answer
        if columns is None:
            return Reply(nan, error)
        # The columns of the moved controls follow those of the outputs.
        controls = {name: columns[:, count + i] for i, name in enumerate(list_moved_controls(job))}
        return Reply(columns[:, :count], error, moved=controls)

    def _send_job(
        self, job: Mapping[str, Any], timeout: float
    ) -> tuple[str, np.ndarray | None] | str:
        """Return text and numbers of the reply, or only the text of a failed process."""
        foreign = self._start(self._needed_files(job))
        if job.get("law"):
            # The sandbox holds the file under its real path.
            path = str(Path(job["law"]["fmu"]).resolve())
            job = {**job, "law": {**job["law"], "fmu": path}}
        self._number += 1
        number = self._number
        shape = (len(job["time"]), len(job["outputs"]) + len(list_moved_controls(job)))
        answers: list[tuple[str, np.ndarray | None]] = []
        sent: list[int] = []

        def converse() -> None:
            # A broken pipe, or bytes that are not a reply: there is no answer.
            with suppress(OSError, EOFError, ValueError):
                write_whole(foreign.stdin, pickle.dumps({**job, "number": number}))
                sent.append(number)
                answers.append(read_reply(foreign.stdout.read, number, shape))

        conversation = self._conversation = foreign.converse(converse, timeout)
        # The end of the process can be seen before that of the conversation.
        if foreign.process.poll() is None and conversation.is_alive():
            return f"no answer within {timeout:g} s; the process was stopped"
        if answers:
            return answers[0]
        if not sent and foreign.process.poll() is None:
            return f"{_UNSENT}; the process was stopped{self._printed_text()}"
        try:
            return f"crashed: {foreign.describe_end()}{self._printed_text()}"
        except subprocess.TimeoutExpired:
            return f"its answer could not be read; the process was stopped{self._printed_text()}"

    def _needed_files(self, job: Mapping[str, Any]) -> frozenset[str]:
        """Return the FMUs of a job: the model and its control law."""
        files = [self._fmu]
        if job.get("law"):
            files.append(Path(job["law"]["fmu"]))
        return frozenset(str(file.resolve()) for file in files)

    def _start(self, needed: frozenset[str] = frozenset()) -> ForeignProcess:
        """Return the running process; start one if there is none that reads the files."""
        needed = needed or self._needed_files({})
        running = self._foreign is not None and self._foreign.process.poll() is None
        if not (running and needed <= self._readable):
            self.close()
            limits = read_worker_limits()
            words = []
            # A later job without the control law then needs no new process.
            self._readable = needed | frozenset(filter(os.path.exists, self._readable))
            if limits.is_sandboxed():
                words = sandboxed(readable=sorted(self._readable), limits=limits)
            else:
                self._folder = _new_folder()
            command = _worker_command(self._fmu, self._folder, limits)
            self._foreign = ForeignProcess(command, limits.of_process(), sandbox=words)
        assert self._foreign is not None
        return self._foreign

    def _printed_text(self) -> str:
        """Return the end of the text that the FMU printed, as a part of a failure."""
        text = self._foreign.printed_text() if self._foreign else ""
        return f"; it printed: {text}" if text else ""

    def close(self) -> None:
        """Stop the process and all processes that it started, and remove its unpacked files."""
        if self._foreign is not None:
            self._foreign.close(self._conversation)
            self._foreign = self._conversation = None
        if self._folder:
            shutil.rmtree(self._folder, ignore_errors=True)
            self._folder = ""


_FOLDER = "aeromatch-fmu"


def _new_folder() -> str:
    """Make a folder for an unpacked FMU, and remove the folders of killed processes."""
    parent = Path(tempfile.gettempdir())
    remove_leftovers(parent, _FOLDER, "d")
    folder = parent / temporary_name(_FOLDER, "d")
    folder.mkdir(mode=0o700)
    return str(folder)


def _worker_command(fmu: Path, folder: str, limits: WorkerLimits) -> list[str]:
    """Return the command of a child process; without a folder it unpacks in the sandbox."""
    # In bubblewrap the child cannot see its parent; it watches the pipe of its jobs instead.
    parent = str(os.getpid()) if folder else "0"
    sizes = [str(limits.written), str(limits.unpacked)]
    return module_command("pom.fmu.worker", str(fmu.resolve()), folder or _INSIDE, parent, *sizes)


_Key = tuple[str, FileState]
# Children without work, by file; the longest idle first. Only under the lock.
_idle: dict[_Key, list[Child]] = {}
_idle_lock = threading.Lock()


@contextmanager
def hire_worker(fmu: str | Path) -> Iterator[Child]:
    """Yield a child with this file loaded, which no other thread uses inside the block.

    A changed file gets a new child. Idle children wait for the next job. Children beyond `KEPT`,
    and children of an older state of the file, are stopped.
    """
    path = Path(fmu).resolve()
    key = str(path), FileState.of(path)
    stale: list[Child] = []
    with _idle_lock:
        for idle_key in list(_idle):
            if idle_key[0] == key[0] and idle_key != key:
                stale += _idle.pop(idle_key)
        waiting = _idle.get(key)
        child = waiting.pop() if waiting else Child(path)
    _stop(stale)
    try:
        yield child
    finally:
        with _idle_lock:
            _idle.setdefault(key, []).append(child)
            # The file that was used last is the last one in the dictionary.
            _idle[key] = _idle.pop(key)
            count = sum(map(len, _idle.values()))
            surplus = [_pop_oldest() for _ in range(count - KEPT)]
        _stop(surplus)


def _pop_oldest() -> Child:
    """Remove and return an idle child of the file that was used least recently."""
    oldest = next(key for key, children in _idle.items() if children)
    return _idle[oldest].pop(0)


def _stop(children: Iterable[Child]) -> None:
    for child in children:
        child.close()


@atexit.register
def close_all() -> None:
    """Stop every idle child. A child with a job ends when its input ends."""
    children: list[Child] = []
    with _idle_lock:
        for waiting in _idle.values():
            children += waiting
        _idle.clear()
    _stop(children)
