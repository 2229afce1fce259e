"""Child processes for FMUs, kept for the next job of the same file, replaced when they crashed or hung."""

from __future__ import annotations

import atexit
import os
import pickle
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from .file_state import FileState

_HERE = str(Path(__file__).parents[2])  # the child finds this very package
KEPT = max(8, 4 * (os.cpu_count() or 1))  # children that may wait for work at the same time
KILLED = "crashed: signal SIGKILL"  # somebody else stopped it, such as a system short of memory: its job is given to another, once


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
        """
        nothing = np.full((len(job["time"]), len(job["outputs"])), np.nan)
        answer = self._ask(dict(job), timeout)
        if isinstance(answer, str) and answer.startswith(KILLED):
            self.close()
            answer = self._ask(dict(job), timeout)
        if once or isinstance(answer, str):
            self.close()
        if isinstance(answer, str):
            return Reply(nothing, answer)
        found = answer["outputs"]
        return Reply(nothing if found is None else found, answer["error"], answer["moved"])

    def _ask(self, job: dict[str, Any], timeout: float) -> dict[str, Any] | str:
        process = self._start()
        answers: list[dict[str, Any]] = []

        def converse() -> None:
            try:
                pickle.dump(job, process.stdin)  # type: ignore[arg-type]
                process.stdin.flush()  # type: ignore[union-attr]
                answers.append(pickle.load(process.stdout))  # type: ignore[arg-type]
            except Exception:  # a broken pipe or bytes that are no reply, which unpickling meets with errors of any class
                return

        thread = threading.Thread(target=converse, daemon=True)
        thread.start()
        thread.join(timeout)
        if thread.is_alive():
            return f"no answer within {timeout:g} s; the process was stopped"
        if answers:
            return answers[0]
        try:
            return f"crashed: {_ending(process.wait(1.0))}{self._last_words()}"
        except subprocess.TimeoutExpired:
            return f"its answer could not be read; the process was stopped{self._last_words()}"

    def _start(self) -> subprocess.Popen[bytes]:
        if self._process is None or self._process.poll() is not None:
            self.close()
            self._folder = tempfile.mkdtemp(prefix="aeromatch-fmu-")
            self._words = tempfile.TemporaryFile()  # noqa: SIM115  lives as long as the process
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "pom.fmu.worker", str(self._fmu.resolve()), self._folder, str(os.getpid())],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._words,
                env={**os.environ, "PYTHONPATH": os.pathsep.join([_HERE, *filter(None, [os.environ.get("PYTHONPATH")])])},
            )
        return self._process

    def _last_words(self) -> str:
        if self._words is None:
            return ""
        self._words.seek(0)
        lines = self._words.read().decode("utf-8", "replace").split("\n")
        text = " | ".join(line.strip() for line in lines if line.strip())[-300:]
        return f"; it printed: {text}" if text else ""

    def close(self) -> None:
        """Stop the process and remove what it unpacked."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            for pipe in (self._process.stdin, self._process.stdout):
                _shut(pipe)
            self._process = None
        _shut(self._words)
        self._words = None
        if self._folder:
            shutil.rmtree(self._folder, ignore_errors=True)
            self._folder = ""


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
def hired(fmu: str | Path) -> Iterator[Child]:
    """Yield a child that has this file loaded and works for nobody else; a file that changed gets a new one.

    Idle children wait for the next job; those beyond `KEPT`, and those of an older state of the file, are stopped.
    """
    path = Path(fmu).resolve()
    key = str(path), FileState.of(path)
    with _guard:
        stale = [child for other in list(_idle) if other[0] == key[0] and other != key for child in _idle.pop(other)]
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
