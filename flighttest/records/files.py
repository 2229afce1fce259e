"""What a file holds before anybody has mapped it: tables, clocks, columns and units, for writing a
name map.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import AeromatchError, ParseError
from flightmech.support.atomic_write import written_atomically
from flightmech.support.hdf5_seal import write_seal
from flightmech.support.input_files import json_content
from flighttest.records.channel_groups import RecordGroup
from flighttest.records.readers.clocks import Clocks, TableClock
from flighttest.records.readers.columns import clear_unit
from flighttest.records.readers.formats.chapter10.packets import index_packets
from flighttest.records.readers.formats.chapter10.tables import chapter10_channels
from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.name_map_reading import read_names
from flighttest.records.readers.opening import FORMATS, open_recording, recognise_recording
from flighttest.records.readers.recording import Recording
from flighttest.records.reading import Arrays, unnamed_arrays
from flighttest.records.signals.blank_cells import clocks_of_rows
from flighttest.records.signals.sample_flags import flag_sentences, read_stored_flags
from flighttest.records.stored_overview import OVERVIEW


def contents(path: str | Path, names: str | Path | NameMap | None = None) -> dict[str, Any]:
    """Return what a recording holds.

    Parameters
    ----------
    path : str or Path
        A file of any known format.
    names : str, Path or NameMap, optional
        Its clocks and ``[decode]`` tables are used; channels need not be mapped.

    Returns
    -------
    dict
        ``file``, ``format``, ``facts``, ``notes`` (faults that the file reports), ``tables``: per
        table ``table``, ``samples``, ``rate`` [Hz], ``start`` and ``stop`` [s], ``clock_fault`` (a
        text, empty when the clock is sound) and ``columns``, each ``column``, ``unit``, ``min`` and
        ``max`` in the unit of the file, and ``slower``: columns with blanks between the samples of
        a slower clock, each ``columns``, ``rate`` [Hz] and ``samples``.  For Chapter 10 also
        ``channels``.  ``left_out``: what is in the file and not in the tables, each ``name`` and
        ``reason``.

    Raises
    ------
    ParseError
        The file is damaged or of no known format.
    """
    path = Path(path)
    mapping = (
        names
        if isinstance(names, NameMap)
        else read_names(names)
        if names is not None
        else NameMap({})
    )
    kind = recognise_recording(path)
    found: dict[str, Any] = {
        "file": path.name,
        "format": FORMATS[kind][1],
        "facts": {},
        "notes": [],
        "tables": [],
        "left_out": [],
    }
    if kind == "chapter10":
        file = index_packets(path)
        found.update(channels=chapter10_channels(file), notes=list(file.notes))
        if not mapping.decode:
            return found
    everything = NameMap(
        {}, mapping.clock, mapping.facts, mapping.source, mapping.clocks, None, mapping.decode
    )
    return {**found, **contents_of(open_recording(path, everything, kind), everything, path)}


def contents_of(recording: Recording, everything: NameMap, path: Path) -> dict[str, Any]:
    """Return ``facts``, ``notes``, ``tables`` and ``left_out`` of `contents` of what has been read."""
    clocks = Clocks(recording.tables, everything, path.name, recording.left_out)
    tables = clocks.with_decoded_words()
    return {
        "facts": {
            key: value
            for key, value in recording.facts.items()
            if isinstance(value, str | int | float)
        },
        "notes": [*recording.notes, *clocks.notes],
        "tables": [_table(name, clocks) for name in tables],
        "left_out": [{"name": one.place, "reason": one.reason} for one in recording.left_out],
    }


def _table(name: str, clocks: Clocks) -> dict[str, Any]:
    table = clocks.tables[name]
    about: dict[str, Any] = {
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
        about.update(
            samples=len(clock.time),
            rate=clock.attributes["rate"],
            start=float(clock.time[0]),
            stop=float(clock.time[-1]),
        )
    except AeromatchError as error:
        about["clock_fault"] = str(error)
    else:
        about["slower"] = _slower(table.columns, clock)
    about["columns"] = [
        _column(column, table.columns[column], table.units.get(column) or clear_unit(column))
        for column in table.columns
    ]
    return about


def _slower(columns: Mapping[str, np.ndarray], clock: TableClock) -> list[dict[str, Any]]:
    """Return the columns whose samples form a slower clock than the rows, with rate [Hz] and number
    of the samples.
    """
    values = {name: np.asarray(column, float)[clock.samples] for name, column in columns.items()}
    found = []
    for rows, names in clocks_of_rows(clock.time, values):
        if rows is not None:
            rate = 1.0 / float(np.median(np.diff(clock.time[rows])))
            found.append({"columns": names, "rate": rate, "samples": int(rows.sum())})
    return found


def _column(name: str, values: np.ndarray, unit: str) -> dict[str, Any]:
    values = np.asarray(values, float)
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (None, None)
    return {"column": name, "unit": unit, "min": low, "max": high}


MANOEUVRE = ("manoeuvre", "control", "start", "end", "note")


def record_listing(record: Arrays) -> dict[str, Any]:
    """Return what `flight show` prints of a record: ``facts channels manoeuvres faults unmapped``."""
    return {
        "facts": {
            key: value
            for key, value in record.attrs.items()
            if key not in ("manoeuvres", "unmapped", "notes", "left_out")
        },
        "channels": channel_rows(record.leaves),
        "manoeuvres": flown_rows(record.attrs),
        "faults": fault_texts(
            record.attrs, ((name, leaf.attrs) for name, leaf in record.leaves.items())
        ),
        "unmapped": [name for name in record.attrs["unmapped"].split(", ") if name],
    }


def channel_rows(leaves: Mapping[str, RecordGroup]) -> list[dict[str, Any]]:
    """Return one row per channel: leaf, rate, span, smallest and largest value, unit, calibration,
    faults.
    """
    return [
        _channel_row(name, leaf, channel)
        for name, leaf in leaves.items()
        for channel in leaf.channels
    ]


def _channel_row(name: str, leaf: RecordGroup, channel: str) -> dict[str, Any]:
    x, about = leaf.channels[channel]
    lost = np.isnan(x)
    good = x[~lost] if lost.any() else x
    known = bool(np.isfinite(good).any())
    return {
        "leaf": name,
        "channel": channel,
        "rate": float(leaf.attrs["rate"]),
        "start": float(leaf.time[0]),
        "stop": float(leaf.time[-1]),
        "min": float(good.min()) if known else math.nan,
        "max": float(good.max()) if known else math.nan,
        "units": about["units"],
        "calibration": about.get("calibration", ""),
        "missing": int(lost.sum()),
    }


def read_listed_rows(attrs: Mapping[Any, Any], key: str) -> list[dict[str, Any]]:
    """Return the rows of a list of manoeuvres or modes in the root attributes of a record:
    ``manoeuvre control start end note``.

    Raises
    ------
    ParseError
        The attribute is not such a list.
    """
    file = str(attrs.get("source_file", "the record"))
    found = json_content(attrs.get(key, "[]"), file, f"a list of {key}")
    if not isinstance(found, list) or not all(isinstance(row, dict) for row in found):
        raise ParseError(
            file,
            0,
            f"the attribute {key} {str(found)[:40]!r}",
            "a list of rows in JSON; write the record again",
        )
    return [{name: row.get(name, "") for name in MANOEUVRE} for row in found]


def flown_rows(attrs: Mapping[Any, Any]) -> list[dict[str, Any]]:
    """Return the list of manoeuvres as the table of `flighttest.records.show_record.manoeuvres` holds
    it: times of one kind in a column.
    """
    found = read_listed_rows(attrs, "manoeuvres")
    for key in ("start", "end"):
        times = [row[key] for row in found]
        if all(time is None or isinstance(time, int | float) for time in times) and not all(
            isinstance(time, int) for time in times
        ):
            found = [
                {**row, key: math.nan if row[key] is None else float(row[key])} for row in found
            ]
    return found


def fault_texts(
    attrs: Mapping[Any, Any], leaves: Iterable[tuple[str, Mapping[Any, Any]]]
) -> list[str]:
    """Return in words what is wrong, from the attributes of the root and of each leaf."""
    found = [str(note) for note in json.loads(attrs.get("notes", "[]"))]
    for leaf, about in leaves:
        found += [
            f"{leaf}: {text}"
            for text in flag_sentences(read_stored_flags(about.get("flags", "[]")))
        ]
    return found


def save_dataset(data: xr.Dataset, path: str | Path) -> None:
    """Write a manoeuvre or the states of a path to netCDF, sealed; an unfinished file never takes
    the name.
    """
    _save({"/": data}, Path(path))


def save_record(record: xr.DataTree, path: str | Path) -> None:
    """Write a flight record to netCDF, one group per leaf, sealed; `flighttest.read` reads it again
    without a name map.
    """
    groups = {"/": xr.Dataset(attrs=record.attrs)}
    _save(
        {**groups, **{f"/{leaf}": node.to_dataset() for leaf, node in record.children.items()}},
        Path(path),
    )


def _save(groups: Mapping[str, xr.Dataset], target: Path) -> None:
    with written_atomically(target) as part:
        _write(groups, part)
        write_seal(part, OVERVIEW, _overview(part))


def _overview(part: Path) -> dict[str, Any] | None:
    """Return what `flight show` and `flight info` find in a file, read as it was written; without
    what they refuse to read.
    """
    found: dict[str, Any] = {}
    with suppress(AeromatchError):
        names = NameMap({})
        recording = open_recording(part, names)
        about = {
            "file": None,
            "format": FORMATS[recording.kind][1],
            **contents_of(recording, names, part),
        }
        if not any(table["clock_fault"] for table in about["tables"]):  # whose text names the file
            found["contents"] = about
        found["listing"] = record_listing(unnamed_arrays(recording, None, part))
    return found or None


def write_groups(groups: Mapping[str, xr.Dataset], target: Path) -> None:
    """Write groups of a netCDF file, all or none; time histories are compressed."""
    with written_atomically(target) as part:
        _write(groups, part)


def _write(groups: Mapping[str, xr.Dataset], part: Path) -> None:
    mode: Any = "w"
    for group, data in groups.items():
        packed = {
            str(n): {"zlib": True, "complevel": 4}
            for n, v in data.data_vars.items()
            if v.dims[-1:] == ("time",) and v.dtype.kind == "f"
        }
        data.to_netcdf(
            part,
            mode=mode,
            group=None if group == "/" else group.strip("/"),
            engine="h5netcdf",
            encoding=packed,
        )
        mode = "a"
