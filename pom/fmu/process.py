"""Child processes for FMUs, kept for the next job of the same file, replaced when they crashed or
hung.

An FMU is untrusted.  Its process has a session of its own and ends with all that it started; what
comes back are numbered frames of text and numbers (`pom.fmu.worker.messages`), of the size that the
job has, within the time that it has.  Its limits are those of `pom.fmu.process`.
"""

from __future__ import annotations

import atexit
import os
import pickle
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from flightmech.errors import SchemaError
from flightmech.support.atomic_write import remove_leftovers, temporary_name
from pom.fmu.run_cache import FileState
from pom.fmu.worker.messages import moved_controls, read_reply

_SIZES = {"": 1.0, "B": 1.0, "kB": 1e3, "MB": 1e6, "GB": 1e9}


@dataclass(frozen=True)
class WorkerLimits:
    """Limits of a child process; 0: none.

    Attributes
    ----------
    memory : int
        Address space, ``AEROMATCH_FMU_MEMORY`` (POSIX). [byte]
    written : int
        Any file that it writes, and what it prints, ``AEROMATCH_FMU_WRITTEN`` (POSIX). [byte]
    unpacked : int
        All files of the FMU together, ``AEROMATCH_FMU_UNPACKED``. [byte]
    sandbox : bool
        It runs in bubblewrap, ``AEROMATCH_FMU_SANDBOX=bwrap`` (Linux): without network, and writing
        to its own folder only.
    """

    memory: int = 2_000_000_000
    written: int = 256_000_000
    unpacked: int = 1_000_000_000
    sandbox: bool = False


def read_worker_limits(environment: Mapping[str, str] = os.environ) -> WorkerLimits:
    """Return the limits as the environment has them.

    Raises
    ------
    SchemaError
        Variables that are not a size; a sandbox where there is no bubblewrap; all of them.

    Examples
    --------
    >>> read_worker_limits({"AEROMATCH_FMU_MEMORY": "8 GB", "AEROMATCH_FMU_WRITTEN": "none"})
    WorkerLimits(memory=8000000000, written=0, unpacked=1000000000, sandbox=False)
    """
    problems: list[str] = []
    sizes = {}
    for name in ("memory", "written", "unpacked"):
        text = environment.get(f"AEROMATCH_FMU_{name.upper()}", "").strip()
        if text:
            sizes[name] = _size(f"AEROMATCH_FMU_{name.upper()}", text, problems)
    sandbox = environment.get("AEROMATCH_FMU_SANDBOX", "").strip()
    if sandbox not in ("", "none", "bwrap"):
        problems.append(f"AEROMATCH_FMU_SANDBOX is {sandbox!r}; give 'bwrap' or 'none'")
    if sandbox == "bwrap" and not (sys.platform == "linux" and shutil.which("bwrap")):
        problems.append(
            "AEROMATCH_FMU_SANDBOX is 'bwrap', and there is no program bwrap; install "
            "bubblewrap, or leave the variable out"
        )
    if problems:
        raise SchemaError("environment", problems)
    return WorkerLimits(**sizes, sandbox=sandbox == "bwrap")


def _size(name: str, text: str, problems: list[str]) -> int:
    if text == "none":
        return 0
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([a-zA-Z]*)", text)
    if match is None or match[2] not in _SIZES or not float(match[1]):
        problems.append(f"{name} is {text!r}; give a size such as '4 GB' or '500 MB', or 'none'")
        return 0
    return round(float(match[1]) * _SIZES[match[2]])


def sandbox_command(folder: str) -> list[str]:
    """Return what stands before a command that runs in bubblewrap: all is read-only but `folder`;
    no network, processes of its own.
    """
    rights = ["--ro-bind", "/", "/", "--dev", "/dev", "--proc", "/proc", "--bind", folder, folder]
    return [
        "bwrap",
        *rights,
        "--unshare-net",
        "--unshare-pid",
        "--unshare-ipc",
        "--unshare-uts",
        "--die-with-parent",
        "--chdir",
        folder,
    ]


_HERE = str(Path(__file__).parents[2])  # the child finds this very package
KEPT = max(8, 4 * (os.cpu_count() or 1))  # children that may wait for work at the same time
# somebody else stopped it, such as a system short of memory: its job is given to another, once
KILLED = "crashed: signal SIGKILL"
_LOOK = 0.2  # s, between two looks whether the process still runs while its reply is awaited
_PATIENCE = 1.0  # s, for a process to end, or a pipe to be closed, once it was killed
_WORDS = 4096  # bytes of what the FMU printed last that are looked at


@dataclass(frozen=True)
class Reply:
    """What a job gave.

    Attributes
    ----------
    outputs : array (time, output)
        NaN where there are none.
    error : str
        Text of the failure, empty when it went well.
    moved : dict of str to array (time,)
        What the math pilot added, by control. [SI]
    """

    outputs: np.ndarray
    error: str
    moved: dict[str, np.ndarray] = field(default_factory=dict)


class Child:
    """A child process that has one FMU loaded."""

    def __init__(self, fmu: str | Path):
        self._fmu = Path(fmu)
        self._process: subprocess.Popen[bytes] | None = None
        self._folder = ""
        self._words: IO[bytes] | None = None
        self._talk: threading.Thread | None = None
        self._number = 0

    def run(self, job: Mapping[str, Any], timeout: float, once: bool = False) -> Reply:
        """Fly a job; a crash or a time-out is a reply, not an error.

        Parameters
        ----------
        job : mapping
            As `pom.fmu.worker.replay` takes it.
        timeout : float
            Wall time allowed. [s]
        once : bool
            The process ends with the job: the FMU cannot be instantiated twice in one.

        Raises
        ------
        SchemaError
            The environment has limits that are none (`pom.fmu.process`).
        """
        answer = self._ask(job, timeout)
        if isinstance(answer, str) and answer.startswith(KILLED):
            self.close()
            answer = self._ask(job, timeout)
        if once or isinstance(answer, str):
            self.close()
        n, m = len(job["time"]), len(job["outputs"])
        text, columns = (answer, None) if isinstance(answer, str) else answer
        if columns is None:
            return Reply(np.full((n, m), np.nan), text)
        return Reply(
            columns[:, :m],
            text,
            {name: columns[:, m + i] for i, name in enumerate(moved_controls(job))},
        )

    def _ask(self, job: Mapping[str, Any], timeout: float) -> tuple[str, np.ndarray | None] | str:
        process = self._start()
        self._number += 1
        number, shape = (
            self._number,
            (len(job["time"]), len(job["outputs"]) + len(moved_controls(job))),
        )
        answers: list[tuple[str, np.ndarray | None]] = []

        def converse() -> None:
            with suppress(
                OSError, EOFError, ValueError
            ):  # a broken pipe, or bytes that are not a reply
                pickle.dump({**job, "number": number}, process.stdin)  # type: ignore[arg-type]
                process.stdin.flush()  # type: ignore[union-attr]
                answers.append(read_reply(process.stdout.read, number, shape))  # type: ignore[union-attr]

        self._talk = threading.Thread(target=converse, daemon=True)
        self._talk.start()
        end = time.monotonic() + timeout
        while self._talk.is_alive() and process.poll() is None and time.monotonic() < end:
            self._talk.join(min(_LOOK, max(end - time.monotonic(), 0.0)))
        if process.poll() is None and self._talk.is_alive():
            return f"no answer within {timeout:g} s; the process was stopped"
        self._talk.join(
            _PATIENCE
        )  # it has ended: what it wrote is read, and another process may hold the pipe
        if answers:
            return answers[0]
        try:
            return f"crashed: {_ending(process.wait(_PATIENCE))}{self._last_words()}"
        except subprocess.TimeoutExpired:
            return f"its answer could not be read; the process was stopped{self._last_words()}"

    def _start(self) -> subprocess.Popen[bytes]:
        if self._process is None or self._process.poll() is not None:
            self.close()
            allowed = read_worker_limits()
            self._folder = _new_folder()
            self._words = tempfile.TemporaryFile()  # noqa: SIM115  lives as long as the process
            self._process = subprocess.Popen(
                _command(self._fmu, self._folder, allowed),
                bufsize=0,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._words,
                start_new_session=True,
                env={
                    **os.environ,
                    "OPENBLAS_NUM_THREADS": "1",  # each of its threads takes address space
                    "PYTHONPATH": os.pathsep.join(
                        [_HERE, *filter(None, [os.environ.get("PYTHONPATH")])]
                    ),
                },
            )
        return self._process

    def _last_words(self) -> str:
        if self._words is None:
            return ""
        self._words.seek(max(os.fstat(self._words.fileno()).st_size - _WORDS, 0))
        lines = self._words.read().decode("utf-8", "replace").split("\n")
        text = " | ".join(line.strip() for line in lines if line.strip())[-300:]
        return f"; it printed: {text}" if text else ""

    def close(self) -> None:
        """Stop the process and all that it started, and remove what it unpacked."""
        if self._process is not None:
            _kill(self._process)
            if self._talk is not None:
                self._talk.join(_PATIENCE)
            if (
                self._talk is None or not self._talk.is_alive()
            ):  # else a process that has left its session holds the pipe: it stays open
                for pipe in (self._process.stdin, self._process.stdout):
                    _shut(pipe)
            self._process = self._talk = None
        _shut(self._words)
        self._words = None
        if self._folder:
            shutil.rmtree(self._folder, ignore_errors=True)
            self._folder = ""


_FOLDER = "aeromatch-fmu"


def _new_folder() -> str:
    """Make a folder to unpack an FMU into; those that killed processes left are removed."""
    place = Path(tempfile.gettempdir())
    remove_leftovers(place, _FOLDER, "d")
    folder = place / temporary_name(_FOLDER, "d")
    folder.mkdir(mode=0o700)
    return str(folder)


def _command(fmu: Path, folder: str, allowed: WorkerLimits) -> list[str]:
    sizes = [str(size) for size in (allowed.memory, allowed.written, allowed.unpacked)]
    parent = (
        "0" if allowed.sandbox else str(os.getpid())
    )  # bubblewrap ends with its parent, and numbers processes anew
    command = [
        sys.executable,
        "-P",
        "-m",
        "pom.fmu.worker",
        str(fmu.resolve()),
        folder,
        parent,
        *sizes,
    ]
    return [*sandbox_command(folder), *command] if allowed.sandbox else command


def _kill(process: subprocess.Popen[bytes]) -> None:
    """Kill a process and, on POSIX, all of its session's first group."""
    if os.name == "posix":
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
    process.kill()
    process.wait()


def _shut(pipe: IO[bytes] | None) -> None:
    try:
        if pipe is not None:
            pipe.close()
    except OSError:  # what was still to be written has no reader any more
        return


def _ending(code: int) -> str:
    if code < 0:
        try:
            return f"signal {signal.Signals(-code).name}"
        except ValueError:
            return f"signal {-code}"
    return f"exit code {code}"


_Key = tuple[str, FileState]
_idle: dict[_Key, list[Child]] = {}  # the longest idle first
_guard = threading.Lock()


@contextmanager
def hire_worker(fmu: str | Path) -> Iterator[Child]:
    """Yield a child that has this file loaded and works for nobody else; a file that changed gets a
    new one.

    Idle children wait for the next job; those beyond `KEPT`, and those of an older state of the
    file, are stopped.
    """
    path = Path(fmu).resolve()
    key = str(path), FileState.of(path)
    with _guard:
        stale = [
            child
            for other in list(_idle)
            if other[0] == key[0] and other != key
            for child in _idle.pop(other)
        ]
        waiting = _idle.get(key)
        found = waiting.pop() if waiting else Child(path)
    _stop(stale)
    try:
        yield found
    finally:
        with _guard:
            _idle.setdefault(key, []).append(found)
            _idle[key] = _idle.pop(key)
            surplus = [_surplus() for _ in range(sum(map(len, _idle.values())) - KEPT)]
        _stop(surplus)


def _surplus() -> Child:
    """Take out the child whose file was used least recently."""
    oldest = next(key for key, children in _idle.items() if children)
    return _idle[oldest].pop(0)


def _stop(children: Iterable[Child]) -> None:
    for child in children:
        child.close()


@atexit.register
def close_all() -> None:
    """Stop every idle child; those at work end with their input."""
    with _guard:
        children = [child for waiting in _idle.values() for child in waiting]
        _idle.clear()
    _stop(children)
