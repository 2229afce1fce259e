"""Printed tables, and groups of ``label = value``: what they hold and how their lines are read."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from datcom_io.cells import OK, SUSPECT, read_cell, read_cells
from datcom_io.printout.rows import (
    Across,
    Cells,
    Line,
    PrintedColumn,
    cached_column_windows,
    read_again,
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
    layout : Layout
        Its kind.
    columns : tuple of Column
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
        values, flags = self.given or read_fields(self.rows, self.columns)
        if self.suspect is not None:
            flags = np.where(self.suspect & (flags == OK), SUSPECT, flags).astype(np.uint8)
        return values, flags

    @property
    def values(self) -> np.ndarray:
        """Printed numbers (row, column), NaN where there is none. [as printed]"""
        return self.cells[0]

    @property
    def flags(self) -> np.ndarray:
        """Codes of `datcom_io.FLAGS` (row, column), uint8."""
        return self.cells[1]

    def first_rows(self, count: int | None) -> PrintedTable:
        """Return the table with so many rows at the most, all with None."""
        if count is None or len(self.rows) <= count:
            return self
        given = None if self.given is None else (self.given[0][:count], self.given[1][:count])
        suspect = None if self.suspect is None else self.suspect[:count]
        return replace(
            self, lines=self.lines[:count], rows=self.rows[:count], given=given, suspect=suspect
        )

    def number(self, row: int, column: int) -> float:
        """Return one printed number, NaN where there is none; the others need not be read for it.
        [as printed]
        """
        if self.given is not None:
            return float(self.given[0][row, column])
        place = self.columns[column]
        return (
            read_again(self.rows[row][place.first - 1 : place.last])[0]
            if not place.words
            else float("nan")
        )

    def text(self, row: int, column: int) -> str:
        """Return a cell's text as printed, without the blanks around it."""
        place = self.columns[column]
        return self.rows[row][place.first - 1 : place.last].strip()


@dataclass(frozen=True, eq=False)
class Values:
    """Numbers printed as ``label = value``, or alone in a line of words, in order; they are read
    when they are first used.

    Attributes
    ----------
    name : str
        Kind of the group, for example ``fairing``.
    labels : tuple of str
        Label of each value as printed, made unique by the words of the heading above it where it
        must be.
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
        """Printed numbers (value,), NaN where there is none. [as printed]"""
        return self.cells[0]

    @property
    def flags(self) -> np.ndarray:
        """Codes of `datcom_io.FLAGS` (value,), uint8; a text that is no code of a missing number is
        ``ok``.
        """
        return self.cells[1]

    def value(self, label: str) -> float:
        """Return the first value of a label, NaN when it is not there. [as printed]"""
        return (
            float(self.values[self.labels.index(label)]) if label in self.labels else float("nan")
        )


Printed = PrintedTable | Values


class TableLayout(NamedTuple):
    """One kind of table with one row per line.

    ``heading`` holds the words of the line that opens it, with single blanks and without dashes; it
    is empty for a table that a `PrintedBlock` finds.  The first ``keys`` columns are the row's axes.
    ``rows`` names the namelist variable that states how many rows there must be, None where the
    print decides; ``stops`` are the words of a note that lets the table end earlier.  ``stream``
    names the variables whose product is the number of values of a table printed as one stream of
    numbers, and ``axes`` returns axis values (row, column) by quantity where they are not printed.
    """

    name: str
    heading: str
    columns: tuple[PrintedColumn, ...]
    keys: int
    rows: tuple[str, str] | None = None
    across: Across | None = None
    axes: Callable[[Deck, PrintedTable], Mapping[str, np.ndarray]] | None = None
    stops: str = ""
    stream: tuple[tuple[str, str], ...] = ()


class PrintedBlock(NamedTuple):
    """Lines of a page that no heading with one row per line below it describes.

    ``opens`` is searched in the line that opens the block, as `normalise_heading` gives it, on pages of
    the kinds ``pages``. ``read(lines, at)`` gets the lines of the page and the index of the opening
    line; it returns what it found and the index of the line after it, or None when the lines are
    not what they seemed.  ``names`` are the kinds of table it may return.
    """

    names: tuple[str, ...]
    pages: tuple[str, ...]
    opens: re.Pattern[str]
    read: Callable[[list[Line], int], tuple[list[Printed], int] | None]


_DASHES = re.compile("-{2,}")
_LONGEST_LINE = 160  # of the program; longer ones are not worth remembering


def normalise_heading(line: str) -> str:
    """Return a heading line as `TableLayout.heading` holds it."""
    return _known_words(line) if len(line) <= _LONGEST_LINE else _words(line)


def _words(line: str) -> str:
    return " ".join(_DASHES.sub(" ", line[1:]).split())


_known_words = lru_cache(4096)(_words)


def make_table(
    layout: TableLayout,
    rows: Sequence[tuple[int, str, Cells]],
    columns: tuple[PrintedColumn, ...] = (),
    across: np.ndarray | None = None,
    across_line: int = 0,
    across_row: str = "",
) -> PrintedTable:
    """Return a table of rows given as line number, text, cells; `columns` are those of the layout
    unless given.
    """
    return PrintedTable(
        layout,
        columns or layout.columns,
        tuple(number for number, _, _ in rows),
        tuple(text for _, text, _ in rows),
        across,
        across_line,
        across_row,
        (
            np.array([values for _, _, (values, _) in rows]),
            np.array([flags for _, _, (_, flags) in rows], dtype=np.uint8),
        ),
    )


def make_values(
    name: str,
    items: Iterable[tuple[int, str, str, str]],
    axes: dict[str, np.ndarray] | None = None,
    given: tuple[np.ndarray, np.ndarray] | None = None,
) -> Values:
    """Return a group of values given as line number, label, text, unit; `given` are values and
    flags that the texts do not give.
    """
    lines, labels, texts, units = zip(*items) if (items := list(items)) else ((), (), (), ())
    return Values(name, labels, lines, tuple(map(str.strip, texts)), units, axes or {}, given)


def split_label_values(text: str) -> list[tuple[str, str]]:
    """Return label and value of every ``label = value`` of a line; a label may hold blanks and
    signs of equality.

    Examples
    --------
    >>> pairs("   CLB/CL = 0.1616E-02     (CLB/CL)M=1.4 = 0.1000E-29")
    [('CLB/CL', '0.1616E-02'), ('(CLB/CL)M=1.4', '0.1000E-29')]
    """
    found = []
    label, *parts = text.split("=")
    for left, part in enumerate(parts, 1 - len(parts)):
        value, _, rest = part.strip().partition(" ")
        if (
            left and not rest
        ):  # no label before the next sign of equality: this one stands in a label
            label += f"={part}"
            continue
        found.append((label.strip(), value))
        label = rest
    return found


def read_printed_table(
    layout: TableLayout, lines: list[Line], at: int
) -> tuple[PrintedTable | None, int]:
    """Return the table whose heading stands before index `at`, and the index after it; None when no
    row follows.
    """
    columns, across, across_line, across_row = layout.columns, None, 0, ""
    if layout.across:
        found = _read_across(layout, lines, at)
        if found is None:
            return None, at
        columns, across, across_line, across_row, at = found
    kind = cached_column_windows(columns, layout.keys)
    known, judge = kind.shapes.get, kind.judge
    numbers: list[int] = []
    rows: list[str] = []
    after = at
    while at < len(lines):
        number, text = lines[at]
        at += 1
        if len(text) < 2 or (not rows and text[1:].strip() == "ALPHA"):
            continue
        if text[0] != " ":
            break
        shape = shape_of(text)
        holds = known(shape)
        if holds is None:
            holds = judge(text, shape)
        if not holds:
            break
        numbers.append(number)
        rows.append(text)
        after = at
    if not rows:
        return None, after
    return PrintedTable(
        layout, columns, tuple(numbers), tuple(rows), across, across_line, across_row
    ), after


def _read_across(
    layout: TableLayout, lines: list[Line], at: int
) -> tuple[tuple[PrintedColumn, ...], np.ndarray, int, str, int] | None:
    """Return columns, heading values, their line and text, and the index of the line after them."""
    across = layout.across
    assert across is not None
    while at < len(lines) and not lines[at][1][1:].strip():
        at += 1
    if at == len(lines):
        return None
    number, text = lines[at]
    start = text.find("=")
    if not text[1:].lstrip().startswith(across.name) or not 0 <= start < across.first:
        return None
    values: list[float] = []
    for k in range((len(text.rstrip()) - across.first) // across.step + 1):
        shift = k * across.step
        cell = read_cell(text[max(across.first - 1 + shift, start + 1) : across.last + shift])
        if cell is None or cell[1] != OK:
            return None
        values.append(cell[0])
    return (
        (two_way_columns(layout, len(values)), np.array(values), number, text, at + 1)
        if values
        else None
    )


@lru_cache(256)
def two_way_columns(layout: TableLayout, count: int) -> tuple[PrintedColumn, ...]:
    """Return the columns of a two-way table with `count` heading values."""
    across = layout.across
    assert across is not None
    cell, shifts = across.cell, [k * across.step for k in range(count)]
    return (
        *layout.columns,
        *(cell._replace(first=cell.first + shift, last=cell.last + shift) for shift in shifts),
    )
