"""Contents of a recording without a name map, and netCDF files of records.

The contents are tables, clocks, columns and units, from which a user writes a name map.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import AeromatchError
from flightmech.support.array_files.netcdf_writing import write_netcdf
from flightmech.support.atomic_write import written_atomically
from flightmech.support.hdf5_seal import write_seal
from flighttest.records.readers.clocks import Clocks, TableClock
from flighttest.records.readers.columns import clear_unit
from flighttest.records.readers.formats.chapter10.packets import index_packets
from flighttest.records.readers.formats.chapter10.tables import chapter10_channels
from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.name_map_reading import read_names
from flighttest.records.readers.opening import format_name, open_recording, recognise_recording
from flighttest.records.readers.recording import RecordedTable, Recording
from flighttest.records.signals.blank_cells import clocks_of_rows


def contents(path: str | Path, names: str | Path | NameMap | None = None) -> dict[str, Any]:
    """Return the contents of a recording.

    Parameters
    ----------
    path : str or Path
        A file of any known format.
    names : str, Path or NameMap, optional
        Its clocks and ``[decode]`` tables are used; channels need not be mapped.

    Returns
    -------
    dict
        ``file``, ``format``, ``facts``, ``notes`` (faults that the file reports), ``tables``,
        ``left_out`` (omitted parts, each ``name`` and ``reason``), for Chapter 10 also
        ``channels``.

        Each table has ``table``, ``samples``, ``rate`` [Hz], ``start`` and ``stop`` [s],
        ``clock_fault`` (a text, empty for a sound clock), ``slower`` and ``columns``.  Each column
        has ``column``, ``unit``, ``min`` and ``max`` in the unit of the file.  ``slower`` has the
        columns with blanks between the samples of a slower clock: ``columns``, ``rate`` [Hz] and
        ``samples``.

    Raises
    ------
    ParseError
        The file is damaged or of no known format.
    """
    path = Path(path)
    mapping = NameMap({})
    if isinstance(names, NameMap):
        mapping = names
    elif names is not None:
        mapping = read_names(names)
    kind = recognise_recording(path)
    report: dict[str, Any] = {
        "file": path.name,
        "format": format_name(kind),
        "facts": {},
        "notes": [],
        "tables": [],
        "left_out": [],
    }
    if kind == "chapter10":
        file = index_packets(path)
        report.update(channels=chapter10_channels(file), notes=list(file.notes))
        # Without [decode] the packets have no tables.
        if not mapping.decode:
            return report
    # Without leaves and UTC every column is read.
    clocks_only = NameMap(
        {},
        clock=mapping.clock,
        facts=mapping.facts,
        source=mapping.source,
        clocks=mapping.clocks,
        decode=mapping.decode,
    )
    recording = open_recording(path, clocks_only, kind)
    return {**report, **_describe_recording(recording, clocks_only, path)}


def _describe_recording(recording: Recording, mapping: NameMap, path: Path) -> dict[str, Any]:
    """Return ``facts notes tables left_out`` of `contents`."""
    clocks = Clocks(recording.tables, mapping, path.name, recording.left_out)
    tables = clocks.with_decoded_words()
    facts = {}
    for key, value in recording.facts.items():
        if isinstance(value, str | int | float):
            facts[key] = value
    # The clocks of the tables add notes.
    rows = [_describe_table(name, table, clocks) for name, table in tables.items()]
    left_out = []
    for omission in recording.left_out:
        left_out.append({"name": omission.place, "reason": omission.reason})
    notes = [*recording.notes, *clocks.notes]
    return {"facts": facts, "notes": notes, "tables": rows, "left_out": left_out}


def _describe_table(name: str, table: RecordedTable, clocks: Clocks) -> dict[str, Any]:
    row: dict[str, Any] = {
        "table": name,
        "samples": 0,
        "rate": None,
        "start": None,
        "stop": None,
        "clock_fault": "",
        "slower": [],
    }
    try:
        clock = clocks.table_clock(name, f"{clocks.file}, table {name}")
        row.update(
            samples=len(clock.time),
            rate=clock.attributes["rate"],
            start=float(clock.time[0]),
            stop=float(clock.time[-1]),
        )
    except AeromatchError as error:
        row["clock_fault"] = str(error)
    else:
        row["slower"] = _slower_columns(table.columns, clock)
    columns = []
    for column, values in table.columns.items():
        unit = table.units.get(column) or clear_unit(column)
        columns.append(_describe_column(column, values, unit))
    row["columns"] = columns
    return row


def _slower_columns(columns: Mapping[str, np.ndarray], clock: TableClock) -> list[dict[str, Any]]:
    """Return the columns whose samples form a slower clock than the rows.

    Each result has ``columns``, ``rate`` [Hz] and ``samples``.
    """
    values = {name: np.asarray(column, float)[clock.samples] for name, column in columns.items()}
    slower = []
    for is_filled, names in clocks_of_rows(clock.time, values):
        if is_filled is not None:
            rate = 1.0 / float(np.median(np.diff(clock.time[is_filled])))
            slower.append({"columns": names, "rate": rate, "samples": int(is_filled.sum())})
    return slower


def _describe_column(name: str, values: np.ndarray, unit: str) -> dict[str, Any]:
    values = np.asarray(values, float)
    finite = values[np.isfinite(values)]
    row: dict[str, Any] = {"column": name, "unit": unit, "min": None, "max": None}
    if len(finite):
        row.update(min=float(finite.min()), max=float(finite.max()))
    return row


def save_dataset(data: xr.Dataset, path: str | Path) -> None:
    """Write a manoeuvre or the states of a path to a netCDF file with a seal.

    The file is written atomically.
    """
    _save_sealed({"/": data}, Path(path))


def save_record(record: xr.DataTree, path: str | Path) -> None:
    """Write a flight record to a netCDF file with a seal, one group per leaf.

    `flighttest.read` reads the file without a name map.  The file is written atomically.
    """
    groups = {"/": xr.Dataset(attrs=record.attrs)}
    for leaf, node in record.children.items():
        groups[f"/{leaf}"] = node.to_dataset()
    _save_sealed(groups, Path(path))


def _save_sealed(groups: Mapping[str, xr.Dataset], target: Path) -> None:
    with written_atomically(target) as part:
        write_netcdf(groups, part, _compress_histories)
        write_seal(part)


def write_groups(groups: Mapping[str, xr.Dataset], target: Path) -> None:
    """Write groups of a netCDF file atomically; time histories are compressed."""
    with written_atomically(target) as part:
        write_netcdf(groups, part, _compress_histories)


def _compress_histories(data: xr.Dataset) -> dict[str, Any]:
    """Return the encoding of a group: time histories of numbers are compressed."""
    encoding: dict[str, Any] = {}
    for name, variable in data.data_vars.items():
        if variable.dims[-1:] == ("time",) and variable.dtype.kind == "f":
            encoding[str(name)] = {"zlib": True, "complevel": 4}
    return encoding
