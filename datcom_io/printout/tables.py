"""Printed tables, and groups of ``label = value``: what they hold and how their lines are read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..cells import OK, SUSPECT, read_cells
from .columns import Across, Column
from .rows import read_again, read_fields

if TYPE_CHECKING:
    from ..decks.deck import Deck
    from .columns import Column


@dataclass(frozen=True, eq=False)
class Table:
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

    layout: Layout
    columns: tuple[Column, ...]
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

    def first_rows(self, count: int | None) -> Table:
        """Return the table with so many rows at the most, all with None."""
        if count is None or len(self.rows) <= count:
            return self
        given = None if self.given is None else (self.given[0][:count], self.given[1][:count])
        suspect = None if self.suspect is None else self.suspect[:count]
        return replace(self, lines=self.lines[:count], rows=self.rows[:count], given=given, suspect=suspect)

    def number(self, row: int, column: int) -> float:
        """Return one printed number, NaN where there is none; the others need not be read for it. [as printed]"""
        if self.given is not None:
            return float(self.given[0][row, column])
        place = self.columns[column]
        return read_again(self.rows[row][place.first - 1 : place.last])[0] if not place.words else float("nan")

    def text(self, row: int, column: int) -> str:
        """Return a cell's text as printed, without the blanks around it."""
        place = self.columns[column]
        return self.rows[row][place.first - 1 : place.last].strip()


@dataclass(frozen=True, eq=False)
class Values:
    """Numbers printed as ``label = value``, or alone in a line of words, in order; they are read when they are first used.

    Attributes
    ----------
    name : str
        Kind of the group, for example ``fairing``.
    labels : tuple of str
        Label of each value as printed, made unique by the words of the heading above it where it must be.
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
        """Codes of `datcom_io.FLAGS` (value,), uint8; a text that is no code of a missing number is ``ok``."""
        return self.cells[1]

    def value(self, label: str) -> float:
        """Return the first value of a label, NaN when it is not there. [as printed]"""
        return float(self.values[self.labels.index(label)]) if label in self.labels else float("nan")


Printed = Table | Values


class Layout(NamedTuple):
    """One kind of table with one row per line.

    ``heading`` holds the words of the line that opens it, with single blanks and without dashes; it is empty for a table that a
    `Block` finds.  The first ``keys`` columns are the row's axes.  ``rows`` names the namelist variable that states how many rows there
    must be, None where the print decides; ``stops`` are the words of a note that lets the table end earlier.  ``stream`` names the
    variables whose product is the number of values of a table printed as one stream of numbers, and ``axes`` returns axis values
    (row, column) by quantity where they are not printed.
    """

    name: str
    heading: str
    columns: tuple[Column, ...]
    keys: int
    rows: tuple[str, str] | None = None
    across: Across | None = None
    axes: Callable[[Deck, Table], Mapping[str, np.ndarray]] | None = None
    stops: str = ""
    stream: tuple[tuple[str, str], ...] = ()
