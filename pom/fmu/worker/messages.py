"""Numbers on their way into an FMU and out of it: types, and what stands between two samples."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from math import floor
from typing import Any

import numpy as np

_HEAD = struct.Struct("<8sQQQ")  # magic, number of the job, bytes of the text, bytes of the doubles
_MAGIC = b"aeroFMU1"
_LONGEST = 65536  # bytes of a text


def moved_controls(job: Mapping[str, Any]) -> list[str]:
    """Return the controls that the math pilot and the control law move, in the order of their
    columns behind the outputs.
    """
    return [
        *(job["pilot"]["move"] if job.get("pilot") else ()),
        *(job["law"]["moves"] if job.get("law") else ()),
    ]


def reply_columns(job: Mapping[str, Any], reply: Mapping[str, Any]) -> np.ndarray:
    """Return the numbers of a reply of `pom.fmu.worker.replay` (time, column); NaN for what did not
    come.
    """
    nothing = np.full(len(job["time"]), np.nan)
    return np.column_stack(
        [reply["outputs"], *(reply["moved"].get(name, nothing) for name in moved_controls(job))]
    )


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
    text, values = (
        error.encode("utf-8", "replace")[:_LONGEST],
        np.ascontiguousarray(columns, "<f8").tobytes(),
    )
    return _HEAD.pack(_MAGIC, number, len(text), len(values)) + text + values


def read_reply(
    read: Callable[[int], bytes], number: int, shape: tuple[int, int]
) -> tuple[str, np.ndarray | None]:
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
        They are not a reply to this job, or one of another size.
    """
    magic, answered, length, size = _HEAD.unpack(_exactly(read, _HEAD.size))
    wanted = 8 * shape[0] * shape[1]
    if magic != _MAGIC or answered != number or length > _LONGEST or size not in (0, wanted):
        raise ValueError("no reply to this job")
    text, values = _exactly(read, length).decode("utf-8", "replace"), _exactly(read, size)
    return text, np.frombuffer(values, "<f8").reshape(shape).astype(
        float
    ) if size or not wanted else None


def _exactly(read: Callable[[int], bytes], count: int) -> bytes:
    found = bytearray()
    while len(found) < count:
        part = read(count - len(found))
        if not part:
            raise EOFError("the reply breaks off")
        found += part
    return bytes(found)


REAL = ("Real", "Float32", "Float64")


class Ports:
    """Variables of an instance that are set and read together, type by type; every number is a
    float outside.

    Parameters
    ----------
    instance : object
        Of FMPy.
    version : int
        Major version of FMI.
    variables : sequence
        Of the model description.
    """

    def __init__(self, instance: Any, version: int, variables: Sequence[Any]):
        kinds = [_kind(variable.type, version) for variable in variables]
        self.count = len(kinds)
        self.one_by_one = version == 1  # FMPy 0.3 sets several Booleans of FMI 1.0 wrongly
        self.groups = []
        for kind in dict.fromkeys(kinds):
            columns = [i for i, other in enumerate(kinds) if other == kind]
            references = [variables[i].valueReference for i in columns]
            self.groups.append(
                (
                    kind,
                    columns,
                    references,
                    getattr(instance, f"set{kind}"),
                    getattr(instance, f"get{kind}"),
                )
            )

    def put(self, values: Sequence[float] | np.ndarray) -> None:
        """Set all; a Boolean is true from one half on, an Integer is rounded."""
        given = np.asarray(values, float).tolist()
        for kind, columns, references, put, _ in self.groups:
            numbers = given if len(columns) == self.count else [given[i] for i in columns]
            if kind not in REAL:
                numbers = [_whole(kind, number) for number in numbers]
            if kind == "Boolean" and self.one_by_one:
                for reference, number in zip(references, numbers, strict=True):
                    put([reference], [number])
            else:
                put(references, numbers)

    def get(self) -> list[float]:
        """Return all."""
        if len(self.groups) == 1:
            return [float(number) for number in self.groups[0][4](self.groups[0][2])]
        found = [0.0] * self.count
        for _, columns, references, _, get in self.groups:
            for i, number in zip(columns, get(references), strict=True):
                found[i] = float(number)
        return found


def _kind(word: str, version: int) -> str:
    """Return the type by which a variable is set: an Enumeration is an Integer, in FMI 3.0 an
    Int64.
    """
    if word == "Enumeration":
        return "Int64" if version == 3 else "Integer"
    return word


def _whole(kind: str, value: float) -> int | bool:
    return abs(value) >= 0.5 if kind == "Boolean" else floor(value + 0.5)


class Course:
    """Inputs over time: linear between samples; what is not a continuous Real keeps the value of a
    sample until the next.

    Parameters
    ----------
    time : array (time,)
        From zero. [s]
    values : array (time, input)
    continuous : array of bool (input,)

    Attributes
    ----------
    added : array (input,)
        What the math pilot adds, until it changes.
    """

    def __init__(self, time: np.ndarray, values: np.ndarray, continuous: np.ndarray):
        self.time, self.values, self.continuous = time, values, continuous
        self.added = np.zeros(values.shape[1])
        early, change = values[:-1], np.where(continuous, np.diff(values, axis=0), 0.0)
        self._middles, self._slopes = early + 0.5 * change, change / np.diff(time)[:, None]

    def at(self, k: int) -> np.ndarray:
        """Return the inputs at sample `k`."""
        return self.values[k] + self.added

    def middle(self, k: int) -> np.ndarray:
        """Return what is held best from sample `k` to the next: the middle, whose error is of
        second order.
        """
        return self._middles[k] + self.added

    def slope(self, k: int) -> np.ndarray:
        """Return the rates of change from sample `k` to the next; zero for what is not a continuous
        Real. [1/s]
        """
        return self._slopes[k]

    def between(self, t: float) -> np.ndarray:
        """Return the inputs at any time; behind the last sample they stay."""
        k = min(max(int(np.searchsorted(self.time, t, side="right")) - 1, 0), len(self.time) - 1)
        if k == len(self.time) - 1:
            return self.at(k)
        share = max(t - self.time[k], 0.0) / (self.time[k + 1] - self.time[k])
        return (
            np.where(
                self.continuous,
                (1.0 - share) * self.values[k] + share * self.values[k + 1],
                self.values[k],
            )
            + self.added
        )


def course_of(time: np.ndarray, columns: Sequence[np.ndarray], variables: Sequence[Any]) -> Course:
    """Return the course of inputs given by columns, one per variable; time is counted from its
    first sample.
    """
    values = np.column_stack(columns) if len(columns) else np.zeros((len(time), 0))
    continuous = [
        v.type in REAL and v.variability not in ("discrete", "tunable", "fixed") for v in variables
    ]
    return Course(time - time[0], values, np.array(continuous, bool))
