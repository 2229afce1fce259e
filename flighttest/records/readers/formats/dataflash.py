"""ArduPilot logs (DataFlash, ``.bin``), one table per message.

Further instances of a sensor have the tables ``NAME.1`` ...  The log describes itself.  A message
FMT gives number, length, name, format and columns of every other message.  FMTU, UNIT and MULT give
their units and multipliers.  Values are in these units.  MODE gives the flight modes.  The clock is
the column ``TimeUS`` of the autopilot or, in old logs, ``TimeMS``.

References
----------
.. [ArduPilot] AP_Logger, ``LogStructure.h``: message header, format characters, units and
   multipliers.
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
_TYPES = {  # format character: (NumPy type, factor)
    "a": ("(32,)<i2", 1.0),
    "b": ("i1", 1.0),
    "B": ("u1", 1.0),
    "h": ("<i2", 1.0),
    "H": ("<u2", 1.0),
    "i": ("<i4", 1.0),
    "I": ("<u4", 1.0),
    "f": ("<f4", 1.0),
    "d": ("<f8", 1.0),
    "n": ("S4", 1.0),
    "N": ("S16", 1.0),
    "Z": ("S64", 1.0),
    "c": ("<i2", 0.01),
    "C": ("<u2", 0.01),
    "e": ("<i4", 0.01),
    "E": ("<u4", 0.01),
    "L": ("<i4", 1e-7),
    "M": ("u1", 1.0),
    "q": ("<i8", 1.0),
    "Q": ("<u8", 1.0),
    "g": ("<f2", 1.0),
}
_DESCRIBING = ("FMT", "FMTU", "UNIT", "MULT")  # messages that describe the others
# Columns of the describing messages that units and multipliers need.
_DESCRIBING_COLUMNS = {
    "FMTU": ("FmtType", "UnitIds", "MultIds"),
    "UNIT": ("Id", "Label"),
    "MULT": ("Id", "Mult"),
}
_SECONDS = {"TimeUS": 1e-6, "TimeMS": 1e-3}  # s, one count of a clock
_MODE = "MODE"  # message with the flight modes
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
    """One kind of message: its layout, and its units and factors by FMTU."""

    name: str
    length: int
    dtype: np.dtype
    factors: dict[str, float]
    units: dict[str, str] = field(default_factory=dict)
    instance: str | None = None

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the columns."""
        return self.dtype.names or ()


def read(path: Path, names: NameMap) -> Recording:
    """Return the messages of an ArduPilot log as tables.

    Raises
    ------
    ParseError
        The file is damaged so that no message can be read.
    """
    raw = np.fromfile(path, np.uint8)
    messages, lengths, notes = _read_formats(raw, path)
    starts = _message_starts(raw, lengths)
    skipped = _skipped_bytes(starts, raw, lengths)
    if skipped:
        notes.append(f"{skipped} bytes of the log fit no message and were skipped")
    rows = {}
    for kind, message in messages.items():
        rows[kind] = _read_rows(raw, starts[raw[starts + 2] == kind], message)
    by_name = {message.name: rows[kind] for kind, message in messages.items()}
    _add_units(messages, by_name)

    tables: dict[str, RecordedTable] = {}
    left_out: list[LeftOut] = []
    for kind, message in messages.items():
        tables.update(_message_tables(message, rows[kind]))
        left_out += _omitted_columns(message, len(rows[kind]))
    if not tables:
        raise ParseError(
            str(path), 0, found="no message with a clock", expected="an ArduPilot log with data"
        )
    vehicle = _vehicle(by_name)
    facts = {"title": path.name.split(".")[0]}
    if vehicle:
        facts["vehicle"] = vehicle
    return Recording(
        "dataflash",
        dict(sorted(tables.items())),
        facts,
        notes=tuple(notes),
        modes=_flight_modes(tables, vehicle),
        left_out=tuple(left_out),
        modes_table=_MODE,
    )


def _vehicle(by_name: dict[str, np.ndarray]) -> str:
    """Return the vehicle that the firmware states in a text, empty if there is none."""
    texts = by_name.get("MSG", np.zeros(0))
    if "Message" not in (texts.dtype.names or ()):
        return ""
    for text in texts["Message"]:
        firmware = text.split(b"\0")[0].decode("ascii", "replace").partition(" ")[0]
        if firmware in _VEHICLES:
            return firmware
    return ""


def _flight_modes(tables: dict[str, RecordedTable], vehicle: str) -> tuple[tuple[float, str], ...]:
    """Return the flight modes of the message MODE.

    Only the numbers of aeroplanes have names here.
    """
    mode = tables.get(_MODE)
    if mode is None or mode.time is None:
        return ()
    column = first_present(("ModeNum", "Mode"), mode.columns)
    if column is None:
        return ()
    mode_names = ARDUPLANE if vehicle in ("", "ArduPlane") else {}
    return flight_mode_changes(mode.time, mode.columns[column], mode_names)


def _read_formats(
    raw: np.ndarray, path: Path
) -> tuple[dict[int, DataFlashMessage], np.ndarray, list[str]]:
    """Return the kinds of messages, the length of each by its number, and notes. [bytes]"""
    starts = _find_headers(raw, _FMT)
    starts = starts[starts + _FMT_LENGTH <= len(raw)]
    messages: dict[int, DataFlashMessage] = {}
    lengths = np.zeros(256, np.int64)
    lengths[_FMT] = _FMT_LENGTH
    notes: list[str] = []
    for start in starts:
        # FMT: number and length of a message, its name, a letter per field, and the names of the
        # fields.
        kind, length, *texts = struct.unpack(
            "<BB4s16s64s", raw[start + _HEAD : start + _FMT_LENGTH].tobytes()
        )
        if kind == _FMT or kind in messages:
            continue
        lengths[kind] = length
        name, characters, columns = (
            text.split(b"\0")[0].decode("ascii", "replace") for text in texts
        )
        fields = columns.split(",") if columns else []
        if not _is_known_layout(characters, fields):
            notes.append(
                f"message {name} at byte {start} has a layout that is not known ({characters!r}, "
                f"{columns!r}); left out"
            )
            continue
        types = [(column, _TYPES[c][0]) for column, c in zip(fields, characters, strict=True)]
        dtype = np.dtype(types)
        # A header pattern inside other data looks like a message; its length does not fit.
        if dtype.itemsize + _HEAD != length:
            notes.append(
                f"message {name} at byte {start}: {length} bytes do not fit its format "
                f"{characters!r}; left out"
            )
            continue
        factors = {column: _TYPES[c][1] for column, c in zip(fields, characters, strict=True)}
        messages[kind] = DataFlashMessage(name, length, dtype, factors)
    if not messages:
        raise ParseError(
            str(path),
            0,
            found="no message FMT that describes the others",
            expected="an ArduPilot DataFlash log (.bin)",
        )
    return messages, lengths, notes


def _is_known_layout(characters: str, fields: list[str]) -> bool:
    """Return whether each field has a unique name and a known format character."""
    is_unique = len(set(fields)) == len(fields) == len(characters)
    return is_unique and all(fields) and set(characters) <= set(_TYPES)


def _find_headers(raw: np.ndarray, kind: int | None = None) -> np.ndarray:
    """Return the positions of two header bytes, if stated only those of one kind of message."""
    if len(raw) < _HEAD:
        return np.zeros(0, np.int64)
    positions = np.flatnonzero(raw[:-2] == 0xA3)
    positions = positions[raw[positions + 1] == 0x95]
    if kind is None:
        return positions
    return positions[raw[positions + 2] == kind]


def _message_starts(raw: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Return the positions where messages begin.

    Header bytes can occur inside a message by chance.  Such a position has no neighbour at the
    right distance, or lies inside a message that begins before it.
    """
    starts = _find_headers(raw)
    length = lengths[raw[starts + 2]]
    starts, length = starts[length > 0], length[length > 0]
    is_complete = starts + length <= len(raw)
    starts, length = starts[is_complete], length[is_complete]
    ends = starts + length

    # A position counts if the next message begins at its end, if it is such a next message, or if
    # it ends with the file.
    following = np.minimum(np.searchsorted(starts, ends), max(len(starts) - 1, 0))
    is_linked = ends == len(raw)
    has_follower = starts[following] == ends if len(starts) else is_linked
    is_linked |= has_follower
    is_linked[following[has_follower]] = True
    return _without_overlaps(starts[is_linked], ends[is_linked])


def _without_overlaps(starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return the positions that do not lie inside a message that begins before them."""
    is_start = np.ones(len(starts), bool)
    overlapped = np.flatnonzero(starts[1:] < np.maximum.accumulate(ends)[:-1]) + 1
    last_end = 0
    for i in overlapped:
        # Only messages that remain can cover a later position.
        previous = i - 1
        while not is_start[previous]:
            previous -= 1
        last_end = max(last_end, int(ends[previous]))
        is_start[i] = starts[i] >= last_end
        if is_start[i]:
            last_end = int(ends[i])
    return starts[is_start]


def _skipped_bytes(starts: np.ndarray, raw: np.ndarray, lengths: np.ndarray) -> int:
    """Return the number of bytes outside of messages."""
    if not len(starts):
        return len(raw)
    return int(len(raw) - lengths[raw[starts + 2]].sum())


def _read_rows(raw: np.ndarray, starts: np.ndarray, message: DataFlashMessage) -> np.ndarray:
    """Return all messages of one kind as a structured array."""
    if not len(starts):
        return np.zeros(0, message.dtype)
    body = raw[starts[:, None] + np.arange(_HEAD, message.length)]
    return np.ascontiguousarray(body).view(message.dtype).ravel()


def _add_units(messages: dict[int, DataFlashMessage], by_name: dict[str, np.ndarray]) -> None:
    """Add the units, multipliers and the instance column that FMTU, UNIT and MULT state."""
    for name, columns in _DESCRIBING_COLUMNS.items():
        if name not in by_name or not {*columns} <= set(by_name[name].dtype.names or ()):
            return
    # FMTU has one character per column, which UNIT and MULT translate.
    labels, factors = {}, {}
    for row in by_name["UNIT"]:
        labels[chr(int(row["Id"]) & 0xFF)] = row["Label"].split(b"\0")[0].decode("utf-8", "replace")
    for row in by_name["MULT"]:
        # The multiplier is a 32-bit float; seven digits give the decimal number that was meant.
        factors[chr(int(row["Id"]) & 0xFF)] = float(f"{row['Mult']:.7g}")

    for row in by_name["FMTU"]:
        message = messages.get(int(row["FmtType"]))
        if message is None:
            continue
        units = row["UnitIds"].decode("latin-1")
        multipliers = row["MultIds"].decode("latin-1")
        for column, unit, multiplier in zip(message.fields, units, multipliers, strict=False):
            if unit == "#":
                message.instance = column
            label = labels.get(unit, "")
            if label and unit not in "-?#":
                message.units[column] = _UNITS.get(label, label)
            # A factor of the format character counts before a multiplier.
            has_factor = message.factors[column] != 1.0 or multiplier in "-?"
            if not has_factor and factors.get(multiplier, 0.0) > 0.0:
                message.factors[column] = factors[multiplier]


def _message_tables(message: DataFlashMessage, rows: np.ndarray) -> dict[str, RecordedTable]:
    """Return a table for each instance of a message; none if it has no clock or no rows."""
    clock = next((name for name in _SECONDS if name in message.fields), None)
    if clock is None or not len(rows):
        return {}
    if message.instance not in message.fields:
        return {message.name: _table(message, rows, clock)}
    tables: dict[str, RecordedTable] = {}
    instances = np.asarray(rows[message.instance])
    for instance in np.unique(instances):
        name = message.name if instance == 0 else f"{message.name}.{instance}"
        tables[name] = _table(message, rows[instances == instance], clock)
    return tables


def _table(message: DataFlashMessage, rows: np.ndarray, clock: str) -> RecordedTable:
    """Return the columns of one number per message, over the clock. [s]"""
    columns = {}
    for name in message.fields:
        if name != clock and rows[name].dtype.kind in "fiu" and rows[name].ndim == 1:
            columns[name] = rows[name].astype(float) * message.factors[name]
    units = {name: unit for name, unit in message.units.items() if name in columns}
    return RecordedTable(columns, units, rows[clock].astype(float) * _SECONDS[clock])


def _omitted_columns(message: DataFlashMessage, samples: int) -> list[LeftOut]:
    """Return the columns that are not numbers, or the message itself if it has no clock."""
    if message.name in _DESCRIBING or not samples:
        return []
    if not {*_SECONDS} & set(message.fields):
        reason = f"{samples} messages without a time stamp"
        return [LeftOut(message.name, reason, _REMEDY)]
    texts, arrays = [], []
    for name in message.fields:
        column = message.dtype[name]
        if column.kind == "S":
            texts.append(LeftOut(f"{message.name}/{name}", "text", _REMEDY))
        if column.shape:
            reason = f"{column.shape[0]} numbers in each message"
            arrays.append(LeftOut(f"{message.name}/{name}", reason, _REMEDY))
    return [*texts, *arrays]
