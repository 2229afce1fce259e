"""Printed tables and groups of ``label = value``: their content, and how their lines are read."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from datcom_io.cells import OK, SUSPECT, read_cell, read_cells
from datcom_io.printout.rows import (
    Cells,
    HeadingAxis,
    Line,
    PrintedColumn,
    cached_column_windows,
    read_cached_field,
    read_fields,
    shape_of,
)

if TYPE_CHECKING:
    from datcom_io.decks.deck import Deck


@dataclass(frozen=True, eq=False)
class PrintedTable:
    """One printed table; its numbers are read from the rows when they are first used.

    Attributes
    ----------
    layout : TableLayout
        Its kind.
    columns : tuple of PrintedColumn
        Printed columns; in a two-way table the value column is repeated under every heading value.
    lines : tuple of int
        Line number of each row.
    rows : tuple of str
        The rows as printed.
    across : array (heading value,) or None
        Heading values of a two-way table. [as printed]
    across_line : int
        Line number of the heading values, 0 without.
    across_row : str
        That line as printed.
    given : tuple of array, or None
        ``values`` and ``flags`` where they are not just the cells of the rows.
    suspect : array (row, column) of bool, or None
        Cells whose numbers a fault of the program makes wrong; their flag is ``suspect``.
    """

    layout: TableLayout
    columns: tuple[PrintedColumn, ...]
    lines: tuple[int, ...]
    rows: tuple[str, ...]
    across: np.ndarray | None = None
    across_line: int = 0
    across_row: str = ""
    given: tuple[np.ndarray, np.ndarray] | None = None
    suspect: np.ndarray | None = None

    @property
    def name(self) -> str:
        """Kind of the table, for example ``static``."""
        return self.layout.name

    @cached_property
    def cells(self) -> tuple[np.ndarray, np.ndarray]:
        """`values` and `flags`."""
        # Only numbers become suspect: a missing cell keeps the code of its word.
        values, flags = self.given or read_fields(self.rows, self.columns)
        if self.suspect is not None:
            flags = np.where(self.suspect & (flags == OK), SUSPECT, flags).astype(np.uint8)
        return values, flags

    @property
    def values(self) -> np.ndarray:
        """Printed numbers (row, column), NaN where no number is printed. [as printed]"""
        return self.cells[0]

    @property
    def flags(self) -> np.ndarray:
        """Codes of `datcom_io.FLAGS` (row, column), uint8."""
        return self.cells[1]

    def first_rows(self, count: int | None) -> PrintedTable:
        """Return the table with at most `count` rows; None keeps all rows."""
        if count is None or len(self.rows) <= count:
            return self
        cells, suspect = self.given, self.suspect
        if cells is not None:
            cells = (cells[0][:count], cells[1][:count])
        if suspect is not None:
            suspect = suspect[:count]
        return replace(
            self, lines=self.lines[:count], rows=self.rows[:count], given=cells, suspect=suspect
        )

    def number(self, row: int, column: int) -> float:
        """Return one printed number, NaN where no number is printed; no other cell is read. [as
        printed]
        """
        if self.given is not None:
            return float(self.given[0][row, column])
        window = self.columns[column]
        return read_cached_field(self.rows[row][window.first - 1 : window.last])[0]

    def text(self, row: int, column: int) -> str:
        """Return the text of a cell as printed, without the blanks around it."""
        window = self.columns[column]
        return self.rows[row][window.first - 1 : window.last].strip()


@dataclass(frozen=True, eq=False)
class PrintedValues:
    """Numbers printed as ``label = value``, or alone in a line of words.

    The numbers keep the order of the print and are read when they are first used.

    Attributes
    ----------
    name : str
        Kind of the group, for example ``fairing``.
    labels : tuple of str
        Label of each value as printed; the words of the heading above make it unique where needed.
    lines : tuple of int
        Line number of each value.
    texts : tuple of str
        Each value as printed.
    units : tuple of str
        Unit of each value as printed, empty where none is.
    axes : dict of str to array (value,)
        Axis values by quantity where a line prints them, for example ``mach``.
    given : tuple of array, or None
        ``values`` and ``flags`` where they are not just those of the texts.
    """

    name: str
    labels: tuple[str, ...]
    lines: tuple[int, ...]
    texts: tuple[str, ...]
    units: tuple[str, ...] = ()
    axes: dict[str, np.ndarray] = field(default_factory=dict)
    given: tuple[np.ndarray, np.ndarray] | None = None

    @cached_property
    def cells(self) -> tuple[np.ndarray, np.ndarray]:
        """`values` and `flags`."""
        return self.given or read_cells(self.texts)

    @property
    def values(self) -> np.ndarray:
        """Printed numbers (value,), NaN where no number is printed. [as printed]"""
        return self.cells[0]

    @property
    def flags(self) -> np.ndarray:
        """Codes of `datcom_io.FLAGS` (value,), uint8.

        A text that is not a code of a missing number is ``ok``.
        """
        return self.cells[1]

    def value(self, label: str) -> float:
        """Return the first value of a label, NaN when the label does not occur. [as printed]"""
        if label not in self.labels:
            return float("nan")
        return float(self.values[self.labels.index(label)])


Printed = PrintedTable | PrintedValues


class TableLayout(NamedTuple):
    """One kind of table with one row per line.

    ``heading`` holds the words of the line that opens the table, with single blanks and without
    dashes; it is empty for a table that a `PrintedBlock` finds.  The first ``keys`` columns are the
    axes of a row.  ``rows`` names the namelist variable that states the number of rows, None where
    the print decides.  ``stops`` are the words of a note that lets the table end earlier.
    ``stream`` names the variables whose product is the number of values of a table printed as one
    stream of numbers.  ``axes`` returns axis values (row, column) by quantity where they are not
    printed.
    """

    name: str
    heading: str
    columns: tuple[PrintedColumn, ...]
    keys: int
    rows: tuple[str, str] | None = None
    across: HeadingAxis | None = None
    axes: Callable[[Deck, PrintedTable], Mapping[str, np.ndarray]] | None = None
    stops: str = ""
    stream: tuple[tuple[str, str], ...] = ()


class PrintedBlock(NamedTuple):
    """Lines of a page that are not one heading with one row per line below it.

    ``opens`` is searched in the line that opens the block, as `normalise_heading` returns it, on
    pages of the kinds ``pages``.  ``read(lines, opening)`` gets the lines of the page and the index
    of the opening line.  It returns the tables and groups, and the index of the line after them; it
    returns None when the lines have another form.  ``names`` are the kinds of table it may return.
    """

    names: tuple[str, ...]
    pages: tuple[str, ...]
    opens: re.Pattern[str]
    read: Callable[[list[Line], int], tuple[list[Printed], int] | None]


_DASHES = re.compile("-{2,}")
_LONGEST_LINE = 160  # of the program; longer ones are not worth remembering


def normalise_heading(line: str) -> str:
    """Return a heading line as `TableLayout.heading` holds it."""
    if len(line) <= _LONGEST_LINE:
        return _cached_heading_words(line)
    return _heading_words(line)


def _heading_words(line: str) -> str:
    return " ".join(_DASHES.sub(" ", line[1:]).split())


_cached_heading_words = lru_cache(4096)(_heading_words)


def next_text_line(lines: Sequence[Line], start: int) -> int:
    """Return the index of the first line from `start` on that has a text.

    The length of `lines` is returned when no such line follows.
    """
    while start < len(lines) and not lines[start][1][1:].strip():
        start += 1
    return start


def make_table(
    layout: TableLayout,
    rows: Sequence[tuple[int, str, Cells]],
    columns: tuple[PrintedColumn, ...] = (),
    across: np.ndarray | None = None,
    across_line: int = 0,
    across_row: str = "",
) -> PrintedTable:
    """Return a table of rows given as line number, text, cells.

    `columns` are those of the layout unless they are given.
    """
    # Rows that are already cut need no second reading.
    values = [cells[0] for _, _, cells in rows]
    flags = [cells[1] for _, _, cells in rows]
    return PrintedTable(
        layout=layout,
        columns=columns or layout.columns,
        lines=tuple(number for number, _, _ in rows),
        rows=tuple(text for _, text, _ in rows),
        across=across,
        across_line=across_line,
        across_row=across_row,
        given=(np.array(values), np.array(flags, dtype=np.uint8)),
    )


def make_values(
    name: str,
    items: Iterable[tuple[int, str, str, str]],
    axes: dict[str, np.ndarray] | None = None,
    given: tuple[np.ndarray, np.ndarray] | None = None,
) -> PrintedValues:
    """Return a group of values given as line number, label, text, unit.

    `given` holds values and flags that differ from those of the texts.
    """
    lines, labels, texts, units = (), (), (), ()
    items = list(items)
    if items:
        lines, labels, texts, units = zip(*items)
    return PrintedValues(
        name=name,
        labels=labels,
        lines=lines,
        texts=tuple(map(str.strip, texts)),
        units=units,
        axes=axes or {},
        given=given,
    )


def split_label_values(text: str) -> list[tuple[str, str]]:
    """Return label and value of every ``label = value`` of a line.

    A label may hold blanks and signs of equality.

    Examples
    --------
    >>> split_label_values("   CLB/CL = 0.1616E-02     (CLB/CL)M=1.4 = 0.1000E-29")
    [('CLB/CL', '0.1616E-02'), ('(CLB/CL)M=1.4', '0.1000E-29')]
    """
    pairs = []
    # Each part holds a value and the label of the next value.
    label, *parts = text.split("=")
    for number, part in enumerate(parts, 1):
        value, _, behind = part.strip().partition(" ")
        # Without a label before the next sign of equality, this sign belongs to the label.
        if number < len(parts) and not behind:
            label += f"={part}"
            continue
        pairs.append((label.strip(), value))
        label = behind
    return pairs


class _Heading(NamedTuple):
    """Columns of a two-way table, its heading values, and the line that prints them."""

    columns: tuple[PrintedColumn, ...]
    values: np.ndarray | None = None
    line: int = 0
    row: str = ""


def read_printed_table(
    layout: TableLayout, lines: list[Line], start: int
) -> tuple[PrintedTable | None, int]:
    """Return the table whose heading stands before index `start`, and the index after it.

    The table is None when no row follows.
    """
    first_row = start
    heading = _Heading(layout.columns)
    if layout.across:
        heading_line = next_text_line(lines, start)
        across = _read_across(layout, lines, heading_line)
        if across is None:
            return None, start
        heading = across
        first_row = heading_line + 1
    numbers, rows, after = _read_rows(layout, heading.columns, lines, first_row)
    if not rows:
        return None, after
    table = PrintedTable(
        layout=layout,
        columns=heading.columns,
        lines=tuple(numbers),
        rows=tuple(rows),
        across=heading.values,
        across_line=heading.line,
        across_row=heading.row,
    )
    return table, after


def _read_rows(
    layout: TableLayout, columns: tuple[PrintedColumn, ...], lines: list[Line], start: int
) -> tuple[list[int], list[str], int]:
    """Return line numbers and texts of the rows of a table, and the index after the last one."""
    windows = cached_column_windows(columns, layout.keys)
    known_shape, judge = windows.shapes.get, windows.judge
    numbers: list[int] = []
    rows: list[str] = []
    after = start
    for index in range(start, len(lines)):
        number, text = lines[index]
        # Blank lines stand inside tables, and a line ALPHA may stand above the first row.
        if len(text) < 2 or (not rows and text[1:].strip() == "ALPHA"):
            continue
        if text[0] != " ":
            break
        shape = shape_of(text)
        fits = known_shape(shape)
        if fits is None:
            fits = judge(text, shape)
        if not fits:
            break
        numbers.append(number)
        rows.append(text)
        after = index + 1
    return numbers, rows, after


def _read_across(layout: TableLayout, lines: list[Line], index: int) -> _Heading | None:
    """Return the heading values of a line, None when it has another form."""
    across = layout.across
    assert across is not None
    if index == len(lines):
        return None
    number, text = lines[index]
    equals = text.find("=")
    if not text[1:].lstrip().startswith(across.name) or not 0 <= equals < across.first:
        return None
    values: list[float] = []
    for k in range((len(text.rstrip()) - across.first) // across.step + 1):
        shift = k * across.step
        # The first value may touch the sign of equality.
        start = max(across.first - 1 + shift, equals + 1)
        cell = read_cell(text[start : across.last + shift])
        if cell is None or cell[1] != OK:
            return None
        values.append(cell[0])
    if not values:
        return None
    return _Heading(two_way_columns(layout, len(values)), np.array(values), number, text)


@lru_cache(256)
def two_way_columns(layout: TableLayout, count: int) -> tuple[PrintedColumn, ...]:
    """Return the columns of a two-way table with `count` heading values."""
    assert layout.across is not None
    return (*layout.columns, *value_columns(layout.across, count))


def value_columns(across: HeadingAxis, count: int) -> list[PrintedColumn]:
    """Return the value columns under `count` heading values."""
    # Every heading value has one column, at equal distances.
    columns = []
    for k in range(count):
        shift = k * across.step
        cell = across.cell
        columns.append(cell._replace(first=cell.first + shift, last=cell.last + shift))
    return columns
