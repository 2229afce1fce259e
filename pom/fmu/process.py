"""Child processes of FMUs, which are reused for the next job of the same file.

A process that crashed or hung is replaced. An FMU is untrusted. Its process has a session of its
own, which ends with all processes that it started. Its replies are numbered frames of text and
numbers (`pom.fmu.worker.messages`), with the size of the job, within the time limit. `WorkerLimits`
limits its memory and its files.
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
    """Limits of a child process; 0: no limit.

    Attributes
    ----------
    memory : int
        Address space, ``AEROMATCH_FMU_MEMORY`` (POSIX). [byte]
    written : int
        Size of each file that it writes, and of its printed text, ``AEROMATCH_FMU_WRITTEN``
        (POSIX). [byte]
    unpacked : int
        Size of all files of the FMU together, ``AEROMATCH_FMU_UNPACKED``. [byte]
    sandbox : bool
        Whether it runs in bubblewrap, ``AEROMATCH_FMU_SANDBOX=bwrap`` (Linux): without network, and
        with write access to its own folder only.
    """

    memory: int = 2_000_000_000
    written: int = 256_000_000
    unpacked: int = 1_000_000_000
    sandbox: bool = False


def read_worker_limits(environment: Mapping[str, str] = os.environ) -> WorkerLimits:
    """Return the limits of the environment.

    Raises
    ------
    SchemaError
        With all variables that are not a size, and a sandbox on a system without bubblewrap.

    Examples
    --------
    >>> read_worker_limits({"AEROMATCH_FMU_MEMORY": "8 GB", "AEROMATCH_FMU_WRITTEN": "none"})
    WorkerLimits(memory=8000000000, written=0, unpacked=1000000000, sandbox=False)
    """
    problems: list[str] = []
    sizes = {}
    for name in ("memory", "written", "unpacked"):
        variable = f"AEROMATCH_FMU_{name.upper()}"
        text = environment.get(variable, "").strip()
        if text:
            sizes[name] = _parse_size(variable, text, problems)
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


def _parse_size(name: str, text: str, problems: list[str]) -> int:
    """Return the size in a text; 0 for 'none' and, with a problem, for another text. [byte]"""
    if text == "none":
        return 0
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([a-zA-Z]*)", text)
    if match is None or match[2] not in _SIZES or not float(match[1]):
        problems.append(f"{name} is {text!r}; give a size such as '4 GB' or '500 MB', or 'none'")
        return 0
    return round(float(match[1]) * _SIZES[match[2]])


def sandbox_command(folder: str) -> list[str]:
    """Return the words before a command that runs in bubblewrap.

    All files are read-only except those of `folder`. There is no network. The processes of the
    system are not visible.
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


# The child imports this very package.
_PACKAGES = str(Path(__file__).parents[2])
KEPT = max(8, 4 * (os.cpu_count() or 1))  # most children that wait for work at the same time
# Another program killed the child, such as a system that lacks memory. The job is repeated once.
KILLED = "crashed: signal SIGKILL"
_POLL = 0.2  # s, between two checks whether the process still runs
_PATIENCE = 1.0  # s, for the end of a killed process, or of a pipe
_LAST_BYTES = 4096  # of the printed text of an FMU that are read
_LONGEST_TEXT = 300  # characters of the printed text in a failure


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


class Child:
    """A child process with one loaded FMU. One thread at a time may use it (`hire_worker`)."""

    def __init__(self, fmu: str | Path):
        self._fmu = Path(fmu)
        self._process: subprocess.Popen[bytes] | None = None
        self._folder = ""
        self._printed: IO[bytes] | None = None
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
        if isinstance(answer, str) and answer.startswith(KILLED):
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
        controls = {name: columns[:, count + i] for i, name in enumerate(moved_controls(job))}
        return Reply(columns[:, :count], error, moved=controls)

    def _send_job(
        self, job: Mapping[str, Any], timeout: float
    ) -> tuple[str, np.ndarray | None] | str:
        """Return text and numbers of the reply, or only the text of a failed process."""
        process = self._start()
        self._number += 1
        number = self._number
        shape = (len(job["time"]), len(job["outputs"]) + len(moved_controls(job)))
        answers: list[tuple[str, np.ndarray | None]] = []

        def converse() -> None:
            # A broken pipe, or bytes that are not a reply: there is no answer.
            with suppress(OSError, EOFError, ValueError):
                pickle.dump({**job, "number": number}, process.stdin)  # type: ignore[arg-type]
                process.stdin.flush()  # type: ignore[union-attr]
                answers.append(read_reply(process.stdout.read, number, shape))  # type: ignore[union-attr]

        # A thread, because a read from a pipe has no time limit.
        conversation = self._conversation = threading.Thread(target=converse, daemon=True)
        conversation.start()
        end = time.monotonic() + timeout
        while conversation.is_alive() and process.poll() is None and time.monotonic() < end:
            conversation.join(min(_POLL, max(end - time.monotonic(), 0.0)))
        if process.poll() is None and conversation.is_alive():
            return f"no answer within {timeout:g} s; the process was stopped"
        # The reply of an ended process is still in the pipe. Another process may hold the pipe
        # open, so the wait is limited.
        conversation.join(_PATIENCE)
        if answers:
            return answers[0]
        try:
            return f"crashed: {_describe_exit(process.wait(_PATIENCE))}{self._printed_text()}"
        except subprocess.TimeoutExpired:
            return f"its answer could not be read; the process was stopped{self._printed_text()}"

    def _start(self) -> subprocess.Popen[bytes]:
        """Return the running process; start one if there is none."""
        if self._process is None or self._process.poll() is not None:
            self.close()
            limits = read_worker_limits()
            self._folder = _new_folder()
            self._printed = tempfile.TemporaryFile()  # noqa: SIM115  it is closed with the process
            packages = [_PACKAGES, *filter(None, [os.environ.get("PYTHONPATH")])]
            environment = {
                **os.environ,
                # Each thread of the linear algebra reserves address space.
                "OPENBLAS_NUM_THREADS": "1",
                "PYTHONPATH": os.pathsep.join(packages),
            }
            self._process = subprocess.Popen(
                _worker_command(self._fmu, self._folder, limits),
                bufsize=0,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._printed,
                start_new_session=True,
                env=environment,
            )
        return self._process

    def _printed_text(self) -> str:
        """Return the end of the text that the FMU printed, as a part of a failure."""
        if self._printed is None:
            return ""
        size = os.fstat(self._printed.fileno()).st_size
        self._printed.seek(max(size - _LAST_BYTES, 0))
        lines = self._printed.read().decode("utf-8", "replace").split("\n")
        text = " | ".join(line.strip() for line in lines if line.strip())[-_LONGEST_TEXT:]
        if not text:
            return ""
        return f"; it printed: {text}"

    def close(self) -> None:
        """Stop the process and all processes that it started, and remove its unpacked files."""
        if self._process is not None:
            _kill(self._process)
            if self._conversation is not None:
                self._conversation.join(_PATIENCE)
            # A process that left the session can hold the pipe. The thread then still reads it, and
            # the pipe stays open.
            if self._conversation is None or not self._conversation.is_alive():
                for pipe in (self._process.stdin, self._process.stdout):
                    _close_pipe(pipe)
            self._process = self._conversation = None
        _close_pipe(self._printed)
        self._printed = None
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
    """Return the command of a child process."""
    # In bubblewrap the child cannot see its parent, and bubblewrap itself ends with it.
    parent = "0" if limits.sandbox else str(os.getpid())
    sizes = [str(size) for size in (limits.memory, limits.written, limits.unpacked)]
    program = [sys.executable, "-P", "-m", "pom.fmu.worker"]
    command = [*program, str(fmu.resolve()), folder, parent, *sizes]
    if limits.sandbox:
        return [*sandbox_command(folder), *command]
    return command


def _kill(process: subprocess.Popen[bytes]) -> None:
    """Kill a process and, on POSIX, the first process group of its session."""
    if os.name == "posix":
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
    process.kill()
    process.wait()


def _close_pipe(pipe: IO[bytes] | None) -> None:
    # Buffered bytes cannot be written, because the reader has ended.
    with suppress(OSError):
        if pipe is not None:
            pipe.close()


def _describe_exit(code: int) -> str:
    """Return the exit code of a process as a text; a negative code is a signal."""
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"signal {signal.Signals(-code).name}"
    except ValueError:
        return f"signal {-code}"


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
