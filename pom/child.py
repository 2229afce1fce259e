"""Child processes for FMUs: one per file, kept for the next job, replaced when it crashed or hung."""

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
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

_HERE = str(Path(__file__).parents[1])  # the child finds this very package
KEPT = 4  # children that may wait for work at the same time


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
        self.busy = threading.Lock()

    def run(self, job: Mapping[str, Any], timeout: float, once: bool = False) -> Reply:
        """Fly a job; a crash or a time-out is a reply, not an error.

        Parameters
        ----------
        job : mapping
            As `pom.worker.replay` takes it.
        timeout : float
            Wall time allowed. [s]
        once : bool
            The process ends with the job: the FMU cannot be instantiated twice in one.
        """
        nothing = np.full((len(job["time"]), len(job["outputs"])), np.nan)
        with self.busy:
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
                [sys.executable, "-P", "-m", "pom.worker", str(self._fmu.resolve()), self._folder],
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


_children: dict[tuple[str, int, int], Child] = {}
_guard = threading.Lock()


def child(fmu: str | Path) -> Child:
    """Return the child that has this file loaded; a file that changed gets a new one, idle ones beyond `KEPT` go."""
    path = Path(fmu).resolve()
    state = path.stat()
    key = str(path), state.st_mtime_ns, state.st_size
    with _guard:
        if key not in _children:
            surplus = list(_children)[: max(len(_children) - KEPT + 1, 0)]
            for old in dict.fromkeys([*(k for k in _children if k[0] == key[0]), *surplus]):
                if not _children[old].busy.locked():
                    _children.pop(old).close()
            _children[key] = Child(path)
        return _children[key]


@atexit.register
def close_all() -> None:
    """Stop every child."""
    while _children:
        _children.popitem()[1].close()
