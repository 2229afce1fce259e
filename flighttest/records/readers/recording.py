"""Raw recordings: columns over the clocks of a file, in the names and units of the file."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from flightmech.errors import AeromatchError
from flightmech.support.hdf5_seal import decoding_errors as decoding_errors

_PX4_FIRST = ("manual", "altitude", "position", "auto_mission", "auto_loiter", "auto_rtl")
_PX4_FROM_17 = (
    *("auto_takeoff", "auto_land", "auto_follow_target", "auto_precland", "orbit"),
    "auto_vtol_takeoff",
)
PX4 = {
    **dict(enumerate(_PX4_FIRST)),
    **{10: "acro", 12: "descend", 13: "termination", 14: "offboard", 15: "stabilized"},
    **dict(enumerate(_PX4_FROM_17, start=17)),
}
"""Flight modes [PX4]. Numbers that changed their meaning between releases are omitted."""
_ARDUPLANE_FIRST = (
    *("manual", "circle", "stabilize", "training", "acro", "fbwa", "fbwb", "cruise", "autotune"),
)
_ARDUPLANE_FROM_10 = (
    *("auto", "rtl", "loiter", "takeoff", "avoid_adsb", "guided", "initialising"),
    *("qstabilize", "qhover", "qloiter", "qland", "qrtl", "qautotune", "qacro"),
    *("thermal", "loiter_alt_qland"),
)
ARDUPLANE = {
    **dict(enumerate(_ARDUPLANE_FIRST)),
    **dict(enumerate(_ARDUPLANE_FROM_10, start=10)),
}
"""Flight modes of ArduPlane."""


def flight_mode_changes(
    times: np.ndarray, numbers: np.ndarray, names: Mapping[int, str]
) -> tuple[tuple[float, str], ...]:
    """Return start [s] and name of each flight mode.

    A number without a name gives ``mode_7``.  A mode that is logged again continues.
    """
    if not len(times):
        return ()
    order = np.argsort(times, kind="stable")
    times, numbers = np.asarray(times, float)[order], np.asarray(numbers, int)[order]
    changes = []
    for k in np.flatnonzero(np.concatenate([[True], np.diff(numbers) != 0])):
        number = int(numbers[k])
        changes.append((float(times[k]), names.get(number, f"mode_{number}")))
    return tuple(changes)


def flight_mode_rows(
    modes: Sequence[tuple[float, str]], start: float, end: float
) -> list[dict[str, object]]:
    """Return the modes as manoeuvres between start and end of a record.

    A row is ``manoeuvre control start end note``. [s]
    """
    rows: list[dict[str, object]] = []
    ends = [time for time, _ in modes[1:]] + [np.inf]
    for (mode_start, name), mode_end in zip(modes, ends, strict=True):
        first, last = max(mode_start, start), min(mode_end, end)
        if last > first:
            rows.append(
                {
                    "manoeuvre": name,
                    "control": "",
                    "start": first,
                    "end": last,
                    "note": "flight mode of the log",
                }
            )
    return rows


CLOCK_NAMES = ("time", "t", "Time", "TIME", "T", "timestamp", "Timestamp")
# Other names of a clock, in lower case without separators.  Names of a running time precede names
# of a time of day.
_CLOCK_WORDS = (
    *("time", "elapsedtime", "timeelapsed", "elapsed", "relativetime", "reltime"),
    *("flighttime", "missiontime", "recordtime", "rectime"),
    *("recordertime", "systemtime", "systime", "seconds", "sec", "secs", "clock"),
    *("timestamp", "datetime", "dateandtime", "dateutc"),
    *("utc", "gmt", "timeutc", "utctime", "timegmt", "gmttime", "utctimestamp", "zulu"),
    *("zulutime", "irig", "irigb", "irigtime"),
    *("irigbtime", "timeofday", "tod", "localtime", "gpstime", "timegps", "stamp", "tsec"),
    *("times", "times1", "zeit", "uhrzeit"),
)
_UNIT_OF_A_CLOCK = re.compile(
    r"[\s_]*[(\[]?(s|sec|secs|seconds|ms|us|hh:mm:ss\S*|hhmmss)[)\]]?$", re.IGNORECASE
)
_NOTHING: Mapping[str, Any] = MappingProxyType({})
WIDEST = 4096
"""Largest number of columns of a two-dimensional array. An image has more."""
# Samples from which a table is known to have a clock.
_FEWEST_STAMPS = 2
# Stamps that are looked at for it.
_FIRST_STAMPS = 1000
# Smallest share of the steps of a clock that rise.
_RISING = 0.95


class Columns(Mapping[str, np.ndarray]):
    """Columns by name. Each is read from the file at its first request."""

    def __init__(self, loaders: Mapping[str, Callable[[], Any]]):
        self._loaders = dict(loaders)
        self._read: dict[str, np.ndarray] = {}

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self._read:
            self._read[name] = np.asarray(self._loaders[name]())
        return self._read[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._loaders)

    def __len__(self) -> int:
        return len(self._loaders)

    def __contains__(self, name: object) -> bool:
        return name in self._loaders


class RecordedTable(NamedTuple):
    """Columns over one clock.

    Attributes
    ----------
    columns : mapping of str to array (time,)
        As recorded.
    units : mapping of str to str
        Units as the file states them; names without a unit are missing.
    time : array (time,) or None
        Stamps of the format's own clock [s]; None where one of the columns is the clock.
    flags : str
        Flags of a record that this package wrote (JSON), else empty.
    errors : mapping of str to float
        Standard errors of columns as the file states them, in the unit of the column.
    """

    columns: Mapping[str, np.ndarray]
    units: Mapping[str, str] = _NOTHING
    time: np.ndarray | None = None
    flags: str = ""
    errors: Mapping[str, float] = _NOTHING


class LeftOut(NamedTuple):
    """A part of a file that a reader omits, and the reason.

    Attributes
    ----------
    place : str
        Table, or table/column, as a name map would name it.
    reason : str
        Content that a record cannot hold.
    remedy : str
        Action if a name map needs it; empty if a record does without it.
    fault : str
        The first cell that is neither number nor word in a column of numbers, which is then
        damaged; else empty.
    line : int
        Line of this cell in a file of text.
    """

    place: str
    reason: str
    remedy: str = ""
    fault: str = ""
    line: int = 0


class Recording(NamedTuple):
    """Content of a file in the format of all readers.

    Attributes
    ----------
    kind : str
        Format, a key of `flighttest.records.readers.opening.FORMATS`.
    tables : dict of str to RecordedTable
    facts : mapping
        Attributes for the root of the record.
    notes : tuple of str
        Faults that the file itself reports.
    modes : tuple of (float, str)
        Flight modes in the log of an autopilot: start on the clock of the format [s], and name.
    left_out : tuple of LeftOut
        Parts of the file that are not in the tables.
    modes_table : str
        Table with the flight modes, of which the name map may describe the clock.
    """

    kind: str
    tables: dict[str, RecordedTable]
    facts: Mapping[str, Any] = _NOTHING
    notes: tuple[str, ...] = ()
    modes: tuple[tuple[float, str], ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    modes_table: str = ""


def clock_name(columns: Mapping[str, Any]) -> str | None:
    """Return the column of a table that is its clock by its name.

    The name is one of `CLOCK_NAMES`, or another name such as ``UTC`` or ``Elapsed Time``.  A column
    with another name must rise in 19 of 20 steps: a time of day at one sample per second is not a
    clock.
    """
    name = first_present(CLOCK_NAMES, columns)
    if name is not None:
        return name
    # The first column of several with the same word counts.
    column_of_word: dict[str, str] = {}
    for column in columns:
        column_of_word.setdefault(_clock_word(column), column)
    for word in _CLOCK_WORDS:
        if word in column_of_word and rises(columns[column_of_word[word]]):
            return column_of_word[word]
    return None


def _clock_word(name: str) -> str:
    """Return a name in lower case without its group, unit and separators."""
    bare = re.sub(r"\s*[(\[]hhmmss\S*[)\]]$", "", name, flags=re.IGNORECASE)
    heading = re.split(r"[./]", bare)[-1].strip()
    plain = _UNIT_OF_A_CLOCK.sub("", heading) or heading
    return re.sub(r"[^a-z0-9]", "", plain.lower())


def rises(values: Any) -> bool:
    """Return whether a column rises in 19 of 20 steps."""
    try:
        stamps = np.asarray(values, float)
    except (ValueError, TypeError):
        return False
    steps = np.diff(stamps[np.isfinite(stamps)])
    return len(steps) > 0 and float(np.mean(steps > 0.0)) > _RISING


def left_out_as(requested: str, leaf: str, left_out: Iterable[LeftOut]) -> LeftOut | None:
    """Return the omitted part that a name map means by a column.

    The name map gives ``table/column``, or a column of the table of the leaf.
    """
    # An element of an array has the name of the array.
    plain = re.sub(r"\[\d+\]$", "", requested)
    table, _, column = plain.rpartition("/")
    names = {requested, plain, table or leaf, f"{leaf}/{plain}"}
    for omission in left_out:
        heading = omission.place.rpartition("/")[2]
        is_heading = not table and column == heading
        if omission.place in names or is_heading or omission.place.endswith(f"/{plain}"):
            return omission
    return None


def left_out_clock(left_out: Iterable[LeftOut]) -> LeftOut | None:
    """Return the first omitted column that is a clock by its name."""
    for omission in left_out:
        heading = omission.place.rpartition("/")[2]
        if heading in CLOCK_NAMES or _clock_word(heading) in _CLOCK_WORDS:
            return omission
    return None


def without_short_tables(recording: Recording) -> Recording:
    """Return a recording without the tables whose own clock has fewer than two samples.

    The recording lists them as omitted.  A file that has only such tables keeps them, so that
    reading them is an error that names their clock.
    """
    short: dict[str, int] = {}
    for name, table in recording.tables.items():
        if table.time is not None:
            count = _count_stamps(table.time)
            if count < _FEWEST_STAMPS:
                short[name] = count
    if len(short) == len(recording.tables):
        return recording
    texts = {0: "no sample with a time stamp", 1: "1 sample"}
    left_out = []
    for omission in recording.left_out:
        # A table that is omitted includes its omitted columns.
        if omission.place.rpartition("/")[0] not in short:
            left_out.append(omission)
    for name, count in short.items():
        left_out.append(LeftOut(name, f"{texts[count]}; a clock needs two samples"))
    tables = {name: table for name, table in recording.tables.items() if name not in short}
    return recording._replace(tables=tables, left_out=tuple(left_out))


def _count_stamps(time: np.ndarray) -> int:
    """Return the number of finite stamps, `_FEWEST_STAMPS` for any larger number."""
    if len(time) > _FIRST_STAMPS:
        return _FEWEST_STAMPS
    count = int(np.count_nonzero(np.isfinite(np.asarray(time, float))))
    return min(count, _FEWEST_STAMPS)


def columns_of_array(
    name: str, shape: tuple[int, ...], length: int
) -> dict[str, Callable[[Any], np.ndarray]]:
    """Return the columns of an array of a file over a clock of `length` samples.

    A vector is one column.  A matrix with one row or one column per sample has the columns
    ``name[0]``, ``name[1]``, ...  A single number is a constant column.  Any other array has no
    column, see `not_spread`.

    Returns
    -------
    dict of str to callable
        Name of the column -> function that takes it from the array.
    """
    # A single number is a constant; a vector or a narrow matrix has samples along the longer side.
    size = int(np.prod(shape, dtype=np.int64))
    if size == 1:
        return {name: partial(_repeat_number, length)}
    if size == length and max(shape) == length:
        return {name: np.ravel}
    if len(shape) == 2 and shape[0] == length and shape[1] <= WIDEST:
        return {f"{name}[{i}]": partial(_take_slice, i, 1) for i in range(shape[1])}
    if len(shape) == 2 and shape[1] == length and shape[0] <= WIDEST:
        return {f"{name}[{i}]": partial(_take_slice, i, 0) for i in range(shape[0])}
    return {}


def not_spread(shape: tuple[int, ...], length: int) -> str:
    """Return the reason why `columns_of_array` has no column of an array."""
    sizes = " x ".join(map(str, shape))
    if 0 in shape:
        return "an empty array"
    if len(shape) == 2 and length in shape:
        return f"a matrix of {sizes}; at most {WIDEST} columns of one matrix are read"
    if len(shape) > 2:
        return f"an array of {sizes}; arrays of one or two dimensions are read"
    return f"an array of {sizes}; the clock of its table has {length} samples"


def _repeat_number(length: int, x: Any) -> np.ndarray:
    return np.broadcast_to(np.asarray(x, float).ravel(), length)


def _take_slice(i: int, axis: int, x: Any) -> np.ndarray:
    return np.take(x, i, axis)


def missing_package(package: str, extra: str, path: str | Path) -> AeromatchError:
    """Return the error of a format whose package is not installed."""
    return AeromatchError(
        f"{path}: reading it needs the package {package}; install it with: pip install "
        f"'aeromatch[{extra}]'"
    )


def first_present(names: Iterable[str], among: Mapping[str, Any]) -> str | None:
    """Return the first of `names` in `among`, or None."""
    return next((name for name in names if name in among), None)
