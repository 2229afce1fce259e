"""A foreign process: a session of its own, limits, a sandbox, and its end with all that it started.

FMUs, JSBSim, the DATCOM program and the readers of foreign formats run by it.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import IO

from flightmech.support.foreign_code.sandbox import ROOT, sandbox_words

_LAUNCHER = str(Path(__file__).with_name("launch.py"))
_POLL = 0.2  # s, between two checks whether the process still runs
_PATIENCE = 1.0  # s, for the end of a killed process, or of a pipe
_LAST_BYTES = 4096  # of the printed text that are read
_LONGEST_TEXT = 300  # characters of the printed text in a failure
_PART = 1 << 20  # bytes that are read at once


@dataclass(frozen=True)
class RunLimits:
    """Limits of a foreign process; 0: no limit.

    Attributes
    ----------
    memory : int
        Address space (POSIX). [byte]
    written : int
        Size of each file that it writes, and of its printed text (POSIX). [byte]
    files : int
        Files that it has open at once (POSIX).
    processes : bool
        Whether it may start other processes (Linux on x86-64 and aarch64).
    network : bool
        Whether it may open sockets (as above).
    """

    memory: int = 2_000_000_000
    written: int = 256_000_000
    files: int = 512
    processes: bool = False
    network: bool = False


class ForeignProcess:
    """A running foreign process.

    Parameters
    ----------
    command : sequence of str
        The program with its path, and its arguments.
    limits : RunLimits
    sandbox : list of str
        Words of `sandbox_words`; empty: no sandbox, and the environment of this process.
    cwd : path, optional
        Its folder; in the sandbox it is part of the words.
    joined : bool
        Whether its standard error goes to its standard output.
    """

    def __init__(
        self,
        command: Sequence[str],
        limits: RunLimits,
        *,
        sandbox: Sequence[str] = (),
        cwd: str | os.PathLike[str] | None = None,
        joined: bool = False,
    ):
        self.is_sandboxed = bool(sandbox)
        self._printed = tempfile.TemporaryFile()  # noqa: SIM115  it is closed with the process
        if os.name == "posix":
            starter = [sys.executable, "-I", "-S", _LAUNCHER, json.dumps(asdict(limits))]
            command = [*sandbox, *starter, *command]

        def start() -> subprocess.Popen[bytes]:
            return subprocess.Popen(
                list(command),
                bufsize=0,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT if joined else self._printed,
                # A session of its own: its process group ends with it.
                start_new_session=True,
                cwd=None if sandbox else cwd,
                env=None if sandbox else _child_environment(),
            )

        # Bubblewrap ends with the thread that started it.
        self.process = _starter().submit(start).result() if sandbox else start()

    @property
    def stdin(self) -> IO[bytes]:
        """Standard input of the process."""
        assert self.process.stdin is not None
        return self.process.stdin

    @property
    def stdout(self) -> IO[bytes]:
        """Standard output of the process."""
        assert self.process.stdout is not None
        return self.process.stdout

    def describe_end(self) -> str:
        """Return the exit code or the signal of the ended process as a text."""
        return describe_exit(exit_code(self.process.wait(_PATIENCE), self.is_sandboxed))

    def printed_text(self) -> str:
        """Return the end of the text on standard error in one line, as a part of a failure."""
        size = os.fstat(self._printed.fileno()).st_size
        self._printed.seek(max(size - _LAST_BYTES, 0))
        lines = self._printed.read().decode("utf-8", "replace").split("\n")
        text = " | ".join(line.strip() for line in lines if line.strip())[-_LONGEST_TEXT:]
        return printable(text)

    def kill(self) -> None:
        """Kill the process and, on POSIX, the first process group of its session."""
        if os.name == "posix":
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self.process.pid, signal.SIGKILL)
        self.process.kill()
        self.process.wait()

    def close(self, conversation: threading.Thread | None = None) -> None:
        """Kill the process and close its pipes, unless a thread still reads them."""
        self.kill()
        if conversation is not None:
            conversation.join(_PATIENCE)
        # A process that left the session can hold the pipe. The thread then still reads it, and
        # the pipe stays open.
        if conversation is None or not conversation.is_alive():
            for pipe in (self.process.stdin, self.process.stdout):
                # Buffered bytes cannot be written, because the reader has ended.
                with suppress(OSError):
                    if pipe is not None:
                        pipe.close()
        self._printed.close()

    def limit_time(self, seconds: float) -> threading.Timer:
        """Kill the process after a time, unless the timer is cancelled before."""
        timer = threading.Timer(seconds, self.kill)
        timer.daemon = True
        timer.start()
        return timer

    def converse(self, talk: Callable[[], None], timeout: float) -> threading.Thread:
        """Run a conversation over the pipes until its end, that of the process, or of the time.

        Returns
        -------
        Thread
            It is alive if the time has passed, or if another process holds the pipe.
        """
        # A thread, because a read from a pipe has no time limit.
        conversation = threading.Thread(target=talk, daemon=True)
        conversation.start()
        end = time.monotonic() + timeout
        while conversation.is_alive() and self.process.poll() is None and time.monotonic() < end:
            conversation.join(min(_POLL, max(end - time.monotonic(), 0.0)))
        if self.process.poll() is not None:
            # The reply of an ended process is still in the pipe.
            conversation.join(_PATIENCE)
        return conversation


def write_whole(pipe: IO[bytes], content: bytes) -> None:
    """Write all bytes into an unbuffered pipe, which may take a part of them at a time.

    A signal that stops and continues this process (``SIGTSTP``, a debugger) cuts a write short.
    """
    unsent = memoryview(content)
    while unsent:
        unsent = unsent[pipe.write(unsent) :]


@dataclass(frozen=True)
class ForeignRun:
    """What a foreign process wrote, and how it ended.

    Attributes
    ----------
    output : bytes
        Standard output.
    printed : str
        End of standard error.
    failure : str
        Empty if it ended by itself with exit code 0.
    timed_out : bool
    code : int
        Exit code; negative: a signal.
    """

    output: bytes
    printed: str
    failure: str
    timed_out: bool = False
    code: int = 0


def run_foreign(
    command: Sequence[str],
    content: bytes,
    *,
    timeout: float,
    limits: RunLimits,
    most: int,
    sandbox: Sequence[str] = (),
    cwd: str | os.PathLike[str] | None = None,
    joined: bool = False,
) -> ForeignRun:
    """Run a foreign program to its end.

    Parameters
    ----------
    command, limits, sandbox, cwd, joined
        As for `ForeignProcess`.
    content : bytes
        Its standard input.
    timeout : float
        Wall time allowed. [s]
    most : int
        Greatest size of its standard output. [byte]
    """
    process = ForeignProcess(command, limits, sandbox=sandbox, cwd=cwd, joined=joined)
    output = bytearray()
    ended: list[str] = []

    def write() -> None:
        with suppress(OSError, ValueError):
            write_whole(process.stdin, content)
        with suppress(OSError):
            process.stdin.close()

    def read() -> None:
        with suppress(OSError, ValueError):
            while part := process.stdout.read(_PART):
                output.extend(part)
                if len(output) > most:
                    ended.append(f"it wrote more than {most / 1e6:.0f} MB")
                    return

    writer = threading.Thread(target=write, daemon=True)
    writer.start()
    began = time.monotonic()
    reader = process.converse(read, timeout)
    try:
        left = max(began + timeout - time.monotonic(), 0.0)
        if ended:
            return ForeignRun(bytes(output), process.printed_text(), ended[0])
        try:
            # The end of the output can come before the end of the process.
            process.process.wait(left)
        except subprocess.TimeoutExpired:
            failure = f"it did not end within {timeout:g} s"
            return ForeignRun(bytes(output), process.printed_text(), failure, timed_out=True)
        code, failure = exit_code(process.process.returncode, process.is_sandboxed), ""
        if code:
            failure = f"it ended with {describe_exit(code)}"
        return ForeignRun(bytes(output), process.printed_text(), failure, code=code)
    finally:
        process.close(reader)


def module_command(module: str, *arguments: str) -> list[str]:
    """Return the command of a Python module of ours as a child process."""
    return [sys.executable, "-P", "-m", module, *arguments]


def sandbox_for(
    is_used: bool, readable: Iterable[str | os.PathLike[str]] = (), writable: str = ""
) -> list[str]:
    """Return the words of the sandbox, or none if it is not used."""
    if not is_used:
        return []
    return sandbox_words(readable, writable)


def exit_code(code: int, is_sandboxed: bool) -> int:
    """Return the exit code of a process; negative: a signal.

    Bubblewrap ends with 128 and the number of the signal.
    """
    if is_sandboxed and 128 < code <= 128 + 64:
        return 128 - code
    return code


def describe_exit(code: int) -> str:
    """Return an exit code as a text; a negative code is a signal."""
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"signal {signal.Signals(-code).name}"
    except ValueError:
        return f"signal {-code}"


def printable(text: str) -> str:
    """Return a foreign text without the characters that control a terminal."""
    return "".join(item if item.isprintable() else " " for item in text)


def _child_environment() -> dict[str, str]:
    packages = [str(ROOT), *filter(None, sys.path)]
    # Each thread of the linear algebra reserves address space.
    return {
        **os.environ,
        "OPENBLAS_NUM_THREADS": "1",
        "PYTHONPATH": os.pathsep.join(packages),
    }


@cache
def _starter() -> ThreadPoolExecutor:
    """Return a thread that lives as long as this process."""
    return ThreadPoolExecutor(1, "foreign-code")


if hasattr(os, "register_at_fork"):
    # A forked process has no thread but its own: a call to the inherited one would wait for ever.
    os.register_at_fork(after_in_child=_starter.cache_clear)
