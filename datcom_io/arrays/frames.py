"""All printed cells as one pandas frame.

A listing prints the same few texts over and over, so every distinct text is read once and the cells
are codes of texts.  The rest of a cell is known for its row, its table or its page, and is spread
over the cells when all of them are counted.
"""

from __future__ import annotations

import os
from array import array
from collections import defaultdict
from collections.abc import Callable, Collection, Hashable, Iterable, Mapping
from itertools import chain, count
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from datcom_io.cells import BLANK, FLAGS, OK, read_cells
from datcom_io.printout.content import Page, PrintedCase, paused_collection
from datcom_io.printout.layouts import BY_NAME
from datcom_io.printout.rows import PrintedColumn
from datcom_io.printout.tables import PrintedTable, PrintedValues
from flightmech.support.atomic_write import written_atomically

AXES = ("alpha", "delta", "delta_left", "delta_right", "delta_difference")
_RARE_AXES = ("mach_node", "time", "xs_c", "hs_c", "dd_c", "ds_c")
_FIRST = ("line", "case", "page", "table", "mach", "altitude")
_ALONE = (
    PrintedColumn("", 1, 1),
)  # a cell in a row of its own, whose column is identified separately
_LAST = ("column", "text", "value", "flag")
COLUMNS = (*_FIRST, *AXES, *_RARE_AXES, *_LAST)
"""All columns that a frame of cells may have; the axes after ``delta_difference`` only where a table has them."""


def make_cell_frame(cases: Iterable[PrintedCase]) -> pd.DataFrame:
    """Build the frame of `Listing.cells` and `Case.cells`."""
    gathered = _Gathered()
    with paused_collection():
        for case in cases:
            for page in case.pages:
                gathered.add_page(case, page)
        return gathered.frame()


def _codes() -> defaultdict[Any, int]:
    """Return a dict that numbers words from 0, in order of appearance."""
    return defaultdict(count().__next__)


def _read(
    fields: Collection[Hashable], words: bool
) -> tuple[list[str], np.ndarray, np.ndarray, np.ndarray]:
    """Return the distinct texts, and for each field the index of its text, its value and its flag;
    with `words` some are tuples.
    """
    parts: list[Any] = (
        [field[0] if isinstance(field, tuple) else field for field in fields]
        if words
        else list(fields)
    )
    texts = _codes()
    text = np.fromiter(map(texts.__getitem__, map(str.strip, parts)), np.int32, len(parts))
    value, flag = read_cells(parts)
    for i in [i for i, field in enumerate(fields) if isinstance(field, tuple)] if words else ():
        value[i], flag[i] = np.nan, OK if parts[i].strip() else BLANK
    return list(texts), text, value, flag.astype(np.int8)


_FLAGS = pd.CategoricalDtype(pd.Index(FLAGS, dtype="str"))


class _PageFacts(NamedTuple):
    """What the cells of a page have in common."""

    case: int
    page: int
    mach: float
    altitude: float


class _Strip(NamedTuple):
    """Rows of equal columns: how many, the index of their pattern, and where they stand."""

    rows: int
    columns: int
    pattern: int
    table: int
    case: int
    page: int
    mach: float
    altitude: float


class _Pattern(NamedTuple):
    """Equal columns of many rows: the place of their names, which of them are axes, how to cut a
    row.
    """

    number: int
    columns: tuple[PrintedColumn, ...]
    start: int
    axes: dict[str, int]
    cut: Callable[[str], Iterable[Hashable]]
    words: bool


class _Override(NamedTuple):
    """Values of a column of the frame for cells from ``start`` on, where they are not those of the
    pattern.
    """

    column: str
    start: int
    values: np.ndarray


class _Gathered:
    """What the cells are made of, in order of the print."""

    def __init__(self) -> None:
        self.pages, self.tables, self.columns = _codes(), _codes(), _codes()
        self.rows: list[
            Iterable[Iterable[Hashable]]
        ] = []  # fields of every row of every table, cut when they are counted
        self.count = 0
        self.lines = array("i")
        self.strips: list[_Strip] = []
        self.patterns: dict[
            tuple[int, int], _Pattern
        ] = {}  # by the identity of their columns, which they keep
        self.pattern_columns: list[int] = []  # codes of the column names of all patterns
        self.overrides: list[_Override] = []

    def add_page(self, case: PrintedCase, page: Page) -> None:
        """Gather the cells of a page."""
        place = _PageFacts(
            case.ordinal,
            self.pages[" / ".join(page.heading)],
            page.condition("mach"),
            page.condition("h"),
        )
        for item in (page.conditions, *page.printed):
            if isinstance(item, PrintedTable):
                self._add_heading(item, place)
                self._add_table(case, item, place)
            elif isinstance(item, PrintedValues):
                self._add_values(item, place)

    def _strip(
        self, name: str, lines: Iterable[int], rows: int, pattern: _Pattern, place: _PageFacts
    ) -> None:
        self.lines.extend(lines)
        self.count += rows * len(pattern.columns)
        self.strips.append(
            _Strip(rows, len(pattern.columns), pattern.number, self.tables[name], *place)
        )

    def _add_table(self, case: PrintedCase, table: PrintedTable, place: _PageFacts) -> None:
        start = self.count
        pattern = self._pattern(table.columns, table.layout.keys)
        self.rows.append(map(pattern.cut, table.rows))
        self._strip(table.name, table.lines, len(table.rows), pattern, place)
        if table.given is not None or table.suspect is not None:
            self._override("value", start, table.values)
            self._override("flag", start, table.flags)
        if table.across is not None and table.layout.across is not None:
            axis = np.concatenate((np.full(table.layout.keys, np.nan), table.across))
            self._override(table.layout.across.quantity, start, np.tile(axis, len(table.rows)))
        if table.layout.axes is not None:
            self._override_axes(table.layout.axes(case.deck, table), start)

    def _add_heading(self, table: PrintedTable, place: _PageFacts) -> None:
        """Gather the heading values of a two-way table, as rows of one cell."""
        across, values = table.layout.across, table.across
        if across is None or values is None:
            return
        start = self.count
        shifts = [k * across.step for k in range(len(values))]
        texts = [
            table.across_row[max(0, across.first - 1 + shift) : across.last + shift].strip(" =")
            for shift in shifts
        ]
        self.rows.append((texts,))
        self._strip(
            table.name,
            [table.across_line] * len(values),
            len(values),
            self._pattern(_ALONE, 0),
            place,
        )
        self._override("column", start, np.full(len(values), self.columns[across.name]))
        self._override("value", start, values)
        self._override(across.quantity, start, values)

    def _add_values(self, group: PrintedValues, place: _PageFacts) -> None:
        start = self.count
        self.rows.append((group.texts,))
        self._strip(group.name, group.lines, len(group.lines), self._pattern(_ALONE, 0), place)
        self._override("column", start, np.array([self.columns[label] for label in group.labels]))
        if group.given is not None:
            self._override("value", start, group.values)
            self._override("flag", start, group.flags)
        self._override_axes(group.axes, start)

    def _override(self, column: str, start: int, values: np.ndarray) -> None:
        self.overrides.append(_Override(column, start, np.ravel(values)))

    def _override_axes(self, axes: Mapping[str, np.ndarray], start: int) -> None:
        for name, values in axes.items():
            self._override(name, start, values)

    def _pattern(self, columns: tuple[PrintedColumn, ...], keys: int) -> _Pattern:
        pattern = self.patterns.get((id(columns), keys))
        if pattern is None:
            start = len(self.pattern_columns)
            self.pattern_columns += [self.columns[column.name] for column in columns]
            axes = {
                column.quantity: k for k, column in enumerate(columns[:keys]) if column.quantity
            }
            pattern = _Pattern(
                len(self.patterns),
                columns,
                start,
                axes,
                _cutter(columns),
                any(column.words for column in columns),
            )
            self.patterns[id(columns), keys] = pattern
        return pattern

    def frame(self) -> pd.DataFrame:
        """Spread what is known of rows, tables and pages over the cells."""
        strips = {
            name: np.array([strip[k] for strip in self.strips])
            for k, name in enumerate(_Strip._fields)
        }
        rows = strips["rows"].astype(np.int64)
        of_strip = rows * strips["columns"].astype(np.int64)
        columns_of_row = np.repeat(strips["columns"], rows).astype(np.int64)
        pattern_of_row = np.repeat(strips["pattern"], rows).astype(np.int64)
        start_of_row = np.cumsum(columns_of_row) - columns_of_row
        fields = _codes()
        codes = np.fromiter(
            map(fields.__getitem__, chain.from_iterable(chain.from_iterable(self.rows))),
            np.int32,
            self.count,
        )
        texts, text, value, flag = _read(
            fields, any(pattern.words for pattern in self.patterns.values())
        )
        found: dict[str, Any] = {
            "line": np.repeat(np.frombuffer(self.lines, np.int32), columns_of_row),
            "case": np.repeat(strips["case"].astype(np.int32), of_strip),
            "page": np.repeat(_small(strips["page"], len(self.pages)), of_strip),
            "table": np.repeat(_small(strips["table"], len(self.tables)), of_strip),
            "mach": np.repeat(strips["mach"].astype(float), of_strip),
            "altitude": np.repeat(strips["altitude"].astype(float), of_strip),
            "column": self._columns(start_of_row, columns_of_row, pattern_of_row, len(codes)),
            "text": text[codes],
            "value": value[codes],
            "flag": flag[codes],
        }
        self._apply_overrides(found, ("column", "value", "flag"))
        axes = self._axes(found)
        for name in axes:
            found.setdefault(
                name, self._axis(name, found["value"], start_of_row, columns_of_row, pattern_of_row)
            )
        self._apply_overrides(found, (*axes, "mach", "altitude"))
        for name, words in {
            "page": self.pages,
            "table": self.tables,
            "column": self.columns,
            "text": texts,
        }.items():
            found[name] = pd.Categorical.from_codes(
                found[name], pd.Index(list(words), dtype="str"), validate=False
            )
        found["flag"] = pd.Categorical.from_codes(found["flag"], dtype=_FLAGS, validate=False)
        order = (*_FIRST, *(name for name in axes if name not in _FIRST), *_LAST)
        return pd.DataFrame({name: found[name] for name in order}, copy=False)

    def _axes(self, found: Mapping[str, object]) -> tuple[str, ...]:
        of_rows = {name for pattern in self.patterns.values() for name in pattern.axes}
        of_cells = {override.column for override in self.overrides if override.column not in found}
        return (*AXES, *(name for name in _RARE_AXES if name in of_rows | of_cells))

    def _apply_overrides(self, found: dict[str, Any], names: tuple[str, ...]) -> None:
        for name, start, values in self.overrides:
            if name in names:
                found[name][start : start + len(values)] = values

    def _columns(
        self,
        start_of_row: np.ndarray,
        columns_of_row: np.ndarray,
        pattern_of_row: np.ndarray,
        count: int,
    ) -> np.ndarray:
        if not self.patterns:
            return np.empty(0, np.int8)
        first = (
            np.array([pattern.start for pattern in self.patterns.values()])[pattern_of_row]
            - start_of_row
        )
        return _small(np.array(self.pattern_columns), len(self.columns))[
            np.repeat(first, columns_of_row) + np.arange(count)
        ]

    def _axis(
        self,
        name: str,
        value: np.ndarray,
        start_of_row: np.ndarray,
        columns_of_row: np.ndarray,
        pattern_of_row: np.ndarray,
    ) -> np.ndarray:
        keys = np.array(
            [pattern.axes.get(name, -1) for pattern in self.patterns.values()], np.int64
        )
        if not len(keys) or keys.max() < 0:
            return np.full(len(value), np.nan)
        key = keys[pattern_of_row]
        of_row = np.where(key < 0, np.nan, value[start_of_row + np.maximum(key, 0)])
        return np.repeat(of_row, columns_of_row)


def _small(codes: np.ndarray, count: int) -> np.ndarray:
    """Return codes in the smallest type that holds `count` words."""
    return codes.astype(np.int8 if count < 1 << 7 else np.int16 if count < 1 << 15 else np.int32)


def _cutter(columns: tuple[PrintedColumn, ...]) -> Callable[[str], Iterable[Hashable]]:
    """Return a function that cuts a row into its fields; those of columns of words are put into
    tuples.
    """
    parts = [slice(column.first - 1, column.last) for column in columns]
    if any(column.words for column in columns):
        return lambda row: [
            (row[part],) if column.words else row[part] for part, column in zip(parts, columns)
        ]
    return itemgetter(*parts) if len(parts) > 1 else lambda row: (row[parts[0]],)


_PRINTED_UNITS = {
    "length": {"FT": "ft", "IN": "in", "M": "m", "CM": "cm"},
    "area": {"FT": "ft2", "IN": "in2", "M": "m2", "CM": "cm2"},
    "speed": {"FT": "ft/s", "IN": "in/s", "M": "m/s", "CM": "cm/s"},
    "pressure": {"FT": "psf", "IN": "psi", "M": "Pa", "CM": "Pa"},
    "temperature": {"FT": "degR", "IN": "degR", "M": "K", "CM": "K"},
    "reynolds": {"FT": "1/ft", "IN": "1/ft", "M": "1/m", "CM": "1/m"},
}
_PAGE_COLUMNS = ("line", "configuration", "mach", "altitude", "ground_height", "flap")


def printed_units(column: PrintedColumn, page: Page) -> str:
    """Return the unit in which a page prints a column."""
    if column.units == "1/angle":
        return f"1/{page.per or 'deg'}"
    return _PRINTED_UNITS.get(column.units, {}).get(page.dim, column.units)


def make_block_frame(case: PrintedCase, name: str) -> pd.DataFrame:
    """Build the frame of `Case.block`."""
    parts, units = [], {"ground_height": "ft", "flap": "deg"}
    for page, table in case.tables(name):
        part = (
            _stream(table, case)
            if table.layout.stream
            else _wide(table)
            if table.across is None
            else _long(table)
        )
        parts.append(_placed(part, page))
        columns = (
            table.columns[: table.layout.keys + 1] if table.across is not None else table.columns
        )
        units |= {column.name: printed_units(column, page) for column in columns}
        units["altitude"] = printed_units(PrintedColumn("", 1, 1, units="length"), page)
        if table.layout.across:
            units[table.layout.across.name] = "deg"
        if table.layout.stream:
            units |= {"ALPHA": "deg", "DELTA": "deg"}
    for page, group in (
        () if parts else case.values(name)
    ):  # a kind of table may carry its headings as labelled numbers
        parts.append(_placed(_labelled(group), page))
        units["altitude"] = printed_units(PrintedColumn("", 1, 1, units="length"), page)
    if not parts:
        columns = BY_NAME[name].columns if name in BY_NAME else ()
        return pd.DataFrame(columns=[*_PAGE_COLUMNS, *(column.name for column in columns)])
    found = pd.concat(parts, ignore_index=True)
    found.attrs["units"] = units
    return found


def _placed(part: pd.DataFrame, page: Page) -> pd.DataFrame:
    """Put what names the page behind the line numbers."""
    place: tuple[Any, ...] = (
        page.configuration,
        page.condition("mach"),
        page.condition("h"),
        page.ground_height,
        page.flap,
    )
    for at, (column, value) in enumerate(zip(_PAGE_COLUMNS[1:], place), 1):
        part.insert(at, column, value)
    return part


def _labelled(group: PrintedValues) -> pd.DataFrame:
    """Return a group of ``label = value`` as one row per value."""
    units = group.units or ("",) * len(group.labels)
    return pd.DataFrame(
        {
            "line": group.lines,
            "label": group.labels,
            "text": group.texts,
            "value": group.values,
            "unit": units,
        }
    )


def _wide(table: PrintedTable) -> pd.DataFrame:
    frame = pd.DataFrame(table.values, columns=[column.name for column in table.columns])
    frame.insert(0, "line", table.lines)
    return frame


def _stream(table: PrintedTable, case: PrintedCase) -> pd.DataFrame:
    """Unfold a stream of values into one row per value, with the axis values that the input cards
    give.
    """
    printed = table.flags.ravel() != BLANK
    axes = table.layout.axes(case.deck, table) if table.layout.axes else {}
    parts = {
        "line": np.repeat(table.lines, len(table.columns)),
        **{name.upper(): values.ravel() for name, values in axes.items()},
    }
    return pd.DataFrame(
        {
            name: values[printed]
            for name, values in {**parts, table.columns[0].name: table.values.ravel()}.items()
        }
    )


def _long(table: PrintedTable) -> pd.DataFrame:
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


def write_tree(tree: xr.DataTree, path: str | os.PathLike[str]) -> None:
    """Write a DataTree as netCDF-4; a file that stood there stays as it was when writing fails.

    Parameters
    ----------
    tree : DataTree
        As `Case.to_datatree`, `Listing.to_datatree` or `datcom_io.join` return it.
    path : path
        File to write; its folder must exist.
    """
    with written_atomically(path) as part:
        tree.to_netcdf(part, engine="h5netcdf")


def write_cells(cases: Iterable[PrintedCase], path: str | os.PathLike[str]) -> int:
    """Write the cells of cases as they come, one line per cell; a file that stood there stays as it
    was when writing fails.

    Parameters
    ----------
    cases : iterable of PrintedCase
        A `Listing`, or what `datcom_io.iterate` returns: then one case at a time is held in memory.
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
            frame = make_cell_frame([case]).reindex(columns=list(COLUMNS))
            frame.to_csv(stream, header=False, index=False, lineterminator="\n")
            count += len(frame)
    return count
