"""Columns of the recordings of a new project as they were recorded, for their traces."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from aeromatch.workbench.new_project.sources import recordings_of
from aeromatch.workbench.opened import Levels, OpenProject, decimate_channels, pack_traces
from flightmech.errors import AeromatchError, SchemaError, UnknownName
from flighttest.records.readers.columns import unit_of_column
from flighttest.records.readers.name_map import Clock, NameMap
from flighttest.records.readers.name_map_reading import read_names
from flighttest.records.readers.opening import open_recording
from flighttest.records.readers.recording import RecordedTable, clock_name

# Recordings whose columns stay in memory, and points of a screen.
_MOST_RECORDINGS, _MOST_POINTS = 4, 8000


class ColumnTable(NamedTuple):
    """Columns over one clock.

    Attributes
    ----------
    time : ndarray (samples,)
        From the first sample of the recording [s]; number of the sample without a clock.
    levels : dict of str to Levels
        Numeric columns, in the unit of the recorder.
    units : dict of str to str
        Units that the file states.
    has_clock : bool
    """

    time: np.ndarray
    levels: dict[str, Levels]
    units: dict[str, str]
    has_clock: bool


def recorded_tables(opened: OpenProject, name: str) -> dict[str, ColumnTable]:
    """Return the tables of a recording of the folder.

    Raises
    ------
    UnknownName
    """
    files = recordings_of(opened)
    if name not in files:
        raise UnknownName(name, files, "recording")
    names = opened.file.parent / "names.toml"

    def read() -> dict[str, ColumnTable]:
        clock = _drafted_clock(names)
        tables = open_recording(files[name], NameMap({})).tables
        return _from_earliest({name: _read_table(item, clock) for name, item in tables.items()})

    return opened.kept(("columns",), [files[name], names], read, most=_MOST_RECORDINGS)


def _drafted_clock(names: Path) -> Clock:
    """Return the clock of the name map; the default without a map that can be read."""
    try:
        return read_names(names).clock
    except (AeromatchError, OSError):
        return Clock()


def _from_earliest(tables: dict[str, ColumnTable]) -> dict[str, ColumnTable]:
    """Return tables with times from the earliest stamp of all, on one time axis."""
    starts = [table.time[0] for table in tables.values() if table.has_clock]
    start = min(starts, default=0.0)
    shifted = {}
    for name, table in tables.items():
        time = table.time - start if table.has_clock else table.time
        shifted[name] = table._replace(time=time)
    return shifted


def _read_table(content: RecordedTable, clock: Clock) -> ColumnTable:
    levels = {}
    for column in content.columns:
        values = np.asarray(content.columns[column])
        # A column of texts cannot be drawn.
        if values.dtype.kind in "fiub":
            levels[column] = Levels(values)
    time, has_clock = _times_of(content, clock)
    return ColumnTable(time, levels, dict(content.units), has_clock)


def _times_of(content: RecordedTable, clock: Clock) -> tuple[np.ndarray, bool]:
    """Return the times of the samples, and whether they are of a clock. [s]"""
    name = clock.column if clock.column in content.columns else clock_name(content.columns)
    if content.time is not None:
        stamps = np.asarray(content.time, float)
    elif name:
        unit = clock.unit or unit_of_column(content, name, "time")
        stamps = np.asarray(content.columns[name], float) * Clock().seconds(unit)
    else:
        stamps = np.array([])
    # A trace requires times that rise; the reader of the record repairs or refuses others.
    if len(stamps) and np.isfinite(stamps).all() and (np.diff(stamps) >= 0.0).all():
        return stamps, True
    samples = max((len(content.columns[column]) for column in content.columns), default=0)
    return np.arange(samples, dtype=float), False


def pack_columns(opened: OpenProject, query: Mapping[str, str], body: Any) -> bytes:
    """Return columns of a recording, in the form of `pack_traces`.

    The query has ``name``, ``points``, and may have ``columns``: a JSON list of columns; all of
    them by default.
    """
    tables = recorded_tables(opened, query.get("name", ""))
    points = query.get("points", "")
    if not points.isdecimal() or not 0 < len(points) <= len(str(_MOST_POINTS)):
        raise SchemaError("columns", [f"points is {points[:20]!r}; 1 to {_MOST_POINTS}"])
    wanted = _parse_columns(query.get("columns", ""))
    groups: list[tuple[dict[str, object], np.ndarray, Mapping[str, np.ndarray]]] = []
    for table, content in tables.items():
        chosen = {}
        for column, levels in content.levels.items():
            if wanted is None or wanted & {column, f"{table}/{column}"}:
                chosen[column] = levels
        if not chosen or not len(content.time):
            continue
        times, values = decimate_channels(
            content.time,
            chosen,
            start=content.time[0],
            stop=content.time[-1],
            points=min(int(points), _MOST_POINTS),
        )
        head: dict[str, object] = {
            "source": "recording",
            "leaf": table,
            "units": {column: content.units.get(column, "") for column in chosen},
            "clock": content.has_clock,
        }
        groups.append((head, times, values))
    return pack_traces(groups)


def _parse_columns(text: str) -> set[str] | None:
    """Return the columns of a query; None for all."""
    if not text:
        return None
    try:
        names = json.loads(text)
    except (ValueError, RecursionError):
        names = None
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise SchemaError("columns", [f"{text[:40]!r} is not a list of columns"])
    return set(names)


ROUTES = {("GET", "/api/new/traces"): pack_columns}
"""Requests of traces of columns, in the form of `records.ROUTES`."""
