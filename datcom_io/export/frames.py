"""Printed tables as pandas frames."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ..cells import BLANK
from ..printout.columns import Column
from ..printout.content import Page, PrintedCase
from ..printout.layouts import BY_NAME
from ..printout.tables import Table, Values

_PRINTED_UNITS = {
    "length": {"FT": "ft", "IN": "in", "M": "m", "CM": "cm"},
    "area": {"FT": "ft2", "IN": "in2", "M": "m2", "CM": "cm2"},
    "speed": {"FT": "ft/s", "IN": "in/s", "M": "m/s", "CM": "cm/s"},
    "pressure": {"FT": "psf", "IN": "psi", "M": "Pa", "CM": "Pa"},
    "temperature": {"FT": "degR", "IN": "degR", "M": "K", "CM": "K"},
    "reynolds": {"FT": "1/ft", "IN": "1/ft", "M": "1/m", "CM": "1/m"},
}
_PAGE_COLUMNS = ("line", "configuration", "mach", "altitude", "ground_height", "flap")


def printed_units(column: Column, page: Page) -> str:
    """Return the unit in which a page prints a column."""
    if column.units == "1/angle":
        return f"1/{page.per or 'deg'}"
    return _PRINTED_UNITS.get(column.units, {}).get(page.dim, column.units)


def block(case: PrintedCase, name: str) -> pd.DataFrame:
    """Build the frame of `Case.block`."""
    parts, units = [], {"ground_height": "ft", "flap": "deg"}
    for page, table in case.tables(name):
        part = _stream(table, case) if table.layout.stream else _wide(table) if table.across is None else _long(table)
        parts.append(_placed(part, page))
        columns = table.columns[: table.layout.keys + 1] if table.across is not None else table.columns
        units |= {column.name: printed_units(column, page) for column in columns}
        units["altitude"] = printed_units(Column("", 1, 1, units="length"), page)
        if table.layout.across:
            units[table.layout.across.name] = "deg"
        if table.layout.stream:
            units |= {"ALPHA": "deg", "DELTA": "deg"}
    for page, group in () if parts else case.values(name):  # a kind of table may carry its headings as labelled numbers
        parts.append(_placed(_labelled(group), page))
        units["altitude"] = printed_units(Column("", 1, 1, units="length"), page)
    if not parts:
        columns = BY_NAME[name].columns if name in BY_NAME else ()
        return pd.DataFrame(columns=[*_PAGE_COLUMNS, *(column.name for column in columns)])
    found = pd.concat(parts, ignore_index=True)
    found.attrs["units"] = units
    return found


def _placed(part: pd.DataFrame, page: Page) -> pd.DataFrame:
    """Put what names the page behind the line numbers."""
    place: tuple[Any, ...] = (page.configuration, page.condition("mach"), page.condition("h"), page.ground_height, page.flap)
    for at, (column, value) in enumerate(zip(_PAGE_COLUMNS[1:], place), 1):
        part.insert(at, column, value)
    return part


def _labelled(group: Values) -> pd.DataFrame:
    """Return a group of ``label = value`` as one row per value."""
    units = group.units or ("",) * len(group.labels)
    return pd.DataFrame({"line": group.lines, "label": group.labels, "text": group.texts, "value": group.values, "unit": units})


def _wide(table: Table) -> pd.DataFrame:
    frame = pd.DataFrame(table.values, columns=[column.name for column in table.columns])
    frame.insert(0, "line", table.lines)
    return frame


def _stream(table: Table, case: PrintedCase) -> pd.DataFrame:
    """Unfold a stream of values into one row per value, with the axis values that the input cards give."""
    printed = table.flags.ravel() != BLANK
    axes = table.layout.axes(case.deck, table) if table.layout.axes else {}
    parts = {"line": np.repeat(table.lines, len(table.columns)), **{name.upper(): values.ravel() for name, values in axes.items()}}
    return pd.DataFrame({name: values[printed] for name, values in {**parts, table.columns[0].name: table.values.ravel()}.items()})


def _long(table: Table) -> pd.DataFrame:
    """Unfold a two-way table into one row per value."""
    across = table.layout.across
    assert across is not None
    assert table.across is not None
    rows, count = len(table.rows), len(table.across)
    return pd.DataFrame(
        {
            "line": np.repeat(table.lines, count),
            table.columns[0].name: np.repeat(table.values[:, 0], count),
            across.name: np.tile(table.across, rows),
            across.cell.name: table.values[:, 1:].ravel(),
        }
    )
