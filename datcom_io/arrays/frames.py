"""Printed numbers as pandas frames: all cells, or the tables of a kind; and files of both forms."""

from __future__ import annotations

import os
from collections.abc import Iterable

import numpy as np
import pandas as pd
import xarray as xr

from datcom_io.arrays.cell_collector import (
    AXES,
    FIRST_COLUMNS,
    LAST_COLUMNS,
    RARE_AXES,
    CellCollector,
)
from datcom_io.cells import BLANK
from datcom_io.printout.content import Page, PrintedCase, paused_collection
from datcom_io.printout.layouts import BY_NAME
from datcom_io.printout.rows import PrintedColumn
from datcom_io.printout.tables import PrintedTable, PrintedValues
from flightmech.support.array_files.netcdf_writing import write_netcdf
from flightmech.support.atomic_write import written_atomically

COLUMNS = (*FIRST_COLUMNS, *AXES, *RARE_AXES, *LAST_COLUMNS)
"""All columns that a frame of cells may have.

The axes after ``delta_difference`` are there only where a table has them.
"""


def make_cell_frame(cases: Iterable[PrintedCase]) -> pd.DataFrame:
    """Build the frame of `Listing.cells` and `Case.cells`."""
    collector = CellCollector()
    with paused_collection():
        for case in cases:
            for page in case.pages:
                collector.add_page(case, page)
        return collector.make_frame()


_PRINTED_UNITS = {
    "length": {"FT": "ft", "IN": "in", "M": "m", "CM": "cm"},
    "area": {"FT": "ft2", "IN": "in2", "M": "m2", "CM": "cm2"},
    "speed": {"FT": "ft/s", "IN": "in/s", "M": "m/s", "CM": "cm/s"},
    "pressure": {"FT": "psf", "IN": "psi", "M": "Pa", "CM": "Pa"},
    "temperature": {"FT": "degR", "IN": "degR", "M": "K", "CM": "K"},
    "reynolds": {"FT": "1/ft", "IN": "1/ft", "M": "1/m", "CM": "1/m"},
}
_PAGE_COLUMNS = ("line", "configuration", "mach", "altitude", "ground_height", "flap")
_ALTITUDE = PrintedColumn("", 1, 1, units="length")


def printed_units(column: PrintedColumn, page: Page) -> str:
    """Return the unit in which a page prints a column."""
    if column.units == "1/angle":
        return f"1/{page.per or 'deg'}"
    return _PRINTED_UNITS.get(column.units, {}).get(page.dim, column.units)


def make_block_frame(case: PrintedCase, name: str) -> pd.DataFrame:
    """Build the frame of `Case.block`."""
    parts: list[pd.DataFrame] = []
    units = {"ground_height": "ft", "flap": "deg"}
    for page, table in case.tables(name):
        parts.append(_add_page_columns(_table_frame(table, case), page))
        units |= _table_units(table, page)
    # A kind of table may print its headings as labelled numbers; they count without a table only.
    if not parts:
        for page, group in case.values(name):
            parts.append(_add_page_columns(_label_frame(group), page))
            units["altitude"] = printed_units(_ALTITUDE, page)
    if not parts:
        columns = BY_NAME[name].columns if name in BY_NAME else ()
        return pd.DataFrame(columns=[*_PAGE_COLUMNS, *(column.name for column in columns)])
    block = pd.concat(parts, ignore_index=True)
    block.attrs["units"] = units
    return block


def _table_units(table: PrintedTable, page: Page) -> dict[str, str]:
    """Return the printed unit of each column of the frame of a table."""
    columns = table.columns
    if table.across is not None:
        # All value columns of a two-way table become one column.
        columns = table.columns[: table.layout.keys + 1]
    units = {column.name: printed_units(column, page) for column in columns}
    units["altitude"] = printed_units(_ALTITUDE, page)
    if table.layout.across:
        units[table.layout.across.name] = "deg"
    if table.layout.stream:
        units |= {"ALPHA": "deg", "DELTA": "deg"}
    return units


def _add_page_columns(part: pd.DataFrame, page: Page) -> pd.DataFrame:
    """Put the columns that name the page behind the line numbers."""
    values: tuple[str | float, ...] = (
        page.configuration,
        page.condition("mach"),
        page.condition("h"),
        page.ground_height,
        page.flap,
    )
    for position, (column, value) in enumerate(zip(_PAGE_COLUMNS[1:], values), 1):
        part.insert(position, column, value)
    return part


def _table_frame(table: PrintedTable, case: PrintedCase) -> pd.DataFrame:
    """Return a table as printed; a two-way table or a stream is unfolded."""
    if table.layout.stream:
        return _stream_frame(table, case)
    if table.across is not None:
        return _two_way_frame(table)
    frame = pd.DataFrame(table.values, columns=[column.name for column in table.columns])
    frame.insert(0, "line", table.lines)
    return frame


def _label_frame(group: PrintedValues) -> pd.DataFrame:
    """Return a group of ``label = value`` as one row per value."""
    columns = {
        "line": group.lines,
        "label": group.labels,
        "text": group.texts,
        "value": group.values,
        "unit": group.units or ("",) * len(group.labels),
    }
    return pd.DataFrame(columns)


def _stream_frame(table: PrintedTable, case: PrintedCase) -> pd.DataFrame:
    """Unfold a stream into one row per value, with axis values of the input cards."""
    # The last line of a stream may be shorter than the others.
    printed = table.flags.ravel() != BLANK
    columns = {"line": np.repeat(table.lines, len(table.columns))[printed]}
    if table.layout.axes:
        for name, values in table.layout.axes(case.deck, table).items():
            columns[name.upper()] = values.ravel()[printed]
    columns[table.columns[0].name] = table.values.ravel()[printed]
    return pd.DataFrame(columns)


def _two_way_frame(table: PrintedTable) -> pd.DataFrame:
    """Unfold a two-way table into one row per value."""
    across = table.layout.across
    assert across is not None
    assert table.across is not None
    # The first column is alpha; the others are values under the headings.
    rows, count = len(table.rows), len(table.across)
    columns = {
        "line": np.repeat(table.lines, count),
        table.columns[0].name: np.repeat(table.values[:, 0], count),
        across.name: np.tile(table.across, rows),
        across.cell.name: table.values[:, 1:].ravel(),
    }
    return pd.DataFrame(columns)


def write_tree(tree: xr.DataTree, path: str | os.PathLike[str]) -> None:
    """Write a DataTree as netCDF-4; an existing file stays as it was when writing fails.

    Parameters
    ----------
    tree : DataTree
        As `Case.to_datatree`, `Listing.to_datatree` or `datcom_io.join` return it.
    path : path
        File to write; its folder must exist.
    """
    with written_atomically(path) as part:
        write_netcdf(tree, part)


def write_cells(cases: Iterable[PrintedCase], path: str | os.PathLike[str]) -> int:
    """Write the cells of cases as they come, one line per cell.

    An existing file stays as it was when writing fails.

    Parameters
    ----------
    cases : iterable of PrintedCase
        A `Listing`, or the result of `datcom_io.iterate`, which holds one case at a time in memory.
    path : path
        CSV file in UTF-8; its folder must exist.  Columns as those of `Case.cells`, all axes
        included; a missing number is empty.

    Returns
    -------
    int
        Cells written.
    """
    count = 0
    with written_atomically(path) as part, open(part, "w", encoding="utf-8", newline="") as stream:
        stream.write(",".join(COLUMNS) + "\n")
        for case in cases:
            # Every case gets all axes, so that all lines have the same columns.
            frame = make_cell_frame([case]).reindex(columns=list(COLUMNS))
            frame.to_csv(stream, header=False, index=False, lineterminator="\n")
            count += len(frame)
    return count
