"""Flight records: recordings as a tree of leaves, one per time base, in canonical names and SI.

A `FlightRecord` is a plain ``xarray.DataTree``.  Each leaf is a Dataset over its own ``time`` [s];
its attributes state what the clock looked like (``rate`` [Hz], ``gaps``, ``duplicates``), which
channels hold NaN (``missing``), and all flags (`flighttest.signals.flags`). Root attributes:
``title``, ``start``, ``purpose``, ``source_file``, ``format``, ``manoeuvres`` and ``modes`` (JSON),
``notes`` (JSON: faults that the file itself reports), ``unmapped`` and ``absent`` columns,
``latitude`` [rad], ``runway_elevation`` [m] where known.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import AeromatchError, ParseError, SchemaError
from flightmech.names import quantity_attributes
from flighttest.records.channel_groups import ChannelSamples, RecordGroup
from flighttest.records.listing import MANOEUVRE, channel_rows, fault_texts, read_listed_rows
from flighttest.records.readers.name_map import NameMap
from flighttest.records.reading import Arrays, read_arrays
from flighttest.records.signals.sample_flags import as_text, read_stored_flags

_SAME_MOMENT = 12 * 3600.0  # s: starts further apart are not one flight


def merge(records: Sequence[xr.DataTree], offsets: Sequence[float] | None = None) -> xr.DataTree:
    """Return one record of all leaves, with times on the clock of the first.

    Parameters
    ----------
    records : sequence of DataTree
        Records of one flight, from different recorders.
    offsets : sequence of float, optional
        Seconds to add to the clock of each record after the first.  Without it the records must
        state when they start (``start``, from the file, from ``[utc]`` of the name map, or from
        ``[record]``).

    Returns
    -------
    DataTree
        Leaves of all records; one whose name is taken gets ``_2``, ``_3``, ...  Root attributes of
        the first, with ``merged`` (JSON): file and offset of each.

    Raises
    ------
    SchemaError
        A record without a start, starts that are not of one flight, or a channel in two of them:
        every problem.
    """
    starts = _offsets(records) if offsets is None else [0.0, *map(float, offsets)]
    if len(starts) != len(records):
        raise SchemaError(
            "merge",
            [
                f"{len(starts) - 1} offsets for {len(records)} records; give one for each "
                f"after the first"
            ],
        )
    leaves: dict[str, xr.Dataset] = {}
    origin: dict[str, str] = {}
    problems, notes, merged = [], [], []
    for record, offset in zip(records, starts, strict=True):
        file = str(record.attrs.get("source_file", record.attrs.get("title", "a record")))
        merged.append({"file": file, "offset": offset})
        notes += [f"{file}: {text}" for text in json.loads(record.attrs.get("notes", "[]"))]
        for leaf, node in record.children.items():
            data = _moved(node.to_dataset(), offset)
            for name in map(str, data.data_vars):
                if name in origin:
                    problems.append(
                        f"{name} is in {origin[name]} and in {file}; leave it out of one name map"
                    )
                origin.setdefault(name, file)
            leaves[_free(leaf, leaves)] = data
    if problems:
        raise SchemaError("merge", problems)
    root: dict[str, Any] = {str(key): item for key, item in records[0].attrs.items()}
    root.update(notes=json.dumps(notes), merged=json.dumps(merged))
    return xr.DataTree.from_dict(
        {"/": xr.Dataset(attrs=root), **{f"/{leaf}": data for leaf, data in leaves.items()}}
    )


def _offsets(records: Sequence[xr.DataTree]) -> list[float]:
    moments, problems = [], []
    for record in records:
        text = str(record.attrs.get("start", ""))
        try:
            moment = datetime.fromisoformat(text.replace("Z", "+00:00"))
            moments.append(moment if moment.tzinfo else moment.replace(tzinfo=UTC))
        except ValueError:
            problems.append(
                f"{record.attrs.get('source_file', 'a record')}: start {text!r} is not a date "
                f"and time; pass offsets=[...]"
            )
    if problems:
        raise SchemaError("merge", problems)
    found = [(moment - moments[0]).total_seconds() for moment in moments]
    if max(map(abs, found)) > _SAME_MOMENT:
        raise SchemaError(
            "merge",
            [
                f"starts {max(found) - min(found):.6g} s apart are not of one flight; pass "
                f"offsets=[...]"
            ],
        )
    return found


def _moved(data: xr.Dataset, offset: float) -> xr.Dataset:
    if not offset:
        return data
    flags = read_stored_flags(data.attrs.get("flags", "[]"))
    moved = data.assign_coords(time=("time", data["time"].values + offset, data["time"].attrs))
    moved.attrs["flags"] = as_text(
        flag._replace(start=flag.start + offset, stop=flag.stop + offset) for flag in flags
    )
    return moved


def _free(leaf: str, taken: dict[str, xr.Dataset]) -> str:
    names = (leaf, *(f"{leaf}_{i}" for i in range(2, len(taken) + 3)))
    return next(name for name in names if name not in taken)


def read(path: str | Path, names: str | Path | NameMap | None = None) -> xr.DataTree:
    """Return a flight record from a file of any known format; the format is recognised by content.

    Parameters
    ----------
    path : str or Path
        CSV (plain or gzip), netCDF, HDF5, MATLAB v5 to v7.3, PX4 ULog, ArduPilot DataFlash, MDF,
        IRIG 106 Chapter 10.
    names : str, Path or NameMap, optional
        Name map: a TOML file, or the name of a shipped one (``"px4"``, ``"ardupilot"``).  Without
        it every column must carry a canonical name and its unit.  Columns the map does not name are
        left out and listed in the root attribute ``unmapped``.

    Returns
    -------
    DataTree
        The record; ``delta_a`` is formed from left and right, positive for left roll. [SI]

    Raises
    ------
    ParseError
        The file breaks its format, or is of no known one.
    UnknownName
        A column of the map is not in the file, or a column has no canonical name, with the near
        names.
    UnitError
        A column without a unit, or with one of another quantity.
    SchemaError
        Several of these at once; a clock that is set back; leaves that mix clocks.
    AeromatchError
        The package that reads the format is not installed; the message states how to install it.

    References
    ----------
    .. [LR743] Report LR-743, 1993, section 4.2.
    """
    return as_tree(read_arrays(path, names))


def as_tree(record: Arrays) -> xr.DataTree:
    """Return a record of plain arrays as a tree; the arrays are not copied."""
    leaves = {f"/{name}": _dataset(leaf) for name, leaf in record.leaves.items()}
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs=record.attrs), **leaves})


def _dataset(leaf: RecordGroup) -> xr.Dataset:
    variables = {name: _over_time(*samples) for name, samples in leaf.channels.items()}
    index = pd.Index(leaf.time)
    time = xr.IndexVariable("time", index, quantity_attributes("time"), fastpath=True)
    return xr.Dataset(
        variables,
        xr.Coordinates({"time": time}, {"time": xr.indexes.PandasIndex(index, "time")}),
        leaf.attrs,
    )


def _over_time(values: np.ndarray, about: dict[str, Any]) -> xr.Variable:
    """Return a variable of a plain array; without `fastpath` xarray imports dask, where that is
    installed, to look for its arrays.
    """
    return xr.Variable("time", values, about, fastpath=True)


def find_channel_leaf(record: xr.DataTree, name: str) -> str | None:
    """Return the leaf that holds channel `name`, or None."""
    return next((leaf for leaf, node in record.children.items() if name in node.data_vars), None)


def channel_leaves(record: xr.DataTree) -> dict[str, str]:
    """Return every channel with its leaf."""
    return {str(name): leaf for leaf, node in record.children.items() for name in node.data_vars}


def manoeuvres(record: xr.DataTree | xr.Dataset) -> pd.DataFrame:
    """Return the list of manoeuvres a record carries, or the states of a path of that record.

    Returns
    -------
    DataFrame
        One row per manoeuvre: ``manoeuvre control start end note``, times in seconds of the record;
        empty without a list.
    """
    return _listed(record, "manoeuvres")


def flight_modes(record: xr.DataTree | xr.Dataset) -> pd.DataFrame:
    """Return the flight modes in the log of an autopilot (PX4, ArduPilot) as `manoeuvres` does: a
    row from each change to the next.
    """
    return _listed(record, "modes")


def _listed(record: xr.DataTree | xr.Dataset, key: str) -> pd.DataFrame:
    return pd.DataFrame(read_listed_rows(record.attrs, key), columns=list(MANOEUVRE))


def overview(record: xr.DataTree) -> pd.DataFrame:
    """Return one row per channel: leaf, rate, span, smallest and largest value, unit, calibration,
    faults.
    """
    return pd.DataFrame(
        channel_rows(
            {str(name): _leaf(node.to_dataset()) for name, node in record.children.items()}
        )
    )


def _leaf(data: xr.Dataset) -> RecordGroup:
    """Return a leaf of the tree as plain arrays."""
    return RecordGroup(
        data["time"].values,
        {str(name): ChannelSamples(x.values, x.attrs) for name, x in data.data_vars.items()},
        data.attrs,
    )


def faults(record: xr.DataTree) -> list[str]:
    """Return in words what is wrong with the clocks and samples of a record;
    `flighttest.signals.flags` gives the same as a table.
    """
    return fault_texts(record.attrs, ((leaf, node.attrs) for leaf, node in record.children.items()))


def needs_names(path: str | Path) -> bool:
    """Return whether a recording can be read with a name map only: some column has no canonical
    name, or no unit.

    Raises
    ------
    ParseError
        The file is damaged, or of no known format.
    """
    try:
        read_arrays(path)
    except ParseError:
        raise
    except AeromatchError:
        return True
    return False
