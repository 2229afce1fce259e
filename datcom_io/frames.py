"""Printed tables as pandas frames."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from .cells import FLAGS
from .layouts import BY_NAME
from .layouts.form import Column
from .listing import Case, Listing, Page
from .tables import Printed, Table, Values

_PRINTED_UNITS = {
    "length": {"FT": "ft", "IN": "in", "M": "m", "CM": "cm"},
    "area": {"FT": "ft2", "IN": "in2", "M": "m2", "CM": "cm2"},
    "speed": {"FT": "ft/s", "IN": "in/s", "M": "m/s", "CM": "cm/s"},
    "pressure": {"FT": "psf", "IN": "psi", "M": "Pa", "CM": "Pa"},
    "temperature": {"FT": "degR", "IN": "degR", "M": "K", "CM": "K"},
    "reynolds": {"FT": "1/ft", "IN": "1/ft", "M": "1/m", "CM": "1/m"},
}
AXES = ("alpha", "delta", "delta_left", "delta_right", "delta_difference")
_PAGE_COLUMNS = ("line", "configuration", "mach", "altitude", "ground_height", "flap")
CELL_COLUMNS = ("line", "case", "page", "table", "mach", "altitude", *AXES, "column", "text", "value", "flag")


def printed_units(column: Column, page: Page) -> str:
    """Return the unit in which a page prints a column."""
    if column.units == "1/angle":
        return f"1/{page.per or 'deg'}"
    return _PRINTED_UNITS.get(column.units, {}).get(page.dim, column.units)


def block(case: Case, name: str) -> pd.DataFrame:
    """Build the frame of `Case.block`."""
    parts, units = [], {"ground_height": "ft", "flap": "deg"}
    for page, table in case.tables(name):
        part = _wide(table) if table.across is None else _long(table)
        place: tuple[Any, ...] = (page.configuration, page.condition("mach"), page.condition("h"), page.ground_height, page.flap)
        for at, (column, value) in enumerate(zip(_PAGE_COLUMNS[1:], place), 1):
            part.insert(at, column, value)
        parts.append(part)
        columns = table.columns[: table.layout.keys + 1] if table.across is not None else table.columns
        units |= {column.name: printed_units(column, page) for column in columns}
        units["altitude"] = printed_units(Column("", 1, 1, units="length"), page)
        if table.layout.across:
            units[table.layout.across.name] = "deg"
    if not parts:
        columns = BY_NAME[name].columns if name in BY_NAME else ()
        return pd.DataFrame(columns=[*_PAGE_COLUMNS, *(column.name for column in columns)])
    found = pd.concat(parts, ignore_index=True)
    found.attrs["units"] = units
    return found


def _wide(table: Table) -> pd.DataFrame:
    frame = pd.DataFrame(table.values, columns=[column.name for column in table.columns])
    frame.insert(0, "line", table.lines)
    return frame


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


def cells(listing: Listing) -> pd.DataFrame:
    """Build the frame of `Listing.cells`."""
    parts: dict[str, list[np.ndarray]] = {name: [] for name in CELL_COLUMNS}
    words: dict[str, dict[str, int]] = {name: {} for name in ("page", "table", "column")}
    for case in listing:
        for page in case.pages:
            place = {"case": case.ordinal, "mach": page.condition("mach"), "altitude": page.condition("h")}
            heading = " / ".join(page.heading)
            for table in _everything(page):
                parts_of_table = (_heading_cells(table), _row_cells(table)) if isinstance(table, Table) else (_value_cells(table),)
                for part in parts_of_table:
                    count = len(part["value"])
                    part = {name: np.full(count, item) for name, item in place.items()} | part
                    for name, item in (("page", heading), ("table", table.name)):
                        part[name] = np.full(count, words[name].setdefault(item, len(words[name])))
                    codes = [words["column"].setdefault(name, len(words["column"])) for name in part["column"]]
                    part["column"] = np.resize(np.array(codes, dtype=int), count)
                    for name in CELL_COLUMNS:
                        parts[name].append(part[name] if name in part else np.full(count, np.nan))
    frame = pd.DataFrame({name: np.concatenate(parts[name]) if parts[name] else np.empty(0) for name in CELL_COLUMNS})
    for name, kinds in {**{name: list(known) for name, known in words.items()}, "flag": list(FLAGS)}.items():
        frame[name] = pd.Categorical.from_codes(frame[name].to_numpy(dtype=np.int64), pd.Index(kinds))
    return frame.astype({"line": int, "case": int})


def _everything(page: Page) -> Iterator[Printed]:
    if page.conditions is not None:
        yield page.conditions
    yield from page.printed


def _value_cells(group: Values) -> dict[str, Any]:
    """Return the cells of a group of ``label = value``."""
    return {
        "line": np.array(group.lines),
        "column": list(group.labels),
        "text": np.array(group.texts, dtype=object),
        "value": group.values,
        "flag": group.flags,
        **group.axes,
    }


def _heading_cells(table: Table) -> dict[str, Any]:
    """Return the heading values of a two-way table as cells, none for another table; ``column`` holds the names of one line."""
    across, values = table.layout.across, table.across
    if across is None or values is None:
        return {"line": np.empty(0, int), "column": [], "text": np.empty(0, object), "value": np.empty(0), "flag": np.empty(0, int)}
    shifts = [k * across.step for k in range(len(values))]
    texts = [table.across_row[across.first - 1 + shift : across.last + shift].strip(" =") for shift in shifts]
    return {
        "line": np.full(len(values), table.across_line),
        "column": [across.name],
        "text": np.array(texts, dtype=object),
        "value": values,
        "flag": np.zeros(len(values), int),
        across.house: values,
    }


def _row_cells(table: Table) -> dict[str, Any]:
    """Return the cells of a table, row by row; ``column`` holds the names of one row."""
    rows, count, keys = len(table.rows), len(table.columns), table.layout.keys
    spans = [slice(column.first - 1, column.last) for column in table.columns]
    part: dict[str, Any] = {
        "line": np.repeat(table.lines, count),
        "column": [column.name for column in table.columns],
        "text": np.array([row[span].strip() for row in table.rows for span in spans], dtype=object),
        "value": table.values.ravel(),
        "flag": table.flags.ravel(),
    }
    for k in range(keys):
        part[table.columns[k].house] = np.repeat(table.values[:, k], count)
    if table.layout.across is not None and table.across is not None:
        part[table.layout.across.house] = np.tile([*[np.nan] * keys, *table.across], rows)
    return part
