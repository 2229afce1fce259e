"""Flight records: recordings as a tree of leaves, one per time base, in house names and SI.

A `FlightRecord` is a plain ``xarray.DataTree``.  Each leaf is a Dataset over its own ``time`` [s]; its attributes tell
what the clock looked like (``rate`` [Hz], ``gaps``, ``duplicates``) and which channels hold NaN (``missing``).  Root
attributes: ``title``, ``start``, ``purpose``, ``source_file``, ``manoeuvres`` (JSON), ``latitude`` [rad],
``runway_elevation`` [m] where known.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import ParseError, SchemaError, UnknownName
from flightmech.names import VOCABULARY, attrs, lookup

from .conditioning import GAP, resample
from .names_map import Channel, NameMap, read_names
from .tables import Table, read_csv, read_netcdf


def read(path: str | Path, names: str | Path | NameMap | None = None) -> xr.DataTree:
    """Return a flight record from a netCDF or CSV file.

    Parameters
    ----------
    path : str or Path
        ``.nc`` (one group per time base) or ``.csv``, ``.csv.gz`` (one time base).
    names : str, Path or NameMap, optional
        Name map; without it every column must carry a house name and its unit.  Columns the map does not name are left
        out and listed in the root attribute ``unmapped``.

    Returns
    -------
    DataTree
        The record; ``delta_a`` is formed from left and right, positive for left roll. [SI]

    Raises
    ------
    ParseError
        The file breaks its format.
    UnknownName
        A column of the map is not in the file, or a column has no house name, with the near names.
    SchemaError
        A clock that runs backwards, or leaves that mix clocks.

    References
    ----------
    .. [LR743] Report LR-743, 1993, section 4.2.
    """
    path = Path(path)
    mapping = names if isinstance(names, NameMap) or names is None else read_names(names)
    kind = path.name.lower().removesuffix(".gz").rsplit(".", 1)[-1]
    if kind == "csv":
        tables, root = read_csv(path, (mapping or NameMap({})).clock)
    elif kind in ("nc", "nc4", "h5"):
        tables, root = read_netcdf(path)
    else:
        raise ParseError(str(path), 0, f"a file name ending in .{kind}", ".nc, .csv or .csv.gz")
    mapping = mapping or _own_names(tables, path)
    leaves = {leaf: _leaf(leaf, channels, tables, path) for leaf, channels in mapping.leaves.items() if channels}
    used = {_locate(leaf, channel, tables, path) for leaf, channels in mapping.leaves.items() for channel in channels.values()}
    root = {key: value for key, value in root.items() if isinstance(value, str | int | float | np.integer | np.floating)}
    root.update({key: value for key, value in mapping.facts.model_dump().items() if value is not None})
    root.setdefault("title", root.get("record") or path.name.split(".")[0])
    root["source_file"] = path.name
    root["unmapped"] = " ".join(f"{t}/{c}" for t, table in tables.items() for c in table.columns if (t, c) not in used)
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs=root), **{f"/{leaf}": data for leaf, data in leaves.items()}})


def locate(record: xr.DataTree, name: str) -> str | None:
    """Return the leaf that holds channel `name`, or None."""
    return next((leaf for leaf, node in record.children.items() if name in node.data_vars), None)


def channels(record: xr.DataTree) -> dict[str, str]:
    """Return every channel with its leaf."""
    return {str(name): leaf for leaf, node in record.children.items() for name in node.data_vars}


def manoeuvres(record: xr.DataTree) -> pd.DataFrame:
    """Return the list of manoeuvres a record carries.

    Returns
    -------
    DataFrame
        One row per manoeuvre: ``manoeuvre control start end note``, times in seconds of the record; empty without a list.
    """
    columns = ["manoeuvre", "control", "start", "end", "note"]
    rows = json.loads(record.attrs.get("manoeuvres", "[]"))
    return pd.DataFrame([{key: row.get(key, "") for key in columns} for row in rows], columns=columns)


def overview(record: xr.DataTree) -> pd.DataFrame:
    """Return one row per channel: leaf, rate, span, smallest and largest value, unit, calibration, faults."""
    rows = []
    for leaf, node in record.children.items():
        data = node.to_dataset()
        time = data["time"].values
        for name in map(str, data.data_vars):
            x = data[name].values
            rows.append(
                {
                    "leaf": leaf,
                    "channel": name,
                    "rate": data.attrs["rate"],
                    "start": time[0],
                    "stop": time[-1],
                    "min": np.nanmin(x) if np.isfinite(x).any() else np.nan,
                    "max": np.nanmax(x) if np.isfinite(x).any() else np.nan,
                    "units": data[name].attrs["units"],
                    "calibration": data[name].attrs.get("calibration", ""),
                    "missing": int(np.isnan(x).sum()),
                }
            )
    return pd.DataFrame(rows)


def faults(record: xr.DataTree) -> list[str]:
    """Return in words what is wrong with the clocks and samples of a record."""
    found = []
    for leaf, node in record.children.items():
        for key, text in (("gaps", "gaps in the clock at"), ("duplicates", "repeated time stamps dropped:"), ("missing", "NaN samples:")):
            if node.attrs.get(key):
                found.append(f"{leaf}: {text} {node.attrs[key]}")
    return found


def _own_names(tables: dict[str, Table], path: Path) -> NameMap:
    """Return the map of a file that already speaks house names."""
    unknown = sorted({c for table in tables.values() for c in table.columns if not _known(c)})
    if unknown:
        hint = f"{path.name} has {len(unknown)} columns without a house name ({', '.join(unknown[:12])})"
        raise UnknownName(unknown[0], VOCABULARY, "column", f"{hint}; pass names=... (--names), a name map in TOML")
    return NameMap({name: {c: Channel(column=c) for c in table.columns} for name, table in tables.items()})


def _known(name: str) -> bool:
    try:
        return bool(lookup(name))
    except UnknownName:
        return False


def _locate(leaf: str, channel: Channel, tables: dict[str, Table], path: Path) -> tuple[str, str]:
    """Return table and column of a channel: ``table/column``, a column of the leaf's own table, or of the only table."""
    group, _, column = channel.column.rpartition("/")
    group = group or (leaf if leaf in tables else next(iter(tables)) if len(tables) == 1 else "")
    if group not in tables:
        raise UnknownName(
            group or leaf, tables, "table", f"{path.name} holds no such group for column {channel.column!r}; write group/column"
        )
    if column not in tables[group].columns:
        raise UnknownName(column, tables[group].columns, "column", f"the name map asks for it in {path.name}, table {group}")
    return group, column


def _leaf(leaf: str, channels: dict[str, Channel], tables: dict[str, Table], path: Path) -> xr.Dataset:
    places = {name: _locate(leaf, channel, tables, path) for name, channel in channels.items()}
    groups = {group for group, _ in places.values()}
    times = [tables[group].time for group in sorted(groups)]
    if any(len(t) != len(times[0]) or not np.array_equal(t, times[0]) for t in times):
        raise SchemaError(
            f"name map, leaf {leaf}",
            [f"its columns come from tables with different clocks ({', '.join(sorted(groups))}); make a leaf of each"],
        )
    time, keep, about = _clock(times[0], leaf, path)
    data = xr.Dataset(coords={"time": ("time", time, attrs("time"))}, attrs=about)
    for name, channel in channels.items():
        group, column = places[name]
        unit = tables[group].units.get(column)
        x = np.asarray(channel.convert(tables[group].columns[column][keep], unit, name), float)
        x = _advance(time, x, channel.delay, name)
        data[name] = "time", x, {**attrs(name), "column": f"{group}/{column}", "calibration": channel.calibration(unit)}
        if channel.delay:
            data[name].attrs["delay_removed"] = channel.delay
    if {"delta_a_left", "delta_a_right"} <= set(data.data_vars) and "delta_a" not in data:
        data["delta_a"] = (data["delta_a_right"] - data["delta_a_left"]) / 2.0
        data["delta_a"].attrs = {**attrs("delta_a"), "calibration": "(delta_a_right - delta_a_left) / 2"}
    missing = {name: np.isnan(data[name].values) for name in map(str, data.data_vars)}
    data.attrs["missing"] = ", ".join(f"{n} {int(m.sum())} from {time[np.argmax(m)]:g} s" for n, m in missing.items() if m.any())
    return data


def _clock(time: np.ndarray, leaf: str, path: Path) -> tuple[np.ndarray, np.ndarray, dict[str, Any]]:
    """Return a rising clock, the samples kept, and what was found."""
    what = f"{path.name}, leaf {leaf}"
    if len(time) < 2 or not np.isfinite(time).all():
        raise SchemaError(
            what, [f"its clock has {len(time)} samples, {int((~np.isfinite(time)).sum())} of them NaN; at least two finite ones are needed"]
        )
    step = np.diff(time)
    if (step < 0).any():
        at = int(np.argmax(step < 0))
        raise SchemaError(
            what, [f"time does not rise: {time[at]:g} s is followed by {time[at + 1]:g} s (sample {at + 1}); split or sort the file"]
        )
    keep = np.concatenate([[True], step > 0])
    time = time[keep]
    step = np.diff(time)
    median = float(np.median(step))
    gaps = np.flatnonzero(step > GAP * median)
    words = ", ".join(f"{time[i]:g} s ({step[i]:.3g} s)" for i in gaps[:20])
    return time, keep, {"rate": 1.0 / median, "gaps": words, "duplicates": int((~keep).sum())}


def _advance(time: np.ndarray, x: np.ndarray, delay: float, name: str) -> np.ndarray:
    """Return the channel with a known latency removed: its value at t is what was recorded at t + delay."""
    if not delay:
        return x
    return resample(time, x, np.clip(time + delay, time[0], time[-1]), name)
