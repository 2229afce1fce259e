"""Flight records: trees with one leaf per time base, in canonical names and SI.

A flight record is an ``xarray.DataTree``.  Each leaf is a Dataset over its ``time`` [s].  Its
attributes describe the clock (``rate`` [Hz], ``gaps``, ``duplicates``), the channels with NaN
(``missing``), and all flags (`flighttest.signals.flags`).  Root attributes: ``title``, ``start``,
``purpose``, ``source_file``, ``format``, ``manoeuvres`` and ``modes`` (JSON), ``notes`` (JSON:
faults that the file itself reports), ``unmapped`` and ``absent`` columns, and if known ``latitude``
[rad] and ``runway_elevation`` [m].
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

from flightmech.errors import AeromatchError, ParseError, SchemaError
from flightmech.names import quantity_attributes
from flightmech.support.array_files.labelled_arrays import make_dataset, make_variable
from flighttest.records.channel_groups import ChannelSamples, RecordGroup
from flighttest.records.listing import MANOEUVRE, channel_rows, fault_texts, read_listed_rows
from flighttest.records.readers.name_map import NameMap
from flighttest.records.reading import Arrays, read_arrays
from flighttest.records.signals.sample_flags import as_text, read_stored_flags

# Starts of records that differ by more do not belong to one flight. [s]
_LONGEST_FLIGHT = 12 * 3600.0


def merge(records: Sequence[xr.DataTree], offsets: Sequence[float] | None = None) -> xr.DataTree:
    """Return one record with all leaves, on the clock of the first record.

    Parameters
    ----------
    records : sequence of DataTree
        Records of one flight, from different recorders.
    offsets : sequence of float, optional
        Offset to add to the clock of each record after the first. [s]  Without it the records must
        state their ``start`` (from the file, from ``[utc]`` of the name map, or from ``[record]``).

    Returns
    -------
    DataTree
        A leaf whose name exists already gets ``_2``, ``_3``, ...  The root attributes are those of
        the first record, with ``merged`` (JSON): file and offset of each record.

    Raises
    ------
    SchemaError
        A record has no start, starts are not of one flight, or two records have the same channel.
        The error has every problem.
    """
    shifts = _offsets_of_starts(records) if offsets is None else [0.0, *map(float, offsets)]
    if len(shifts) != len(records):
        raise SchemaError(
            "merge",
            [
                f"{len(shifts) - 1} offsets for {len(records)} records; give one for each "
                f"after the first"
            ],
        )
    # Leaves of different recorders may share a name, channels may not.
    leaves: dict[str, xr.Dataset] = {}
    file_of_channel: dict[str, str] = {}
    problems, notes, merged = [], [], []
    for record, offset in zip(records, shifts, strict=True):
        file = str(record.attrs.get("source_file", record.attrs.get("title", "a record")))
        merged.append({"file": file, "offset": offset})
        notes += [f"{file}: {text}" for text in json.loads(record.attrs.get("notes", "[]"))]
        for leaf, node in record.children.items():
            data = _shift_clock(node.to_dataset(), offset)
            for name in map(str, data.data_vars):
                if name in file_of_channel:
                    problems.append(
                        f"{name} is in {file_of_channel[name]} and in {file}; leave it out of one "
                        f"name map"
                    )
                file_of_channel.setdefault(name, file)
            leaves[_unused_name(leaf, leaves)] = data
    if problems:
        raise SchemaError("merge", problems)
    attrs: dict[str, Any] = {str(key): item for key, item in records[0].attrs.items()}
    attrs.update(notes=json.dumps(notes), merged=json.dumps(merged))
    return _make_tree(attrs, leaves)


def _make_tree(attrs: dict[str, Any], leaves: Mapping[str, xr.Dataset]) -> xr.DataTree:
    """Return a tree of a root with attributes only, and its leaves."""
    groups = {"/": xr.Dataset(attrs=attrs)}
    for name, data in leaves.items():
        groups[f"/{name}"] = data
    return xr.DataTree.from_dict(groups)


def _offsets_of_starts(records: Sequence[xr.DataTree]) -> list[float]:
    """Return the start of each record after the start of the first. [s]"""
    starts, problems = [], []
    for record in records:
        text = str(record.attrs.get("start", ""))
        try:
            start = datetime.fromisoformat(text.replace("Z", "+00:00"))
        except ValueError:
            file = record.attrs.get("source_file", "a record")
            problems.append(f"{file}: start {text!r} is not a date and time; pass offsets=[...]")
            continue
        # A start without a time zone is in UTC.
        if start.tzinfo is None:
            start = start.replace(tzinfo=UTC)
        starts.append(start)
    if problems:
        raise SchemaError("merge", problems)
    offsets = [(start - starts[0]).total_seconds() for start in starts]
    if max(map(abs, offsets)) > _LONGEST_FLIGHT:
        span = max(offsets) - min(offsets)
        raise SchemaError(
            "merge", [f"starts {span:.6g} s apart are not of one flight; pass offsets=[...]"]
        )
    return offsets


def _shift_clock(data: xr.Dataset, offset: float) -> xr.Dataset:
    """Return a leaf with an offset [s] added to its clock and to its flags."""
    if not offset:
        return data
    shifted = data.assign_coords(time=("time", data["time"].values + offset, data["time"].attrs))
    flags = []
    for flag in read_stored_flags(data.attrs.get("flags", "[]")):
        flags.append(flag._replace(start=flag.start + offset, stop=flag.stop + offset))
    shifted.attrs["flags"] = as_text(flags)
    return shifted


def _unused_name(leaf: str, leaves: Mapping[str, xr.Dataset]) -> str:
    """Return the name of a leaf, with a number from 2 if it exists already."""
    name, number = leaf, 2
    while name in leaves:
        name, number = f"{leaf}_{number}", number + 1
    return name


def read(path: str | Path, names: str | Path | NameMap | None = None) -> xr.DataTree:
    """Return a flight record from a file of any known format.

    The format is recognised by the content of the file.

    Parameters
    ----------
    path : str or Path
        CSV (plain or gzip), netCDF, HDF5, MATLAB v5 to v7.3, PX4 ULog, ArduPilot DataFlash, MDF,
        IRIG 106 Chapter 10.
    names : str, Path or NameMap, optional
        Name map: a TOML file, or the name of a shipped one (``"px4"``, ``"ardupilot"``).  Without
        it every column must have a canonical name and its unit.  Columns that the map does not name
        are omitted and listed in the root attribute ``unmapped``.

    Returns
    -------
    DataTree
        The record; ``delta_a`` is formed from left and right, positive for left roll. [SI]

    Raises
    ------
    ParseError
        The file is damaged, or of no known format.
    UnknownName
        A column of the map is not in the file, or a column has no canonical name.  The error has
        similar names.
    UnitError
        A column without a unit, or with one of another quantity.
    SchemaError
        Several of these problems, a clock that steps back, or a leaf with several clocks.
    AeromatchError
        The package that reads the format is not installed; the message states how to install it.

    References
    ----------
    .. [LR743] Report LR-743, 1993, section 4.2.
    """
    return as_tree(read_arrays(path, names))


def as_tree(record: Arrays) -> xr.DataTree:
    """Return a record of plain arrays as a tree. The arrays are not copied."""
    leaves = {name: _make_dataset(leaf) for name, leaf in record.leaves.items()}
    return _make_tree(record.attrs, leaves)


def _make_dataset(leaf: RecordGroup) -> xr.Dataset:
    variables = {}
    for name, channel in leaf.channels.items():
        variables[name] = make_variable("time", channel.values, channel.attrs)
    time = make_variable("time", leaf.time, quantity_attributes("time"))
    return make_dataset(variables, {"time": time}, leaf.attrs)


def find_channel_leaf(record: xr.DataTree, name: str) -> str | None:
    """Return the leaf with channel `name`, or None."""
    for leaf, node in record.children.items():
        # `data_vars` of a node makes a Dataset of the leaf at each call
        if name in node.variables and name not in node.coords:
            return leaf
    return None


def channel_leaves(record: xr.DataTree) -> dict[str, str]:
    """Return the leaf of every channel."""
    leaves = {}
    for leaf, node in record.children.items():
        leaves.update({str(name): leaf for name in node.data_vars})
    return leaves


def marked_manoeuvres(record: xr.DataTree | xr.Dataset) -> pd.DataFrame:
    """Return the list of manoeuvres of a record, or of the states of a path of this record.

    Returns
    -------
    DataFrame
        One row per manoeuvre: ``manoeuvre control start end note``, times in seconds of the record;
        empty without a list.
    """
    return _listed_table(record, "manoeuvres")


def flight_modes(record: xr.DataTree | xr.Dataset) -> pd.DataFrame:
    """Return the flight modes in the log of an autopilot (PX4, ArduPilot).

    The columns are those of `marked_manoeuvres`; a row ends where the mode changes.
    """
    return _listed_table(record, "modes")


def _listed_table(record: xr.DataTree | xr.Dataset, key: str) -> pd.DataFrame:
    return pd.DataFrame(read_listed_rows(record.attrs, key), columns=list(MANOEUVRE))


def overview(record: xr.DataTree) -> pd.DataFrame:
    """Return one row per channel, with the columns of `flighttest.records.listing.channel_rows`."""
    leaves = {}
    for leaf, node in record.children.items():
        data = node.to_dataset()
        channels = {}
        for name, channel in data.data_vars.items():
            channels[str(name)] = ChannelSamples(channel.values, channel.attrs)
        leaves[str(leaf)] = RecordGroup(data["time"].values, channels, data.attrs)
    return pd.DataFrame(channel_rows(leaves))


def faults(record: xr.DataTree) -> list[str]:
    """Return the faults of clocks and samples of a record as sentences.

    `flighttest.signals.flags` returns them as a table.
    """
    return fault_texts(record.attrs, ((leaf, node.attrs) for leaf, node in record.children.items()))


def needs_names(path: str | Path) -> bool:
    """Return whether a recording cannot be read without a name map.

    Some column has no canonical name, or no unit.

    Raises
    ------
    ParseError
        The file is damaged, or of no known format.
    """
    # A damaged file is an error with any name map.
    try:
        read_arrays(path)
    except ParseError:
        raise
    except AeromatchError:
        return True
    return False
