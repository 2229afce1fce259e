"""Reader of MATLAB files up to version 7 with SciPy in a child process.

SciPy can crash on damaged bytes (SIGSEGV). The child process protects the calling process from the
crash (`flightmech.support.foreign_code`).

This module is also the program of the child. It gets a MAT file on standard input, and the options
as JSON in its argument. It writes a pickle to standard output: a pair of an empty text and the
content, or of the type and the text of an error. The pickle is not trusted: only arrays and plain
values are read of it.
"""

from __future__ import annotations

import io
import json
import os
import pickle
import sys
from typing import Any

from flightmech.errors import ParseError
from flightmech.support.foreign_code.process import (
    RunLimits,
    describe_exit,
    module_command,
    run_foreign,
    sandbox_for,
)
from flightmech.support.foreign_code.sandbox import read_sandbox_mode, uses_sandbox

# Time limit: start of the child [s], and rate of reading [byte s-1]. A file of sounds takes about
# 1 s, and another second per 100 MB.
_SECONDS, _RATE = 60.0, 5e6
# Address space of the child, and its output. [byte]
_MEMORY = 16_000_000_000
# Names of NumPy and SciPy in the pickle of an array.
_ARRAY_NAMES = ("_reconstruct", "ndarray", "dtype", "scalar", "_frombuffer")
_MATLAB_NAMES = ("MatlabFunction", "MatlabObject", "MatlabOpaque", "mat_struct")


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
    limit = _SECONDS + len(raw) / _RATE
    done = run_foreign(
        module_command(__name__, json.dumps(options)),
        raw,
        timeout=limit,
        limits=RunLimits(memory=_MEMORY),
        most=_MEMORY,
        sandbox=sandbox_for(uses_sandbox(read_sandbox_mode())),
    )
    if done.timed_out:
        return "time limit", f"SciPy did not read it in {limit:.0f} s"
    if done.code:
        end = describe_exit(done.code).removeprefix("signal ")
        return "crash", f"SciPy ended with {end}"
    if done.failure:
        return "size limit", done.failure
    try:
        kind, content = _ArrayUnpickler(io.BytesIO(done.output)).load()
    except Exception as error:
        # Bytes of a damaged process lead to errors of any type.
        return "crash", f"SciPy gave no content ({type(error).__name__})"
    return str(kind), content


class _ArrayUnpickler(pickle.Unpickler):
    """Reader of a pickle of arrays, numbers and texts, which runs no other function."""

    def find_class(self, module: str, name: str) -> Any:
        """Return one of the functions that build arrays and scalars.

        Raises
        ------
        UnpicklingError
            Another function.
        """
        is_array = module.split(".")[0] == "numpy" and name in _ARRAY_NAMES
        is_matlab = module.startswith("scipy.io.") and name in _MATLAB_NAMES
        if not (is_array or is_matlab):
            raise pickle.UnpicklingError(f"{module}.{name} is not an array")
        return super().find_class(module, name)


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
