"""Raw tables of recordings: netCDF groups and CSV files as columns over a clock, not yet in house names."""

from __future__ import annotations

import gzip
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flightmech.errors import ParseError, UnknownName

from .names_map import Clock


@dataclass(frozen=True)
class Table:
    """Columns over one clock: `columns` name -> values, `units` name -> unit as the file states it (or missing)."""

    time: np.ndarray
    columns: dict[str, np.ndarray]
    units: dict[str, str]


def read_netcdf(path: str | Path) -> tuple[dict[str, Table], dict[str, Any]]:
    """Return the groups of a netCDF file as tables, and its root attributes.

    Raises
    ------
    ParseError
        Not a netCDF-4 file, or a group without a ``time`` coordinate.
    """
    import xarray as xr

    try:
        groups = xr.open_groups(path, engine="h5netcdf")
    except (OSError, ValueError) as error:
        if not Path(path).exists():
            raise
        raise ParseError(str(path), 0, f"no netCDF-4 content ({error})", "a recording with one group per time base") from error
    tables, attrs = {}, dict(groups["/"].attrs)
    for place, group in groups.items():
        if group.data_vars:
            name = place.strip("/") or "data"
            if "time" not in group.coords:
                raise ParseError(str(path), 0, f"group {name} without a coordinate 'time'", "every group over its own time [s]")
            time = group["time"].values.astype(float)
            numbers = [c for c in group.data_vars if group[c].dims == ("time",) or (not group[c].dims and group[c].dtype.kind in "fiu")]
            columns = {str(c): np.broadcast_to(group[c].values.astype(float), time.shape) for c in numbers}  # a scalar holds all along
            units = {c: str(group[c].attrs["units"]) for c in columns if "units" in group[c].attrs}
            tables[name] = Table(time, columns, units)
        group.close()
    return tables, attrs


_HEAD = re.compile(r"^(.*?)\s*[\[(]([^\])]*)[\])]$")


def read_csv(path: str | Path, clock: Clock) -> tuple[dict[str, Table], dict[str, Any]]:
    """Return a CSV file (plain or ``.gz``) as one table; lines that start with ``#`` are skipped.

    Units stand in the heading (``alpha [deg]``), in a second line, or in the name map.

    Raises
    ------
    ParseError
        With the line: a cell that is no number, or no heading.
    UnknownName
        The clock's column is not there.
    """
    import pandas as pd

    first, heads, second = _heading(path)
    has_units = bool(second) and not any(_number(cell) for cell in second)
    units = dict(zip(heads, second, strict=True)) if has_units and len(second) == len(heads) else {}
    names = []
    for head in heads:
        match = _HEAD.match(head)
        names.append(match.group(1) if match else head)
        if match:
            units[names[-1]] = match.group(2)
    begin = first + has_units
    try:
        body = pd.read_csv(path, comment="#", skipinitialspace=True, names=names, header=None, skiprows=begin, low_memory=False)
    except (pd.errors.ParserError, pd.errors.EmptyDataError) as error:
        raise ParseError(str(path), 0, str(error), "as many cells in every line as the line of names has") from error
    columns = {name: _numbers(body[name], str(path), begin + 1) for name in names}
    if clock.column not in columns:
        raise UnknownName(clock.column, names, "time column", 'name it in the name map: [time] column = "..."')
    time = columns.pop(clock.column)
    return {"data": Table(time, columns, {k: u for k, u in units.items() if k in columns})}, {"title": Path(path).name.split(".")[0]}


def _heading(path: str | Path) -> tuple[int, list[str], list[str]]:
    """Return the number of lines up to the names, the names, and the cells of the line after."""
    opened: Callable[..., Any] = gzip.open if str(path).endswith(".gz") else open
    lines: list[tuple[int, list[str]]] = []
    with opened(path, "rt", encoding="utf-8-sig") as file:
        try:
            for number, line in enumerate(file, 1):
                if line.strip() and not line.startswith("#"):
                    lines.append((number, [cell.strip() for cell in line.split(",")]))
                if len(lines) == 2:
                    break
        except (UnicodeDecodeError, gzip.BadGzipFile) as error:
            raise ParseError(str(path), 0, str(error), "comma-separated columns under one line of names") from error
    if not lines:
        raise ParseError(str(path), 0, "no line with content", "comma-separated columns under one line of names")
    return lines[0][0], lines[0][1], lines[1][1] if len(lines) > 1 else []


def _number(cell: str) -> bool:
    try:
        return np.isfinite(float(cell))
    except ValueError:
        return False


def _numbers(column, file: str, first: int) -> np.ndarray:
    """Return a column as floats, blank cells as NaN."""
    import pandas as pd

    values = pd.to_numeric(column, errors="coerce")
    wrong = values.isna() & column.notna()
    if wrong.any():
        at = int(np.flatnonzero(wrong)[0])
        raise ParseError(file, first + at, f"{column.iloc[at]!r} in column {column.name!r}", "a number or an empty cell")
    return values.to_numpy(float)
