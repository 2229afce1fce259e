"""Work in child processes with progress and cancel: commands one after another, what only looks at
once.
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
from typing import Any

from aeromatch.workbench.actions import read_command_output

_ENDED = ("done", "failed", "cancelled")


@dataclass
class WorkbenchJob:
    """One command, or what the page itself needs formed: waiting, running, or ended.

    Attributes
    ----------
    number : int
    words : list of str
        Of the command line, without ``aeromatch``, with placeholders.
    state : str
        ``waiting``, ``running``, ``done``, ``failed`` or ``cancelled``.
    code : int or None
        Exit code of the process.
    out, err : Path
        What it printed.
    title : str
        Of a job that is not a command of the command line: what it does. It changes no file but those
        of a cache, and is not an action.
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
        """Return the job as plain data; ``progress`` is the last line that it printed, ``error``
        why it failed.
        """
        lines = [line for line in read_command_output(self.err).splitlines() if line.strip()]
        first = next(
            (i for i, line in enumerate(lines) if line.startswith(("error:", "Error:"))),
            len(lines) - 1,
        )
        error = "; ".join(line.strip() for line in lines[first:]) if lines else ""
        return {
            "number": self.number,
            "words": self.words,
            "state": self.state,
            "code": self.code,
            "progress": lines[-1].strip() if lines else "",
            "error": error if self.state == "failed" else "",
            "warnings": [line for line in lines if line.startswith("warning:")],
        }


class Jobs:
    """A queue of commands: they share files, so that each runs when the one before has ended.

    Parameters
    ----------
    folder : Path
        Gets what the commands print.
    cwd : Path
        Folder in which the commands run.
    real : callable
        Puts the paths in place of the placeholders of a command.
    before, after : callable
        Called with the job before its process starts and after it has ended well.
    """

    def __init__(
        self,
        folder: Path,
        cwd: Path,
        real: Callable[[Sequence[str]], list[str]],
        before: Callable[[WorkbenchJob], None],
        after: Callable[[WorkbenchJob], None],
    ) -> None:
        self.folder, self.cwd, self.real, self.before, self.after = folder, cwd, real, before, after
        self.jobs: dict[int, WorkbenchJob] = {}
        self._queue: deque[WorkbenchJob] = deque()
        self._changed = threading.Condition()
        self._stopped = False
        folder.mkdir(parents=True, exist_ok=True)
        for kept in folder.glob("*.txt"):  # of an earlier server
            kept.unlink()
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def add(self, words: Sequence[str]) -> WorkbenchJob:
        """Queue a command and return its job."""
        with self._changed:
            job = self._new(words)
            self._queue.append(job)
            self._changed.notify_all()
        return job

    def run(self, title: str, module: str, words: Sequence[str]) -> WorkbenchJob:
        """Run a module of Python outside the queue, since it writes no file that a command reads,
        and return its job when it has ended.
        """
        with self._changed:
            job = self._new(words)
            job.title = title
            if self._stopped:
                job.state = "cancelled"
        self._run(job, ["-m", module, *words])
        with self._changed:
            self._changed.notify_all()
        return job

    def _new(self, words: Sequence[str]) -> WorkbenchJob:
        number = len(self.jobs) + 1
        self.jobs[number] = WorkbenchJob(
            number,
            list(words),
            self.folder / f"{number}.out.txt",
            self.folder / f"{number}.err.txt",
        )
        return self.jobs[number]

    def cancel(self, number: int) -> None:
        """End a job; what it had begun to write is not there, for files are exchanged in the end."""
        with self._changed:
            job = self.jobs[number]
            if job.state in _ENDED:
                return
            job.state = "cancelled"
            if job in self._queue:
                self._queue.remove(job)
            _end(job.process)
            self._changed.notify_all()

    def wait(self, number: int, timeout: float) -> WorkbenchJob:
        """Return a job when it has ended, or after `timeout`. [s]"""
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

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._queue or self._stopped)
                if self._stopped:
                    return
                job = self._queue.popleft()
            self._run(job, ["-m", "aeromatch", *self.real(job.words)])
            with self._changed:
                self._changed.notify_all()

    def _run(self, job: WorkbenchJob, call: Sequence[str]) -> None:
        try:
            if not job.title:
                self.before(job)
            with job.out.open("wb") as out, job.err.open("wb") as err:
                with self._changed:
                    if job.state == "cancelled":
                        return
                    job.process = subprocess.Popen(
                        [sys.executable, *call],
                        cwd=self.cwd,
                        stdin=subprocess.DEVNULL,
                        stdout=out,
                        stderr=err,
                        env={
                            **os.environ,
                            "OPENBLAS_NUM_THREADS": os.environ.get("OPENBLAS_NUM_THREADS", "1"),
                        },
                        start_new_session=True,
                    )
                    job.state = "running"
                job.code = job.process.wait()
            if job.state == "cancelled":
                return
            well = job.code in (0, 1)  # 1: done, and the match or the data failed
            if well and not job.title:
                self.after(job)
            job.state = "done" if well else "failed"
        except Exception as error:  # of the server itself: the job reports it, the queue goes on
            job.err.write_text(f"error: {error}\n", encoding="utf-8")
            job.state = "failed"


def _end(process: subprocess.Popen[bytes] | None) -> None:
    """End a process and the processes that it started."""
    if process is None or process.poll() is not None:
        return
    with contextlib.suppress(ProcessLookupError):
        if os.name == "posix":
            os.killpg(process.pid, signal.SIGTERM)
        else:
            process.terminate()
    try:
        process.wait(5.0)
    except subprocess.TimeoutExpired:
        with contextlib.suppress(ProcessLookupError):
            if os.name == "posix":
                os.killpg(process.pid, signal.SIGKILL)
            else:
                process.kill()
