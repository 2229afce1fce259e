"""ArduPilot logs (DataFlash, ``.bin``): one table per message, ``NAME.1`` ... for the further
instances of a sensor.

The log describes itself: a message FMT gives number, length, name, format and columns of every
other, FMTU, UNIT and MULT their units and multipliers.  Values are given in the units so stated.
MODE gives the flight modes.  The clock is the autopilot's ``TimeUS`` or, in old logs, ``TimeMS``.

References
----------
.. [ArduPilot] AP_Logger, ``LogStructure.h``: message header, format characters, units and multipliers.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from flightmech.errors import ParseError
from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.recording import (
    ARDUPLANE,
    LeftOut,
    RecordedTable,
    Recording,
    first_present,
    flight_mode_changes,
)

_HEAD = 3  # bytes: 0xa3 0x95 and the number of the message
_VEHICLES = ("ArduPlane", "ArduCopter", "ArduRover", "Rover", "ArduSub", "Blimp", "AntennaTracker")
_FMT, _FMT_LENGTH = 128, 89
_TYPES = {  # format character: (numpy type, factor)
    "a": ("(32,)<i2", 1.0), "b": ("i1", 1.0), "B": ("u1", 1.0), "h": ("<i2", 1.0), "H": ("<u2", 1.0), "i": ("<i4", 1.0),
    "I": ("<u4", 1.0), "f": ("<f4", 1.0), "d": ("<f8", 1.0), "n": ("S4", 1.0), "N": ("S16", 1.0), "Z": ("S64", 1.0),
    "c": ("<i2", 0.01), "C": ("<u2", 0.01), "e": ("<i4", 0.01), "E": ("<u4", 0.01), "L": ("<i4", 1e-7), "M": ("u1", 1.0),
    "q": ("<i8", 1.0), "Q": ("<u8", 1.0), "g": ("<f2", 1.0),
}  # fmt: skip
_DESCRIBING = ("FMT", "FMTU", "UNIT", "MULT")  # messages that describe the others
_REMEDY = "map a column of one number in each message"
_UNITS = {
    "m/s/s": "m/s2",
    "degheading": "deg",
    "deglatitude": "deg",
    "deglongitude": "deg",
    "degC": "degC",
    "°C": "degC",
    "rad/s/s": "rad/s2",
}


@dataclass
class DataFlashMessage:
    """One kind of message: its layout, and what FMTU states about it."""

    name: str
    length: int
    dtype: np.dtype
    factors: dict[str, float]
    units: dict[str, str] = field(default_factory=dict)
    instance: str | None = None


def read(path: Path, names: NameMap) -> Recording:
    """Return the messages of an ArduPilot log as tables.

    Raises
    ------
    ParseError
        The file is damaged so that no message can be read.
    """
    raw = np.fromfile(path, np.uint8)
    found, lengths, notes = _messages(raw, path)
    at = _positions(raw, lengths)
    lost = _lost(at, raw, lengths)
    if lost:
        notes.append(f"{lost} bytes of the log fit no message and were skipped")
    rows = {kind: _rows(raw, at[raw[at + 2] == kind], message) for kind, message in found.items()}
    _describe(found, rows)
    tables: dict[str, RecordedTable] = {}
    left_out: list[LeftOut] = []
    for kind, message in found.items():
        tables.update(_tables(message, rows[kind]))
        left_out += _left_out(message, len(rows[kind]))
    if not tables:
        raise ParseError(str(path), 0, "no message with a clock", "an ArduPilot log with data")
    named = {message.name: rows[kind] for kind, message in found.items()}
    vehicle = _vehicle(named)
    facts = {"title": path.name.split(".")[0], **({"vehicle": vehicle} if vehicle else {})}
    return Recording(
        "dataflash",
        dict(sorted(tables.items())),
        facts,
        tuple(notes),
        _modes(tables, vehicle),
        tuple(left_out),
    )


def _vehicle(named: dict[str, np.ndarray]) -> str:
    """Return the vehicle of the firmware, which the log states in a text: ArduPlane, ArduCopter
    ...; empty when it does not.
    """
    texts = (
        named["MSG"]["Message"]
        if "Message" in (named.get("MSG", np.zeros(0)).dtype.names or ())
        else ()
    )
    words = (text.decode("ascii", "replace").partition(" ")[0] for text in texts)
    return next((word for word in words if word in _VEHICLES), "")


def _modes(tables: dict[str, RecordedTable], vehicle: str) -> tuple[tuple[float, str], ...]:
    """Return the flight modes of the message MODE; numbers of other vehicles than aeroplanes have
    no names here.
    """
    mode = tables.get("MODE")
    column = None if mode is None else first_present(("ModeNum", "Mode"), mode.columns)
    if mode is None or mode.time is None or column is None:
        return ()
    return flight_mode_changes(
        mode.time, mode.columns[column], ARDUPLANE if vehicle in ("", "ArduPlane") else {}
    )


def _messages(
    raw: np.ndarray, path: Path
) -> tuple[dict[int, DataFlashMessage], np.ndarray, list[str]]:
    """Return the kinds of messages, and the length of each by its number."""
    starts = _headers(raw, _FMT)
    starts = starts[starts + _FMT_LENGTH <= len(raw)]
    found: dict[int, DataFlashMessage] = {}
    lengths = np.zeros(256, np.int64)
    lengths[_FMT] = _FMT_LENGTH
    notes: list[str] = []
    for start in starts:
        kind, length, name, form, columns = struct.unpack(
            "<BB4s16s64s", raw[start + _HEAD : start + _FMT_LENGTH].tobytes()
        )
        text, form, columns = (
            part.split(b"\0")[0].decode("ascii", "replace") for part in (name, form, columns)
        )
        fields = columns.split(",") if columns else []
        if kind == _FMT or kind in found:
            continue
        unknown = set(form) - set(_TYPES)
        if (
            unknown
            or len(fields) != len(form)
            or len(set(fields)) != len(fields)
            or not all(fields)
        ):
            notes.append(
                f"message {text} at byte {start} has a layout that is not known ({form!r}, "
                f"{columns!r}); left out"
            )
            lengths[kind] = length
            continue
        dtype = np.dtype(
            [(column, _TYPES[char][0]) for column, char in zip(fields, form, strict=True)]
        )
        if dtype.itemsize + _HEAD != length:
            notes.append(
                f"message {text} at byte {start}: {length} bytes do not fit its format "
                f"{form!r}; left out"
            )
            lengths[kind] = length
            continue
        lengths[kind] = length
        factors = {column: _TYPES[char][1] for column, char in zip(fields, form, strict=True)}
        found[kind] = DataFlashMessage(text, length, dtype, factors)
    if not found:
        raise ParseError(
            str(path),
            0,
            "no message FMT that describes the others",
            "an ArduPilot DataFlash log (.bin)",
        )
    return found, lengths, notes


def _headers(raw: np.ndarray, kind: int | None = None) -> np.ndarray:
    """Return where two header bytes stand (and the number of a message after them)."""
    if len(raw) < _HEAD:
        return np.zeros(0, np.int64)
    at = np.flatnonzero(raw[:-2] == 0xA3)
    at = at[raw[at + 1] == 0x95]
    return at if kind is None else at[raw[at + 2] == kind]


def _positions(raw: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Return where messages begin: headers that follow each other without a gap, and never inside a
    message before.

    Header bytes can stand inside a message by chance; such a place has no neighbour at the right
    distance, or lies inside its message.
    """
    at = _headers(raw)
    length = lengths[raw[at + 2]]
    at, length = at[length > 0], length[length > 0]
    whole = at + length <= len(raw)
    at, length = at[whole], length[whole]
    ends = at + length
    after = np.minimum(np.searchsorted(at, ends), max(len(at) - 1, 0))
    linked = ends == len(raw)
    follows = at[after] == ends if len(at) else linked
    linked |= follows
    linked[after[follows]] = True
    at, ends = at[linked], ends[linked]
    keep = np.ones(len(at), bool)
    overlapped = np.flatnonzero(at[1:] < np.maximum.accumulate(ends)[:-1]) + 1
    last = 0
    for i in overlapped:
        previous = i - 1
        while not keep[previous]:
            previous -= 1
        last = max(last, int(ends[previous]))
        keep[i] = at[i] >= last
        if keep[i]:
            last = int(ends[i])
    return at[keep]


def _lost(at: np.ndarray, raw: np.ndarray, lengths: np.ndarray) -> int:
    return int(len(raw) - lengths[raw[at + 2]].sum()) if len(at) else len(raw)


def _rows(raw: np.ndarray, at: np.ndarray, message: DataFlashMessage) -> np.ndarray:
    """Return all messages of one kind as a structured array."""
    if not len(at):
        return np.zeros(0, message.dtype)
    body = raw[at[:, None] + np.arange(_HEAD, message.length)]
    return np.ascontiguousarray(body).view(message.dtype).ravel()


def _describe(found: dict[int, DataFlashMessage], rows: dict[int, np.ndarray]) -> None:
    """Enter units, multipliers and the instance column that FMTU, UNIT and MULT state."""
    named = {message.name: rows[kind] for kind, message in found.items()}
    if not {"FMTU", "UNIT", "MULT"} <= set(named):
        return
    if not all(
        {*wanted} <= set(named[name].dtype.names or ())
        for name, wanted in {
            "FMTU": ("FmtType", "UnitIds", "MultIds"),
            "UNIT": ("Id", "Label"),
            "MULT": ("Id", "Mult"),
        }.items()
    ):
        return
    units = {
        chr(int(row["Id"]) & 0xFF): row["Label"].decode("utf-8", "replace") for row in named["UNIT"]
    }
    factors = {chr(int(row["Id"]) & 0xFF): float(f"{row['Mult']:.7g}") for row in named["MULT"]}
    for row in named["FMTU"]:
        message = found.get(int(row["FmtType"]))
        if message is None:
            continue
        pairs = zip(
            message.dtype.names or (),
            row["UnitIds"].decode("latin-1"),
            row["MultIds"].decode("latin-1"),
            strict=False,
        )
        for column, unit, factor in pairs:
            if unit == "#":
                message.instance = column
            label = units.get(unit, "")
            if label and unit not in "-?#":
                message.units[column] = _UNITS.get(label, label)
            if (
                message.factors[column] == 1.0
                and factors.get(factor, 0.0) > 0.0
                and factor not in "-?"
            ):
                message.factors[column] = factors[factor]


def _tables(message: DataFlashMessage, rows: np.ndarray) -> dict[str, RecordedTable]:
    fields = message.dtype.names or ()
    clock = "TimeUS" if "TimeUS" in fields else "TimeMS" if "TimeMS" in fields else None
    if clock is None or not len(rows):
        return {}
    found: dict[str, RecordedTable] = {}
    numbers = np.asarray(rows[message.instance]) if message.instance in fields else None
    for number in np.unique(numbers) if numbers is not None else (None,):
        part = rows if number is None else rows[numbers == number]
        columns = {}
        for name in fields:
            if name == clock or part[name].dtype.kind not in "fiu":
                continue
            if part[name].ndim == 1:
                columns[name] = part[name].astype(float) * message.factors[name]
        label = message.name if number in (None, 0) else f"{message.name}.{number}"
        stamps = part[clock].astype(float) * (1e-6 if clock == "TimeUS" else 1e-3)
        found[label] = RecordedTable(
            columns, {name: unit for name, unit in message.units.items() if name in columns}, stamps
        )
    return found


def _left_out(message: DataFlashMessage, samples: int) -> list[LeftOut]:
    """Return the columns of a message that are no numbers, or the whole of one without a clock."""
    fields = message.dtype.names or ()
    if message.name in _DESCRIBING or not samples:
        return []
    if not {"TimeUS", "TimeMS"} & set(fields):
        return [LeftOut(message.name, f"{samples} messages without a time stamp", _REMEDY)]
    texts = [name for name in fields if message.dtype[name].kind == "S"]
    arrays = [name for name in fields if message.dtype[name].shape]
    return [
        *(LeftOut(f"{message.name}/{name}", "text", _REMEDY) for name in texts),
        *(
            LeftOut(
                f"{message.name}/{name}",
                f"{message.dtype[name].shape[0]} numbers in each message",
                _REMEDY,
            )
            for name in arrays
        ),
    ]
