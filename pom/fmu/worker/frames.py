"""A reply of the child as bytes: magic, number of the job, lengths, text of the failure, doubles.  Nothing in it is ever executed."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

_HEAD = struct.Struct("<8sQQQ")  # magic, number of the job, bytes of the text, bytes of the doubles
_MAGIC = b"aeroFMU1"
_LONGEST = 65536  # bytes of a text


def moved_controls(job: Mapping[str, Any]) -> list[str]:
    """Return the controls that the math pilot and the control law move, in the order of their columns behind the outputs."""
    return [*(job["pilot"]["move"] if job.get("pilot") else ()), *(job["law"]["moves"] if job.get("law") else ())]


def columns_of(job: Mapping[str, Any], reply: Mapping[str, Any]) -> np.ndarray:
    """Return the numbers of a reply of `pom.fmu.worker.replay` (time, column); NaN for what did not come."""
    nothing = np.full(len(job["time"]), np.nan)
    return np.column_stack([reply["outputs"], *(reply["moved"].get(name, nothing) for name in moved_controls(job))])


def reply_bytes(number: int, error: str, columns: np.ndarray) -> bytes:
    """Return the reply to a job.

    Parameters
    ----------
    number : int
        Of the job.
    error : str
        Text of the failure, empty when it went well.
    columns : array (time, column)
        Empty when there are none.
    """
    text, values = error.encode("utf-8", "replace")[:_LONGEST], np.ascontiguousarray(columns, "<f8").tobytes()
    return _HEAD.pack(_MAGIC, number, len(text), len(values)) + text + values


def read_reply(read: Callable[[int], bytes], number: int, shape: tuple[int, int]) -> tuple[str, np.ndarray | None]:
    """Return text and numbers of a reply; None where there are no numbers.

    Parameters
    ----------
    read : callable
        Returns up to so many bytes, none at the end.
    number : int
        Of the job that is answered.
    shape : (int, int)
        Of the numbers.

    Raises
    ------
    EOFError
        The bytes end.
    ValueError
        They are no reply to this job, or one of another size.
    """
    magic, answered, length, size = _HEAD.unpack(_exactly(read, _HEAD.size))
    wanted = 8 * shape[0] * shape[1]
    if magic != _MAGIC or answered != number or length > _LONGEST or size not in (0, wanted):
        raise ValueError("no reply to this job")
    text, values = _exactly(read, length).decode("utf-8", "replace"), _exactly(read, size)
    return text, np.frombuffer(values, "<f8").reshape(shape).astype(float) if size or not wanted else None


def _exactly(read: Callable[[int], bytes], count: int) -> bytes:
    found = bytearray()
    while len(found) < count:
        part = read(count - len(found))
        if not part:
            raise EOFError("the reply breaks off")
        found += part
    return bytes(found)
