"""MATLAB files up to version 7 through SciPy, in a child process: on damaged bytes SciPy can bring
its process down (SIGSEGV).

The child is our own program with the user's rights and no sandbox; it protects this process from
the crash, nothing else.
"""

from __future__ import annotations

import json
import os
import pickle
import signal
import subprocess
import sys
from typing import Any

from flightmech.errors import ParseError

_SECONDS, _RATE = (
    60.0,
    5e6,
)  # a sound file takes a second, and one more for about 100 MB; s, bytes per second


def load_mat(
    raw: bytes, file: str | os.PathLike[str], expected: str, **options: Any
) -> dict[str, Any]:
    """Return what `scipy.io.loadmat` makes of the bytes of a file.

    Parameters
    ----------
    raw : bytes
        Content of the file.
    file : path
        For the text of an error.
    expected : str
        What the file should be, for the text of an error.
    **options
        Of `scipy.io.loadmat`, values that JSON knows.

    Raises
    ------
    NotImplementedError
        Version 7.3, which is HDF5.
    ParseError
        SciPy cannot read it, breaks down on it, or does not come to an end.
    """
    kind, content = _answer(raw, options)
    if kind == "NotImplementedError":
        raise NotImplementedError(content)
    if kind:
        found = f"no MAT file, or a damaged one ({kind}: {content})"
        raise ParseError(os.fspath(file), 0, found, f"{expected}; copy or save it again")
    return content


def _answer(raw: bytes, options: dict[str, Any]) -> tuple[str, Any]:
    """Return what the child makes of a file: an empty text and the content, or the kind and the
    text of a fault.
    """
    command = [sys.executable, "-m", f"{__package__}.mat_child", json.dumps(options)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(part for part in sys.path if part)}
    limit = _SECONDS + len(raw) / _RATE
    try:
        done = subprocess.run(
            command,
            input=raw,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment,
            timeout=limit,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return "time limit", f"SciPy did not read it in {limit:.0f} s"
    if done.returncode:
        names = {-one.value: one.name for one in signal.Signals}
        return (
            "crash",
            f"SciPy ended with {names.get(done.returncode, f'exit code {done.returncode}')}",
        )
    return pickle.loads(done.stdout)
