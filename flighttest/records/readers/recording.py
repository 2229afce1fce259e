"""Raw recordings: columns over the clocks of a file, as they stand in it, not yet in canonical
names.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from flightmech.errors import AeromatchError, ParseError

PX4 = {
    **dict(
        enumerate(("manual", "altitude", "position", "auto_mission", "auto_loiter", "auto_rtl"))
    ),
    **{10: "acro", 12: "descend", 13: "termination", 14: "offboard", 15: "stabilized"},
    **dict(
        enumerate(
            (
                "auto_takeoff",
                "auto_land",
                "auto_follow_target",
                "auto_precland",
                "orbit",
                "auto_vtol_takeoff",
            ),
            start=17,
        )
    ),
}
"""[PX4] Numbers that changed their meaning between releases are left out."""
ARDUPLANE = {
    **dict(
        enumerate(
            (
                "manual",
                "circle",
                "stabilize",
                "training",
                "acro",
                "fbwa",
                "fbwb",
                "cruise",
                "autotune",
            )
        )
    ),
    **dict(
        enumerate(
            ("auto", "rtl", "loiter", "takeoff", "avoid_adsb", "guided", "initialising"), start=10
        )
    ),
    **dict(
        enumerate(
            (
                "qstabilize",
                "qhover",
                "qloiter",
                "qland",
                "qrtl",
                "qautotune",
                "qacro",
                "thermal",
                "loiter_alt_qland",
            ),
            start=17,
        )
    ),
}


def flight_mode_changes(
    times: np.ndarray, numbers: np.ndarray, names: Mapping[int, str]
) -> tuple[tuple[float, str], ...]:
    """Return when each flight mode begins and its name, ``mode_7`` for a number without one; a mode
    that is logged again goes on.
    """
    if not len(times):
        return ()
    order = np.argsort(times, kind="stable")
    times, numbers = np.asarray(times, float)[order], np.asarray(numbers, int)[order]
    begin = np.flatnonzero(np.concatenate([[True], np.diff(numbers) != 0]))
    return tuple((float(times[k]), names.get(int(numbers[k]), f"mode_{numbers[k]}")) for k in begin)


def flight_mode_rows(
    modes: Sequence[tuple[float, str]], start: float, end: float
) -> list[dict[str, object]]:
    """Return the modes as manoeuvres between start and end of a record: ``manoeuvre control start
    end note``. [s]
    """
    ends = [time for time, _ in modes[1:]] + [np.inf]
    spans = [
        (name, max(begin, start), min(until, end))
        for (begin, name), until in zip(modes, ends, strict=True)
    ]
    about = "flight mode of the log"
    return [
        {"manoeuvre": name, "control": "", "start": a, "end": b, "note": about}
        for name, a, b in spans
        if b > a
    ]


CLOCK_NAMES = ("time", "t", "Time", "TIME", "T", "timestamp", "Timestamp")
# other names of a clock, without separators in lower case, those of a running time before those of
# a time of day
_CLOCK_WORDS = (
    *(
        "time",
        "elapsedtime",
        "timeelapsed",
        "elapsed",
        "relativetime",
        "reltime",
        "flighttime",
        "missiontime",
        "recordtime",
        "rectime",
    ),
    *(
        "recordertime",
        "systemtime",
        "systime",
        "seconds",
        "sec",
        "secs",
        "clock",
        "timestamp",
        "datetime",
        "dateandtime",
        "dateutc",
    ),
    *(
        "utc",
        "gmt",
        "timeutc",
        "utctime",
        "timegmt",
        "gmttime",
        "utctimestamp",
        "zulu",
        "zulutime",
        "irig",
        "irigb",
        "irigtime",
    ),
    *(
        "irigbtime",
        "timeofday",
        "tod",
        "localtime",
        "gpstime",
        "timegps",
        "stamp",
        "tsec",
        "times",
        "times1",
        "zeit",
        "uhrzeit",
    ),
)
_UNIT_OF_A_CLOCK = re.compile(
    r"[\s_]*[(\[]?(s|sec|secs|seconds|ms|us|hh:mm:ss\S*|hhmmss)[)\]]?$", re.IGNORECASE
)
_NOTHING: Mapping[str, Any] = MappingProxyType({})
WIDEST = 4096  # columns that one two-dimensional array may give; an image has more
_NOT_OF_THE_CONTENT = (
    AeromatchError,
    FileNotFoundError,
    PermissionError,
    IsADirectoryError,
    ImportError,
)


class Columns(Mapping[str, np.ndarray]):
    """Columns by name, each read from the file when it is requested the first time."""

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
        Flags that a record written by this package carries (JSON), else empty.
    errors : mapping of str to float
        Standard errors of columns as the file states them, in the unit of the column.
    """

    columns: Mapping[str, np.ndarray]
    units: Mapping[str, str] = _NOTHING
    time: np.ndarray | None = None
    flags: str = ""
    errors: Mapping[str, float] = _NOTHING


class LeftOut(NamedTuple):
    """What a reader leaves out of a file, and why.

    Attributes
    ----------
    place : str
        Table, or table/column, as a name map would name it.
    reason : str
        What it holds that a record cannot hold.
    remedy : str
        What to do when a name map needs it; empty where a record does without it.
    fault : str
        The first cell that is neither number nor word in a column of numbers, which is then
        damaged; else empty.
    line : int
        Its line in a file of text.
    """

    place: str
    reason: str
    remedy: str = ""
    fault: str = ""
    line: int = 0


class Recording(NamedTuple):
    """What a reader found: the format, tables by name, facts for the root of the record, and faults
    reported by the file itself.

    `left_out` names what is in the file and not in the tables.

    `modes` of the log of an autopilot are the flight modes: when each begins on the clock of the
    format [s], and its name.
    """

    kind: str
    tables: dict[str, RecordedTable]
    facts: Mapping[str, Any] = _NOTHING
    notes: tuple[str, ...] = ()
    modes: tuple[tuple[float, str], ...] = ()
    left_out: tuple[LeftOut, ...] = ()


@contextmanager
def decoding_errors(path: str | Path, expected: str) -> Iterator[None]:
    """Turn whatever a decoder raises on damaged bytes into a ParseError that names the file."""
    try:
        yield
    except _NOT_OF_THE_CONTENT:
        raise
    except Exception as error:
        text = " ".join(str(error).split())
        raise ParseError(
            str(path),
            0,
            f"content that cannot be decoded ({type(error).__name__}: {text})",
            expected,
        ) from error


def clock_name(columns: Mapping[str, Any]) -> str | None:
    """Return the column of a table that is its clock by its name: one of `CLOCK_NAMES`, or ``UTC``,
    ``Elapsed Time`` and the like.

    Of those other names only a column counts that rises in 19 of 20 steps: a time of day at one
    sample per second is not a clock.
    """
    if plain := first_present(CLOCK_NAMES, columns):
        return plain
    words = {_clock_word(name): name for name in reversed(list(columns))}
    candidates = [words[word] for word in _CLOCK_WORDS if word in words]
    return next((name for name in candidates if rises(columns[name])), None)


def _clock_word(name: str) -> str:
    """Return a name in lower case without its group, unit and separators."""
    bare = re.sub(r"\s*[(\[]hhmmss\S*[)\]]$", "", name, flags=re.IGNORECASE)
    own = re.split(r"[./]", bare)[-1].strip()
    plain = _UNIT_OF_A_CLOCK.sub("", own) or own
    return re.sub(r"[^a-z0-9]", "", plain.lower())


def rises(values: Any) -> bool:
    """Return whether a column rises in 19 of 20 steps."""
    try:
        stamps = np.asarray(values, float)
    except (ValueError, TypeError):
        return False
    steps = np.diff(stamps[np.isfinite(stamps)])
    return len(steps) > 0 and float(np.mean(steps > 0.0)) > 0.95


def left_out_as(wanted: str, leaf: str, left_out: Iterable[LeftOut]) -> LeftOut | None:
    """Return what was left out under the name that a map gives to a column: ``table/column``, or a
    column of the leaf's own table.
    """
    plain = re.sub(r"\[\d+\]$", "", wanted)
    table, _, column = plain.rpartition("/")
    names = {wanted, plain, table or leaf, f"{leaf}/{plain}"}
    for one in left_out:
        heading = one.place.rpartition("/")[2]
        if (
            one.place in names
            or (not table and column == heading)
            or one.place.endswith(f"/{plain}")
        ):
            return one
    return None


def without_short_tables(recording: Recording) -> Recording:
    """Return a recording without the tables of fewer than two samples over a clock of their own,
    which are named as left out.

    A file of such tables only keeps them: reading them is an error that names their clock.
    """
    counts = {name: _stamps(table) for name, table in recording.tables.items()}
    short = {name: count for name, count in counts.items() if count is not None and count < 2}
    if len(short) == len(counts):
        return recording
    words = {0: "no sample with a time stamp", 1: "1 sample"}
    left_out = [
        LeftOut(name, f"{words[count]}; a clock needs two samples") for name, count in short.items()
    ]
    tables = {name: table for name, table in recording.tables.items() if name not in short}
    others = [one for one in recording.left_out if one.place.rpartition("/")[0] not in short]
    return recording._replace(tables=tables, left_out=(*others, *left_out))


def _stamps(table: RecordedTable) -> int | None:
    """Return the number of stamps of a table with a clock of its own, 2 for any larger number."""
    if table.time is None:
        return None
    stamps = np.asarray(table.time, float)[:1000]
    return (
        min(int(np.count_nonzero(np.isfinite(stamps))), 2) if len(table.time) <= len(stamps) else 2
    )


def columns_of_array(
    name: str, shape: tuple[int, ...], length: int
) -> dict[str, Callable[[Any], np.ndarray]]:
    """Return the columns that an array of a file gives over a clock of `length` samples: column
    name -> how to take it.

    A vector is one column; a matrix with one row per sample, or one column per sample, gives
    ``name[0]``, ``name[1]``, ...; a single number holds all along; anything else gives none, see
    `not_spread`.
    """
    size = int(np.prod(shape, dtype=np.int64))
    if size == 1:
        return {name: partial(_constant, length)}
    if size == length and max(shape) == length:
        return {name: np.ravel}
    if len(shape) == 2 and shape[0] == length and shape[1] <= WIDEST:
        return {f"{name}[{i}]": partial(_slice, i, 1) for i in range(shape[1])}
    if len(shape) == 2 and shape[1] == length and shape[0] <= WIDEST:
        return {f"{name}[{i}]": partial(_slice, i, 0) for i in range(shape[0])}
    return {}


def not_spread(shape: tuple[int, ...], length: int) -> str:
    """Return why `columns_of_array` gives no column of an array."""
    sizes = " x ".join(map(str, shape))
    if 0 in shape:
        return "an empty array"
    if len(shape) == 2 and length in shape:
        return f"a matrix of {sizes}; at most {WIDEST} columns of one matrix are read"
    if len(shape) > 2:
        return f"an array of {sizes}; arrays of one or two dimensions are read"
    return f"an array of {sizes}; the clock of its table has {length} samples"


def _constant(length: int, x: Any) -> np.ndarray:
    return np.broadcast_to(np.asarray(x, float).ravel(), length)


def _slice(i: int, axis: int, x: Any) -> np.ndarray:
    return np.take(x, i, axis)


def missing_package(package: str, extra: str, path: str | Path) -> AeromatchError:
    """Return the error of a format whose package is not installed."""
    return AeromatchError(
        f"{path}: reading it needs the package {package}; install it with: pip install "
        f"'aeromatch[{extra}]'"
    )


def first_present(names: Iterable[str], among: Mapping[str, Any]) -> str | None:
    """Return the first of `names` that is there."""
    return next((name for name in names if name in among), None)
