"""Reader of MATLAB files up to version 7 with SciPy in a child process.

SciPy can crash on damaged bytes (SIGSEGV). The child process protects the calling process from the
crash. It has the rights of the user and is not a sandbox.

This module is also the program of the child. It gets a MAT file on standard input, and the options
as JSON in its argument. It writes a pickle to standard output: a pair of an empty text and the
content, or of the type and the text of an error.
"""

from __future__ import annotations

import io
import json
import os
import pickle
import signal
import subprocess
import sys
from typing import Any

from flightmech.errors import ParseError

# Time limit: start of the child [s], and rate of reading [byte s-1]. A file of sounds takes about
# 1 s, and another second per 100 MB.
_SECONDS, _RATE = 60.0, 5e6


def load_mat(
    raw: bytes, file: str | os.PathLike[str], expected: str, **options: Any
) -> dict[str, Any]:
    """Return the result of `scipy.io.loadmat` for the bytes of a file.

    Parameters
    ----------
    raw : bytes
        Content of the file.
    file : path
        Name of the file, for an error.
    expected : str
        Expected content of the file, for an error.
    **options
        Options of `scipy.io.loadmat`, of types of JSON.

    Raises
    ------
    NotImplementedError
        Version 7.3, which is HDF5.
    ParseError
        SciPy cannot read the file, crashes or exceeds the time limit.
    """
    kind, content = _decode_in_child(raw, options)
    if kind == "NotImplementedError":
        raise NotImplementedError(content)
    if kind:
        fault = f"no MAT file, or a damaged one ({kind}: {content})"
        raise ParseError(os.fspath(file), 0, fault, f"{expected}; copy or save it again")
    return content


def decode_mat(raw: bytes, options: dict[str, Any]) -> tuple[str, Any]:
    """Return an empty text and the content, or the type and the text of an error."""
    from scipy.io import loadmat

    stream: Any = io.BytesIO(raw)
    try:
        return "", loadmat(stream, **options)
    except Exception as error:
        # damaged bytes lead to errors of any type in SciPy
        return type(error).__name__, " ".join(str(error).split())[:300]


def _decode_in_child(raw: bytes, options: dict[str, Any]) -> tuple[str, Any]:
    """Return the result of `decode_mat` in a child process, or a crash or time limit as error."""
    command = [sys.executable, "-m", __name__, json.dumps(options)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    limit = _SECONDS + len(raw) / _RATE
    try:
        child = subprocess.run(
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
    if child.returncode:
        # the code of a process that a signal ended is negative
        names = {-item.value: item.name for item in signal.Signals}
        end = names.get(child.returncode, f"exit code {child.returncode}")
        return "crash", f"SciPy ended with {end}"
    return pickle.loads(child.stdout)


def _run_child() -> None:
    """Decode standard input and write the pickle to standard output."""
    stream = sys.stdout.buffer
    # text that SciPy prints must not come between the bytes of the pickle
    sys.stdout = sys.stderr
    content = decode_mat(sys.stdin.buffer.read(), json.loads(sys.argv[1]))
    stream.write(pickle.dumps(content, protocol=5))
    stream.flush()


if __name__ == "__main__":
    _run_child()
