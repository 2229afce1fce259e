"""Child processes of the workbench, with progress and cancel.

Commands write files, so they run one after another.  Work that fills only a cache runs at once.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

from aeromatch.workbench.actions import read_command_output

_ENDED = ("done", "failed", "cancelled")
# Exit codes of a command that was done; with 1, the match or the data failed.
_DONE_CODES = (0, 1)
# Time for a process to end after the request to end, before it is killed. [s]
_PATIENCE = 5.0


@dataclass
class WorkbenchJob:
    """One command, or work for a cache of the server: waiting, running, or ended.

    Attributes
    ----------
    number : int
    words : list of str
        Words of the command line without ``aeromatch``, with placeholders.
    state : str
        ``waiting``, ``running``, ``done``, ``failed`` or ``cancelled``.
    code : int or None
        Exit code of the process.
    out, err : Path
        Files of standard output and standard error.
    title : str
        Title of work that is not a command; empty for a command.  The work changes only a cache
        and is not an action of the log.
    """

    number: int
    words: list[str]
    out: Path
    err: Path
    state: str = "waiting"
    code: int | None = None
    title: str = ""
    process: subprocess.Popen[bytes] | None = field(default=None, repr=False)

    def about(self) -> dict[str, Any]:
        """Return the job as plain data.

        ``progress`` is the last printed line.  ``error`` is the reason of a failure.
        """
        text = read_command_output(self.err)
        lines = [line for line in text.splitlines() if line.strip()]
        return {
            "number": self.number,
            "words": self.words,
            "state": self.state,
            "code": self.code,
            "progress": lines[-1].strip() if lines else "",
            "error": _error_text(lines) if self.state == "failed" else "",
            "warnings": [line for line in lines if line.startswith("warning:")],
        }


def _error_text(lines: Sequence[str]) -> str:
    """Return the lines from the first error on, or the last line without an error."""
    for i, line in enumerate(lines):
        if line.startswith(("error:", "Error:")):
            return "; ".join(map(str.strip, lines[i:]))
    return lines[-1].strip() if lines else ""


class Jobs:
    """A queue of commands.

    Commands share files, so each one starts after the end of the one before.

    Parameters
    ----------
    folder : Path
        Folder of the output of the commands.
    cwd : Path
        Working directory of the commands.
    real : callable
        Replaces the placeholders of a command by paths.
    before, after : callable
        Called with the job before its process starts, and after a command is done.
    """

    def __init__(
        self,
        folder: Path,
        cwd: Path,
        real: Callable[[Sequence[str]], list[str]],
        before: Callable[[WorkbenchJob], None],
        after: Callable[[WorkbenchJob], None],
    ) -> None:
        self.folder, self.cwd, self.real = folder, cwd, real
        self.before, self.after = before, after
        self.jobs: dict[int, WorkbenchJob] = {}
        self._queue: deque[WorkbenchJob] = deque()
        self._changed = threading.Condition()
        self._stopped = False
        folder.mkdir(parents=True, exist_ok=True)
        # Remove the output of an earlier server.
        for output in folder.glob("*.txt"):
            output.unlink()
        self._thread = threading.Thread(target=self._run_queue, daemon=True)
        self._thread.start()

    def add(self, words: Sequence[str]) -> WorkbenchJob:
        """Queue a command and return its job."""
        with self._changed:
            job = self._make_job(words)
            self._queue.append(job)
            self._changed.notify_all()
        return job

    def run(self, title: str, module: str, words: Sequence[str]) -> WorkbenchJob:
        """Run a Python module outside of the queue, and return its job after its end.

        The module must not write a file that a command reads.
        """
        with self._changed:
            job = self._make_job(words)
            job.title = title
            if self._stopped:
                job.state = "cancelled"
        self._run_job(job, ["-m", module, *words])
        with self._changed:
            self._changed.notify_all()
        return job

    def _make_job(self, words: Sequence[str]) -> WorkbenchJob:
        number = len(self.jobs) + 1
        job = WorkbenchJob(
            number,
            list(words),
            out=self.folder / f"{number}.out.txt",
            err=self.folder / f"{number}.err.txt",
        )
        self.jobs[number] = job
        return job

    def list_all(self) -> list[WorkbenchJob]:
        """Return all jobs in the order in which they were added."""
        # Requests of the page add jobs in other threads.
        with self._changed:
            return list(self.jobs.values())

    def cancel(self, number: int) -> None:
        """End a job.  Commands write files atomically, so a cancelled job leaves no part of one."""
        with self._changed:
            job = self.jobs[number]
            if job.state in _ENDED:
                return
            job.state = "cancelled"
            if job in self._queue:
                self._queue.remove(job)
            _end_process(job.process)
            self._changed.notify_all()

    def wait(self, number: int, timeout: float) -> WorkbenchJob:
        """Return a job after its end, or after `timeout`. [s]"""
        with self._changed:
            self._changed.wait_for(lambda: self.jobs[number].state in _ENDED, timeout)
        return self.jobs[number]

    def stop(self) -> None:
        """End all jobs and the queue."""
        with self._changed:
            self._stopped = True
            waiting = [job.number for job in self.jobs.values() if job.state not in _ENDED]
            self._changed.notify_all()
        for number in waiting:
            self.cancel(number)
        self._thread.join(10.0)

    def _run_queue(self) -> None:
        """Run the commands of the queue one after another, until the server stops."""
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._queue or self._stopped)
                if self._stopped:
                    return
                job = self._queue.popleft()
            self._run_job(job, ["-m", "aeromatch", *self.real(job.words)])
            with self._changed:
                self._changed.notify_all()

    def _run_job(self, job: WorkbenchJob, arguments: Sequence[str]) -> None:
        """Run the process of a job to its end, and set state and code of the job."""
        is_command = not job.title
        try:
            if is_command:
                self.before(job)
            with job.out.open("wb") as out, job.err.open("wb") as err:
                # A job is cancelled either before its process exists, or with its process.
                with self._changed:
                    if job.state == "cancelled":
                        return
                    job.process = self._start_process(arguments, out, err)
                    job.state = "running"
                job.code = job.process.wait()
            if job.state == "cancelled":
                return
            is_done = job.code in _DONE_CODES
            if is_done and is_command:
                self.after(job)
            job.state = "done" if is_done else "failed"
        # An error of the server is reported by the job, and the queue continues.
        except Exception as error:
            job.state = "failed"
            # The disk may be full.
            with contextlib.suppress(OSError):
                job.err.write_text(f"error: {error}\n", encoding="utf-8", errors="backslashreplace")

    def _start_process(
        self, arguments: Sequence[str], out: BinaryIO, err: BinaryIO
    ) -> subprocess.Popen[bytes]:
        # One thread of BLAS per process, unless the user has set another number.
        threads = os.environ.get("OPENBLAS_NUM_THREADS", "1")
        return subprocess.Popen(
            [sys.executable, *arguments],
            cwd=self.cwd,
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=err,
            env={**os.environ, "OPENBLAS_NUM_THREADS": threads},
            # A process group of its own, so that its children can be ended too.
            start_new_session=True,
        )


def _end_process(process: subprocess.Popen[bytes] | None) -> None:
    """End a process and the processes that it started."""
    if process is None or process.poll() is not None:
        return
    _signal_group(process, force=False)
    try:
        process.wait(_PATIENCE)
    except subprocess.TimeoutExpired:
        _signal_group(process, force=True)


def _signal_group(process: subprocess.Popen[bytes], force: bool) -> None:
    """Request the end of a process and its children, or kill them by `force`."""
    with contextlib.suppress(ProcessLookupError):
        if os.name == "posix":
            os.killpg(process.pid, signal.SIGKILL if force else signal.SIGTERM)
        elif force:
            process.kill()
        else:
            process.terminate()
