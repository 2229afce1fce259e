"""Draft of a name map for recordings: columns by their names, units by file, name or size."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from aeromatch.drafting.name_map.author_map import AuthorMap, rows_of_map
from aeromatch.drafting.name_map.name_rows import (
    AssignedColumns,
    LeftColumn,
    NameMapRow,
    assign_columns,
    make_rows,
)
from flightmech.errors import SchemaError
from flighttest.records.readers.columns import unit_of_column
from flighttest.records.readers.name_map import Channel, Clock, Facts, NameMap, latitude_problem
from flighttest.records.readers.name_map_reading import read_names
from flighttest.records.readers.opening import FORMATS, open_recording, recognise_recording
from flighttest.records.readers.recording import (
    CLOCK_NAMES,
    RecordedTable,
    Recording,
    clock_name,
)
from flighttest.records.record import needs_names

LOGS = {"ulog": "px4", "dataflash": "ardupilot"}
"""Shipped name map of each format with fixed names."""
_CLOCK_WORDS = ("time", "zeit", "stamp", "utc", "clock", "sec")
# Fraction of rising steps from which a column is a clock.
_RISING = 0.95
# Rows of a table from which a clock can be recognised.
_FEWEST_SAMPLES = 2
# Distinct stamps from which the rate of samples that share them is estimated.
_FEWEST_STAMPS = 4


@dataclass(frozen=True)
class NamesDraft:
    """A name map before it is written.

    Attributes
    ----------
    rows : tuple of Row
    clock, clocks : Clock, dict of str to Clock
        Clock of the file, and clocks of tables with different time stamps.
    clock_reason : str
    facts : dict
        ``[record]``.
    constants : dict of str to float
        ``[constants]``. [SI]
    extends : str
        A shipped map, empty for none.
    identity : bool
        Whether the files have canonical names with units, so that no map is needed.
    left_out : tuple of LeftColumn
        Columns without a quantity.
    remarks : tuple of str
        Lines that the author has to confirm.
    own : NameMap or None
        A name map of the author outside of the project, which is used unchanged.
    file : str
        Its file, or the name of a shipped one.
    author : AuthorMap or None
        Lines of the author in the name map of the project, which are used in place of the rows.
    """

    rows: tuple[NameMapRow, ...] = ()
    clock: Clock = field(default_factory=Clock)
    clocks: dict[str, Clock] = field(default_factory=dict)
    clock_reason: str = ""
    facts: dict[str, Any] = field(default_factory=dict)
    constants: dict[str, float] = field(default_factory=dict)
    extends: str = ""
    identity: bool = False
    left_out: tuple[LeftColumn, ...] = ()
    remarks: tuple[str, ...] = ()
    own: NameMap | None = None
    file: str = ""
    author: AuthorMap | None = None

    def mapping(self) -> NameMap | None:
        """Return the map for `flighttest.read`, or None if no map is needed."""
        if self.own is not None:
            return self.own
        if self.identity:
            return None
        if self.extends:
            base = read_names(self.extends)
            shipped = replace(base, facts=Facts(**self.facts), constants=self.constants)
            return self.author.extend(shipped) if self.author else shipped
        leaves: dict[str, dict[str, Channel]] = {}
        for row in self.rows:
            leaves.setdefault(row.leaf, {})[row.name] = row.channel
        drafted = NameMap(
            leaves, self.clock, Facts(**self.facts), "draft", self.clocks, constants=self.constants
        )
        return self.author.extend(drafted) if self.author else drafted

    def all_rows(self) -> list[NameMapRow]:
        """Return the drafted rows and the lines of the author."""
        if self.own is not None:
            return rows_of_map(self.own)
        if self.identity:
            return []
        own = self.author.rows() if self.author else []
        return [*self.rows, *own]


def read_own_names(names: str | Path) -> NamesDraft:
    """Return the author's name map as a draft that is not changed.

    Parameters
    ----------
    names : str or Path
        TOML file, or the name of a shipped map.

    Raises
    ------
    SchemaError
        The map is faulty, with all problems.
    """
    mapping = read_names(names)
    return NamesDraft(
        facts=mapping.facts.stated(), constants=mapping.constants, own=mapping, file=str(names)
    )


def draft_names(
    files: Sequence[Path], flap: float | None = None, author: AuthorMap | None = None
) -> NamesDraft:
    """Return a name map for recordings of one recorder.

    Parameters
    ----------
    files : sequence of Path
    flap : float, optional
        Largest deflection of the flaps in the listings, for records with a position 0 ... 1. [rad]
    author : AuthorMap, optional
        Lines of the author. Their quantities and columns are not drafted.

    Raises
    ------
    SchemaError
        The files have several formats, bus words without a table, or no known quantity.
    """
    kind = _common_format(files)
    if kind in LOGS:
        remark = (
            f"surface angles are not in a {FORMATS[kind][1]} log: add the bench table of each "
            f"surface to [controls] of names.toml, then write manoeuvres.csv with "
            f"'aeromatch flight manoeuvres RECORD --names names.toml -o manoeuvres.csv'"
        )
        has_controls = author is not None and bool(author.names.leaves)
        remarks = () if has_controls else (remark,)
        return NamesDraft(extends=LOGS[kind], remarks=remarks, author=author)
    if author is None and not any(needs_names(file) for file in files):
        return NamesDraft(identity=True)
    recordings = [open_recording(file, NameMap({})) for file in files]
    _demand_whole_records(files, recordings)
    # The first recording with a table gives the values from which units and signs follow.
    tables: dict[str, RecordedTable] = {}
    for recording in recordings:
        for name, table in recording.tables.items():
            tables.setdefault(name, table)
    clocks: dict[str, tuple[Clock, str]] = {}
    has_clock = author is not None and author.names.clock != Clock()
    for name, table in tables.items():
        found = None if has_clock else _clock_of(name, table)
        if found is not None:
            clocks[name] = found
    stamps = {clock.column for clock, _ in clocks.values() if clock.column}
    confirmed = author.confirmed() if author else {}
    removed = author.removed if author else frozenset()
    columns = assign_columns(tables, flap, stamps, confirmed=confirmed, removed=removed)
    if not columns.assigned and not confirmed:
        problem = (
            f"no column of {files[0].name} has the name of a quantity; see 'aeromatch flight info'"
        )
        raise SchemaError("recordings", [problem])
    rows = make_rows(columns, tables, recordings, flap)
    first_clock, clock_reason = next(iter(clocks.values()), (Clock(), ""))
    others = {name: clock for name, (clock, _) in clocks.items() if clock != first_clock}
    facts = _latitude_fact(columns, tables, rows)
    notes = list(columns.remarks)
    for name, (its_clock, reason) in clocks.items():
        if its_clock.rate:
            notes.append(f"clock of {name}: {reason}")
    problem = latitude_problem(facts.get("latitude", 0.0))
    if problem:
        facts = {}
        notes.append(f"median of the recorded lat: {problem}; it is left out of [record]")
    return NamesDraft(
        rows=tuple(rows),
        clock=first_clock,
        clocks=others,
        clock_reason=clock_reason,
        facts=facts,
        constants=columns.constants,
        left_out=tuple(columns.left_out),
        remarks=tuple(notes),
        author=author,
    )


def _demand_whole_records(files: Sequence[Path], recordings: Sequence[Recording]) -> None:
    """Raise SchemaError if files hold different systems of a flight, and none of them a record."""
    contents = []
    for recording in recordings:
        columns: set[str] = set()
        for table in recording.tables.values():
            columns.update(set(table.columns) - {*CLOCK_NAMES, clock_name(table.columns)})
        contents.append(columns)
    for file, columns in zip(files, contents, strict=True):
        if contents[0] & columns:
            continue
        problem = (
            f"{files[0].name} and {file.name} have no column in common besides the clock, as the "
            f"files of several systems of one flight: a record is one file with all channels; join "
            f"the files of each flight by their clock first, a cell without a value stays blank "
            f"(how-to 'Map a recording')"
        )
        raise SchemaError("recordings", [problem])


def _common_format(files: Sequence[Path]) -> str:
    """Return the format of all files."""
    kinds = {recognise_recording(file) for file in files}
    if len(kinds) > 1:
        names = ", ".join(sorted(FORMATS[kind][1] for kind in kinds))
        problem = (
            f"several formats ({names}); one name map serves one recorder: give the files of one "
            f"of them"
        )
        raise SchemaError("recordings", [problem])
    (kind,) = kinds
    if kind == "chapter10":
        problem = (
            "Chapter 10 holds words of a bus; write their [decode] tables first "
            "(docs/explanation/flight-test/name-maps.md)"
        )
        raise SchemaError("recordings", [problem])
    return kind


def _clock_of(name: str, table: RecordedTable) -> tuple[Clock, str] | None:
    """Return a clock of a table and the reason, or None if the reader recognises the clock."""
    if table.time is not None:
        rate = coarse_clock_rate(table.time)
        return (Clock(rate=rate), _coarse_reason(rate)) if rate else None
    recognised = clock_name(table.columns)
    if recognised:
        candidates = [recognised]
    else:
        # Columns with a word of time come first.
        likely = [column for column in table.columns if _has_clock_word(column)]
        candidates = likely + [column for column in table.columns if column not in likely]
    for column in candidates:
        stamps = np.asarray(table.columns[column], float)
        steps = np.diff(stamps[np.isfinite(stamps)])
        if not len(steps) or np.mean(steps > 0.0) <= _RISING:
            coarse = _coarse_clock(table, column) if _has_clock_word(column) else None
            if coarse:
                return coarse
            continue
        step = float(np.median(steps))
        unit = unit_of_column(table, column, "time") or _clock_unit(column, step)
        if recognised and unit == "s":
            return None
        reason = f"{column} rises by {step:.6g} at each sample: taken as {unit}"
        return Clock(column=column, unit=unit), reason
    length = max((len(values) for values in table.columns.values()), default=0)
    if length < _FEWEST_SAMPLES:
        problem = f"table {name} has {length} row(s); a recording needs at least {_FEWEST_SAMPLES}"
        raise SchemaError("recordings", [problem])
    problem = (
        f"table {name}: no column that rises all along; state the clock: [time] rate = "
        f'"50 Hz" in a name map'
    )
    raise SchemaError("recordings", [problem])


def coarse_clock_rate(stamps: np.ndarray) -> float | None:
    """Return the rate of samples that share stamps, such as 25 samples in each second, or None.

    Parameters
    ----------
    stamps : array (time,)
        Recorded stamps, which do not fall. [s]

    Returns
    -------
    float or None
        Samples per second. [Hz] None if less than half of the stamps repeat the one before, or if
        the samples of a stamp differ by more than one, as where samples are lost.

    Examples
    --------
    >>> coarse_clock_rate(np.arange(200) // 25)
    25.0
    >>> coarse_clock_rate(0.04 * np.arange(200)) is None
    True
    """
    stamps = np.asarray(stamps, float)
    stamps = stamps[np.isfinite(stamps)]
    distinct, counts = np.unique(stamps, return_counts=True)
    is_falling = (np.diff(stamps) < 0.0).any()
    if is_falling or len(distinct) < _FEWEST_STAMPS or 2 * len(distinct) > len(stamps):
        return None
    # The first and the last stamp may have lost samples to the ends of the record.
    duration = distinct[-1] - distinct[1]
    rate = float(counts[1:-1].sum() / duration)
    # One sample more or less over the record cannot be distinguished from a whole rate.
    if abs(rate - round(rate)) * duration <= 1.0:
        rate = float(round(rate))
    if (np.abs(counts[1:-1] - rate * np.diff(distinct)[1:]) > 1.0 + 1e-9).any():
        return None
    return rate


def _coarse_clock(table: RecordedTable, column: str) -> tuple[Clock, str] | None:
    """Return the clock of a column whose stamps several samples share, and the reason."""
    stamps = np.unique(np.asarray(table.columns[column], float))
    step = float(np.nanmedian(np.diff(stamps))) if len(stamps) > 1 else 0.0
    unit = unit_of_column(table, column, "time") or _clock_unit(column, step)
    clock = Clock(column=column, unit=unit)
    rate = coarse_clock_rate(np.asarray(table.columns[column], float) * clock.seconds(None))
    return (clock.changed(rate=rate), _coarse_reason(rate)) if rate else None


def _coarse_reason(rate: float) -> str:
    return f"samples share stamps: even stamps of {rate:.6g} Hz; CONFIRM"


def _has_clock_word(column: str) -> bool:
    return any(word in column.lower() for word in _CLOCK_WORDS)


def _clock_unit(column: str, step: float) -> str:
    """Return the unit of a clock by the end of its name, or else by the size of its step."""
    for unit in ("us", "ms", "ns"):
        if column.lower().endswith(unit):
            return unit
    # A recorder has between 0.5 and 500 samples per second.
    for unit, limit in (("s", 2.0), ("ms", 2e3), ("us", 2e6)):
        if step < limit:
            return unit
    return "ns"


def _latitude_fact(
    columns: AssignedColumns, tables: Mapping[str, RecordedTable], rows: Sequence[NameMapRow]
) -> dict[str, float]:
    """Return the median latitude of the recording, if it is recorded. [rad]"""
    if "lat" not in columns.assigned:
        return {}
    table, column, _ = columns.assigned["lat"]
    row = next(row for row in rows if row.name == "lat")
    values = np.asarray(tables[table].columns[column], float)
    latitude = row.channel.convert(values, tables[table].units.get(column), "lat")
    return {"latitude": float(np.nanmedian(latitude))}
