"""Numbers into an FMU and out of it: frames of replies, types of variables, inputs over time."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from math import floor
from typing import Any, NamedTuple

import numpy as np

_HEAD = struct.Struct("<8sQQQ")  # magic, number of the job, bytes of the text, bytes of the doubles
_MAGIC = b"aeroFMU1"
_LONGEST = 65536  # bytes of a text


def list_moved_controls(job: Mapping[str, Any]) -> list[str]:
    """Return the controls that the math pilot and the control law move.

    Their columns follow the outputs in this order.
    """
    controls: list[str] = []
    if job.get("pilot"):
        controls += job["pilot"]["move"]
    if job.get("law"):
        controls += job["law"]["moves"]
    return controls


def reply_columns(job: Mapping[str, Any], reply: Mapping[str, Any]) -> np.ndarray:
    """Return the numbers of a reply of `replay_job` (time, column); NaN for missing controls."""
    nan = np.full(len(job["time"]), np.nan)
    columns = [reply["moved"].get(name, nan) for name in list_moved_controls(job)]
    return np.column_stack([reply["outputs"], *columns])


def reply_bytes(number: int, error: str, columns: np.ndarray) -> bytes:
    """Return the reply to a job.

    Parameters
    ----------
    number : int
        Of the job.
    error : str
        Text of the failure, empty without a failure.
    columns : array (time, column)
        Empty if there are none.
    """
    text = error.encode("utf-8", "replace")[:_LONGEST]
    values = np.ascontiguousarray(columns, "<f8").tobytes()
    return _HEAD.pack(_MAGIC, number, len(text), len(values)) + text + values


def read_reply(
    read: Callable[[int], bytes], number: int, shape: tuple[int, int]
) -> tuple[str, np.ndarray | None]:
    """Return text and numbers of a reply; None for a reply without numbers.

    Parameters
    ----------
    read : callable
        Returns at most a number of bytes, none at the end.
    number : int
        Of the job.
    shape : (int, int)
        Of the numbers.

    Raises
    ------
    EOFError
        The bytes end.
    ValueError
        They are not a reply to this job, or a reply of another size.
    """
    magic, reply_number, length, size = _HEAD.unpack(_read_exactly(read, _HEAD.size))
    expected = 8 * shape[0] * shape[1]
    # The child is not trusted: its sizes are checked before anything of that size is read.
    is_reply = magic == _MAGIC and reply_number == number
    if not is_reply or length > _LONGEST or size not in (0, expected):
        raise ValueError("no reply to this job")
    text = _read_exactly(read, length).decode("utf-8", "replace")
    values = _read_exactly(read, size)
    if expected and not size:
        return text, None
    return text, np.frombuffer(values, "<f8").reshape(shape).astype(float)


def _read_exactly(read: Callable[[int], bytes], count: int) -> bytes:
    content = bytearray()
    while len(content) < count:
        part = read(count - len(content))
        if not part:
            raise EOFError("the reply breaks off")
        content += part
    return bytes(content)


REAL = ("Real", "Float32", "Float64")


class _PortGroup(NamedTuple):
    """Variables of one type: their columns and references, and the functions that set and get."""

    kind: str
    columns: list[int]
    references: list[int]
    put: Callable[..., Any]
    get: Callable[..., Any]


class Ports:
    """Variables of an instance that are set and read together, type by type.

    The caller uses a float for every type.

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
        kinds = [_function_kind(variable.type, version) for variable in variables]
        self.count = len(kinds)
        # FMPy 0.3 sets several Booleans of FMI 1.0 wrongly.
        self.one_by_one = version == 1
        self.groups: list[_PortGroup] = []
        for kind in dict.fromkeys(kinds):
            columns = [i for i, item in enumerate(kinds) if item == kind]
            self.groups.append(
                _PortGroup(
                    kind=kind,
                    columns=columns,
                    references=[variables[i].valueReference for i in columns],
                    put=getattr(instance, f"set{kind}"),
                    get=getattr(instance, f"get{kind}"),
                )
            )

    def put(self, values: Sequence[float] | np.ndarray) -> None:
        """Set all variables; a Boolean is true from 0.5 on, an Integer is rounded."""
        every = np.asarray(values, float).tolist()
        for group in self.groups:
            numbers = every
            # Often all variables have one type, and no selection is needed.
            if len(group.columns) != self.count:
                numbers = [every[i] for i in group.columns]
            if group.kind not in REAL:
                numbers = [_round_for(group.kind, number) for number in numbers]
            if group.kind == "Boolean" and self.one_by_one:
                for reference, number in zip(group.references, numbers, strict=True):
                    group.put([reference], [number])
            else:
                group.put(group.references, numbers)

    def get(self) -> list[float]:
        """Return all values."""
        if len(self.groups) == 1:
            group = self.groups[0]
            return [float(number) for number in group.get(group.references)]
        values = [0.0] * self.count
        for group in self.groups:
            for i, number in zip(group.columns, group.get(group.references), strict=True):
                values[i] = float(number)
        return values


def _function_kind(type_name: str, version: int) -> str:
    """Return the type of the function that sets a variable.

    An Enumeration is an Integer, in FMI 3.0 an Int64.
    """
    if type_name != "Enumeration":
        return type_name
    return "Int64" if version == 3 else "Integer"


def _round_for(kind: str, value: float) -> int | bool:
    """Return a value as a Boolean or as an integer."""
    if kind == "Boolean":
        return abs(value) >= 0.5
    # Halves are rounded up, unlike by `round`.
    return floor(value + 0.5)


class Course:
    """Inputs over time.

    Continuous Reals are linear between samples. All other inputs keep the value of a sample until
    the next one.

    Parameters
    ----------
    time : array (time,)
        From zero. [s]
    values : array (time, input)
    continuous : array of bool (input,)

    Attributes
    ----------
    added : array (input,)
        Correction by the math pilot or by a control law, until it changes.
    """

    def __init__(self, time: np.ndarray, values: np.ndarray, continuous: np.ndarray):
        self.time, self.values, self.continuous = time, values, continuous
        self.added = np.zeros(values.shape[1])
        # Per interval: middle and slope of the continuous inputs, first value of the others.
        change = np.where(continuous, np.diff(values, axis=0), 0.0)
        self._middles = values[:-1] + 0.5 * change
        self._slopes = change / np.diff(time)[:, None]

    def at(self, k: int) -> np.ndarray:
        """Return the inputs at sample `k`."""
        return self.values[k] + self.added

    def middle(self, k: int) -> np.ndarray:
        """Return the best constant inputs from sample `k` to the next.

        This is the middle, whose error is of second order.
        """
        return self._middles[k] + self.added

    def slope(self, k: int) -> np.ndarray:
        """Return the rates of the inputs from sample `k` to the next; zero if not continuous.
        [1/s]
        """
        return self._slopes[k]

    def between(self, t: float) -> np.ndarray:
        """Return the inputs at any time; after the last sample they are constant."""
        last = len(self.time) - 1
        k = min(max(int(np.searchsorted(self.time, t, side="right")) - 1, 0), last)
        if k == last:
            return self.at(k)
        # Linear between both samples; a time before the first sample has its value.
        share = max(t - self.time[k], 0.0) / (self.time[k + 1] - self.time[k])
        linear = (1.0 - share) * self.values[k] + share * self.values[k + 1]
        return np.where(self.continuous, linear, self.values[k]) + self.added


def course_of(time: np.ndarray, columns: Sequence[np.ndarray], variables: Sequence[Any]) -> Course:
    """Return the course of inputs from columns, one per variable.

    The time of the course starts with zero at the first sample.
    """
    values = np.zeros((len(time), 0))
    if len(columns):
        values = np.column_stack(columns)
    continuous = [_is_continuous(variable) for variable in variables]
    return Course(time - time[0], values, np.array(continuous, bool))


def _is_continuous(variable: Any) -> bool:
    """Return whether a variable is a Real that may change at any time."""
    return variable.type in REAL and variable.variability not in ("discrete", "tunable", "fixed")
