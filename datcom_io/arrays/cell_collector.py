"""Collection of all printed cells of many pages into one pandas frame.

A listing prints the same few texts over and over, so every distinct text is read once and the cells
are codes of texts.  The other columns of the frame are constant over a row, a table or a page; they
are spread over the cells at the end, when all cells are counted.
"""

from __future__ import annotations

from array import array
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Mapping
from itertools import chain, count
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from datcom_io.cells import FLAGS, read_cells
from datcom_io.printout.content import Page, PrintedCase
from datcom_io.printout.rows import PrintedColumn
from datcom_io.printout.tables import PrintedTable, PrintedValues

AXES = ("alpha", "delta", "delta_left", "delta_right", "delta_difference")
RARE_AXES = ("mach_node", "time", "xs_c", "hs_c", "dd_c", "ds_c")
FIRST_COLUMNS = ("line", "case", "page", "table", "mach", "altitude")
LAST_COLUMNS = ("column", "text", "value", "flag")

_FLAGS = pd.CategoricalDtype(pd.Index(FLAGS, dtype="str"))
# Columns of a row of one cell, whose name is stored separately.
_ONE_CELL = (PrintedColumn("", 1, 1),)


def _number_words() -> defaultdict[Any, int]:
    """Return a dict that numbers words from 0, in order of appearance."""
    return defaultdict(count().__next__)


# Values that repeat over many cells are stored once: per page, per strip of rows, per pattern of
# columns.
class _PageFacts(NamedTuple):
    """Values that all cells of a page have in common."""

    case: int
    page: int
    mach: float
    altitude: float


class _Strip(NamedTuple):
    """Rows of equal columns: their number, the index of their pattern, and their page."""

    rows: int
    columns: int
    pattern: int
    table: int
    case: int
    page: int
    mach: float
    altitude: float


class _Pattern(NamedTuple):
    """Equal columns of many rows.

    ``start`` is the position of their names among those of all patterns, ``axes`` gives the columns
    that are axes, ``cut`` cuts a row into fields.
    """

    number: int
    columns: tuple[PrintedColumn, ...]
    start: int
    axes: dict[str, int]
    cut: Callable[[str], Iterable[str]]


class _Override(NamedTuple):
    """Values of a column of the frame for cells from ``start`` on, instead of those of the rows."""

    column: str
    start: int
    values: np.ndarray


class _Rows(NamedTuple):
    """Rows of all strips: first cell, number of cells and pattern of each row."""

    start: np.ndarray
    columns: np.ndarray
    pattern: np.ndarray


class CellCollector:
    """The cells of pages, in order of the print."""

    def __init__(self) -> None:
        self.pages = _number_words()
        self.tables = _number_words()
        self.columns = _number_words()
        # Fields of every row of every table; a row is cut when its cells are counted.
        self.rows: list[Iterable[Iterable[str]]] = []
        self.count = 0
        self.lines = array("i")
        self.strips: list[_Strip] = []
        # By the identity of their columns, which the pattern keeps.
        self.patterns: dict[tuple[int, int], _Pattern] = {}
        self.pattern_columns: list[int] = []  # codes of the column names of all patterns
        self.overrides: list[_Override] = []

    # Collection of pages.

    def add_page(self, case: PrintedCase, page: Page) -> None:
        """Add the cells of a page."""
        facts = _PageFacts(
            case=case.ordinal,
            page=self.pages[" / ".join(page.heading)],
            mach=page.condition("mach"),
            altitude=page.condition("h"),
        )
        for item in (page.conditions, *page.printed):
            if isinstance(item, PrintedTable):
                self._add_heading(item, facts)
                self._add_table(case, item, facts)
            elif isinstance(item, PrintedValues):
                self._add_values(item, facts)

    def _add_table(self, case: PrintedCase, table: PrintedTable, facts: _PageFacts) -> None:
        start = self.count
        layout = table.layout
        pattern = self._find_pattern(table.columns, layout.keys)
        self.rows.append(map(pattern.cut, table.rows))
        self._add_strip(table.name, table.lines, pattern, facts)
        if table.given is not None or table.suspect is not None:
            self._override("value", start, table.values)
            self._override("flag", start, table.flags)
        if table.across is not None and layout.across is not None:
            # The key columns of a two-way table have no value along the heading.
            axis = np.concatenate((np.full(layout.keys, np.nan), table.across))
            self._override(layout.across.quantity, start, np.tile(axis, len(table.rows)))
        if layout.axes is not None:
            self._override_axes(layout.axes(case.deck, table), start)

    def _add_heading(self, table: PrintedTable, facts: _PageFacts) -> None:
        """Add the heading values of a two-way table, as rows of one cell."""
        # The heading line prints one value above each value column.
        across, values = table.layout.across, table.across
        if across is None or values is None:
            return
        start = self.count
        texts = []
        for k in range(len(values)):
            shift = k * across.step
            first = max(0, across.first - 1 + shift)
            texts.append(table.across_row[first : across.last + shift].strip(" ="))
        self.rows.append((texts,))
        pattern = self._find_pattern(_ONE_CELL, 0)
        self._add_strip(table.name, [table.across_line] * len(values), pattern, facts)
        self._override("column", start, np.full(len(values), self.columns[across.name]))
        self._override("value", start, values)
        self._override(across.quantity, start, values)

    def _add_values(self, group: PrintedValues, facts: _PageFacts) -> None:
        start = self.count
        self.rows.append((group.texts,))
        self._add_strip(group.name, group.lines, self._find_pattern(_ONE_CELL, 0), facts)
        self._override("column", start, np.array([self.columns[label] for label in group.labels]))
        if group.given is not None:
            self._override("value", start, group.values)
            self._override("flag", start, group.flags)
        self._override_axes(group.axes, start)

    def _add_strip(
        self, name: str, lines: Collection[int], pattern: _Pattern, facts: _PageFacts
    ) -> None:
        self.lines.extend(lines)
        self.count += len(lines) * len(pattern.columns)
        strip = _Strip(
            rows=len(lines),
            columns=len(pattern.columns),
            pattern=pattern.number,
            table=self.tables[name],
            case=facts.case,
            page=facts.page,
            mach=facts.mach,
            altitude=facts.altitude,
        )
        self.strips.append(strip)

    def _override(self, column: str, start: int, values: np.ndarray) -> None:
        self.overrides.append(_Override(column, start, np.ravel(values)))

    def _override_axes(self, axes: Mapping[str, np.ndarray], start: int) -> None:
        for name, values in axes.items():
            self._override(name, start, values)

    def _find_pattern(self, columns: tuple[PrintedColumn, ...], keys: int) -> _Pattern:
        """Return the pattern of some columns, a new one when they come for the first time."""
        # Tables of one kind share the tuple of their columns, so its identity is a fast key.
        pattern = self.patterns.get((id(columns), keys))
        if pattern is not None:
            return pattern
        axes = {}
        for k, column in enumerate(columns[:keys]):
            if column.quantity:
                axes[column.quantity] = k
        pattern = _Pattern(
            number=len(self.patterns),
            columns=columns,
            start=len(self.pattern_columns),
            axes=axes,
            cut=_make_cutter(columns),
        )
        self.pattern_columns += [self.columns[column.name] for column in columns]
        self.patterns[id(columns), keys] = pattern
        return pattern

    # Frame of all cells.

    def make_frame(self) -> pd.DataFrame:
        """Return the frame: values of rows, tables and pages spread over the cells."""
        strips = {}
        for k, name in enumerate(_Strip._fields):
            strips[name] = np.array([strip[k] for strip in self.strips])
        # One number per strip, per row or per cell; a value of a strip is repeated over its cells.
        row_counts = strips["rows"].astype(np.int64)
        cell_counts = row_counts * strips["columns"].astype(np.int64)
        row_columns = np.repeat(strips["columns"], row_counts).astype(np.int64)
        rows = _Rows(
            start=np.cumsum(row_columns) - row_columns,
            columns=row_columns,
            pattern=np.repeat(strips["pattern"], row_counts).astype(np.int64),
        )

        # Every cell becomes the code of its field, and every distinct field is read once.
        codes_of_fields = _number_words()
        fields = chain.from_iterable(chain.from_iterable(self.rows))
        codes = np.fromiter(map(codes_of_fields.__getitem__, fields), np.int32, self.count)
        texts, text, value, flag = _read_fields(list(codes_of_fields))

        # Small integer types keep the frame of a large listing within memory.
        frame: dict[str, Any] = {
            "line": np.repeat(np.frombuffer(self.lines, np.int32), rows.columns),
            "case": np.repeat(strips["case"].astype(np.int32), cell_counts),
            "page": np.repeat(_smallest_codes(strips["page"], len(self.pages)), cell_counts),
            "table": np.repeat(_smallest_codes(strips["table"], len(self.tables)), cell_counts),
            "mach": np.repeat(strips["mach"].astype(float), cell_counts),
            "altitude": np.repeat(strips["altitude"].astype(float), cell_counts),
            "column": self._column_codes(rows, len(codes)),
            "text": text[codes],
            "value": value[codes],
            "flag": flag[codes],
        }
        # The keys of a row are read from its values, so overrides of values come before the axes.
        self._apply_overrides(frame, ("column", "value", "flag"))
        axes = self._axis_names(frame)
        for name in axes:
            if name not in frame:
                frame[name] = self._axis_values(name, frame["value"], rows)
        self._apply_overrides(frame, (*axes, "mach", "altitude"))

        categories = {
            "page": self.pages,
            "table": self.tables,
            "column": self.columns,
            "text": texts,
        }
        for name, texts_of_codes in categories.items():
            index = pd.Index(list(texts_of_codes), dtype="str")
            frame[name] = pd.Categorical.from_codes(frame[name], index, validate=False)
        frame["flag"] = pd.Categorical.from_codes(frame["flag"], dtype=_FLAGS, validate=False)
        other_axes = [name for name in axes if name not in FIRST_COLUMNS]
        order = (*FIRST_COLUMNS, *other_axes, *LAST_COLUMNS)
        return pd.DataFrame({name: frame[name] for name in order}, copy=False)

    def _axis_names(self, frame: Mapping[str, object]) -> tuple[str, ...]:
        """Return the axes of the frame: the usual ones, and those rare ones that a table has."""
        present: set[str] = set()
        for pattern in self.patterns.values():
            present |= pattern.axes.keys()
        for override in self.overrides:
            if override.column not in frame:
                present.add(override.column)
        return (*AXES, *(name for name in RARE_AXES if name in present))

    def _apply_overrides(self, frame: dict[str, Any], names: tuple[str, ...]) -> None:
        for name, start, values in self.overrides:
            if name in names:
                frame[name][start : start + len(values)] = values

    def _column_codes(self, rows: _Rows, cells: int) -> np.ndarray:
        """Return the code of the column name of each cell."""
        if not self.patterns:
            return np.empty(0, np.int8)
        names = _smallest_codes(np.array(self.pattern_columns), len(self.columns))
        starts = np.array([pattern.start for pattern in self.patterns.values()])
        # Position in `names` = start of the pattern + position of the cell in its row.
        offset = starts[rows.pattern] - rows.start
        return names[np.repeat(offset, rows.columns) + np.arange(cells)]

    def _axis_values(self, name: str, value: np.ndarray, rows: _Rows) -> np.ndarray:
        """Return an axis for each cell: the key of its row, NaN for rows without this axis."""
        keys = np.array(
            [pattern.axes.get(name, -1) for pattern in self.patterns.values()], np.int64
        )
        if not len(keys) or keys.max() < 0:
            return np.full(len(value), np.nan)
        # The key of a row is the value of its key column; -1 marks a pattern without this axis.
        key = keys[rows.pattern]
        of_row = np.where(key < 0, np.nan, value[rows.start + np.maximum(key, 0)])
        return np.repeat(of_row, rows.columns)


def _read_fields(fields: list[str]) -> tuple[list[str], np.ndarray, np.ndarray, np.ndarray]:
    """Return the distinct texts, and for each field index of its text, value and flag."""
    # Fields that differ by blanks only have the same text.
    texts = _number_words()
    text = np.fromiter(map(texts.__getitem__, map(str.strip, fields)), np.int32, len(fields))
    value, flag = read_cells(fields)
    return list(texts), text, value, flag.astype(np.int8)


def _smallest_codes(codes: np.ndarray, size: int) -> np.ndarray:
    """Return codes in the smallest type that holds so many different ones."""
    if size < 1 << 7:
        return codes.astype(np.int8)
    if size < 1 << 15:
        return codes.astype(np.int16)
    return codes.astype(np.int32)


def _make_cutter(columns: tuple[PrintedColumn, ...]) -> Callable[[str], Iterable[str]]:
    """Return a function that cuts a row into its fields."""
    parts = [slice(column.first - 1, column.last) for column in columns]
    # With one item an itemgetter returns the field itself, not a tuple.
    if len(parts) == 1:
        return lambda row: (row[parts[0]],)
    return itemgetter(*parts)
