"""Cutting a printed row into cells by columns: cells may touch, be blank or hold words, so blanks
separate nothing.

Whether a line cuts into the columns does not depend on which digits it holds.  So rows of the same
shape, every digit written as 0, are judged once; the numbers themselves are read when they are
requested.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from datcom_io.cells import BLANK, NDM, OK, read_cell


class PrintedColumn(NamedTuple):
    """One printed column.

    ``units`` is that of the print: ``deg``, ``1``, ``1/deg``, or ``1/angle`` where card DERIV
    decides between degree and radian.  ``quantity`` is the variable's name in the DataTree.
    ``constant`` flags a column whose first row may hold for all rows. ``words`` flags a column of
    texts: every cell is ``ok`` with a text and no number.
    """

    name: str
    first: int
    last: int
    quantity: str = ""
    units: str = "1"
    constant: bool = False
    words: bool = False


class Across(NamedTuple):
    """The second axis of a two-way table: its values stand in a heading line, one value column
    under each.

    ``first`` and ``last`` bound the first heading value, ``cell`` the first value column; both
    repeat every ``step`` columns.
    """

    name: str
    quantity: str
    first: int
    last: int
    cell: PrintedColumn
    step: int


Line = tuple[int, str]


Cells = tuple[list[float], list[int]]
_SHAPE = bytes.maketrans(b"123456789", b"000000000")
_MOST_SHAPES = 4096
_PLAIN = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)|\D*")  # also a word


@lru_cache(1 << 16)
def read_again(part: str) -> tuple[float, int]:
    """Return value and flag of a field of a row that cuts into its columns; the same texts come
    again and again.
    """
    cell = read_cell(part)
    assert cell is not None
    return cell


class Cut(NamedTuple):
    """Where to cut a row: ends of a window, ends of the gap before it, whether it touches the
    window before, whether it holds words.
    """

    start: int
    stop: int
    gap: slice | None
    touches: bool
    words: bool


def column_windows(columns: Sequence[PrintedColumn]) -> list[Cut]:
    """Return the windows of a table in order; the gap before the first one starts behind the
    control column.
    """
    found: list[Cut] = []
    edge = 1
    for column in columns:
        gap = slice(edge, column.first - 1) if column.first - 1 > edge else None
        found.append(
            Cut(column.first - 1, column.last, gap, bool(found) and gap is None, column.words)
        )
        edge = column.last
    return found


def read_row(text: str, windows: list[Cut], keys: int) -> Cells | None:
    """Return values and flags of a row, or None when the line does not cut into the columns.

    It cuts when every window holds a cell, no text straddles two windows or stands outside of them,
    and the keys are numbers.  A single key may be NDM: the program prints an angle of attack so
    that NALPHA counts and the cards do not give.
    """
    if "_" in text or not text.isascii():  # float() would take 1_0, and digits of other scripts
        return None
    values, flags = [], []
    for start, stop, gap, touches, words in windows:
        if (gap and text[gap].strip()) or (touches and _straddles(text, start, stop)):
            return None
        cell = read_field(text[start:stop], words)
        if cell is None:
            return None
        values.append(cell[0])
        flags.append(cell[1])
    if (any(flags[:keys]) and (keys > 1 or flags[0] != NDM)) or text[windows[-1].stop :].strip():
        return None
    return values, flags


def _straddles(text: str, start: int, stop: int) -> bool:
    """Return whether text goes on over the left edge of a window; a signed number with a point may
    touch the one before it.
    """
    if text[start - 1 : start] <= " " or text[start : start + 1] <= " ":
        return False
    return text[start] not in "+-" or "." not in text[start:stop]


def read_field(part: str, words: bool = False) -> tuple[float, int] | None:
    """Return value and flag of a window; in a column of words every text is ``ok`` and has no
    number.
    """
    if not part or part.isspace():
        return math.nan, BLANK
    return (math.nan, OK) if words else read_cell(part)


def read_fields(
    rows: Sequence[str], columns: Sequence[PrintedColumn]
) -> tuple[np.ndarray, np.ndarray]:
    """Return values and flags (row, column) of rows that cut into the columns."""
    values, flags = (
        np.empty((len(rows), len(columns))),
        np.empty((len(rows), len(columns)), np.uint8),
    )
    for k, column in enumerate(columns):
        part = slice(column.first - 1, column.last)
        cells = [
            read_field(row[part], True) if column.words else read_again(row[part]) for row in rows
        ]
        values[:, k], flags[:, k] = zip(*cells)
    return values, flags


def shape_of(text: str) -> bytes:
    """Return a line with every digit written as 0."""
    return text.encode("latin-1", "replace").translate(_SHAPE)


class ColumnWindows:
    """The windows of a table, and the shapes of rows that are known to cut into them or not."""

    def __init__(self, columns: tuple[PrintedColumn, ...], keys: int):
        self.columns = columns
        self.cuts, self.keys = column_windows(columns), keys
        self.shapes: dict[bytes, bool] = {}

    def hold(self, text: str) -> bool:
        """Return whether a line cuts into the columns."""
        shape = shape_of(text)
        known = self.shapes.get(shape)
        return self.judge(text, shape) if known is None else known

    def judge(self, text: str, shape: bytes) -> bool:
        """Return the same of a line whose shape is not known yet, and remember it."""
        found = read_row(text, self.cuts, self.keys) is not None
        if b"#" in shape or not all(
            _PLAIN.fullmatch(text[cut.start : cut.stop].strip()) for cut in self.cuts[: self.keys]
        ):
            return found  # it may depend on digits: 1.#QNAN, a key of 1E-30
        if len(self.shapes) == _MOST_SHAPES:
            self.shapes.clear()
        self.shapes[shape] = found
        return found


_KINDS: dict[tuple[int, int], ColumnWindows] = {}
_MOST_KINDS = 1024


def cached_column_windows(columns: tuple[PrintedColumn, ...], keys: int) -> ColumnWindows:
    """Return the windows of a kind of table, the same ones for all its tables."""
    key = (id(columns), keys)  # the windows keep the columns, so no others get their id
    if key not in _KINDS:
        if len(_KINDS) == _MOST_KINDS:
            _KINDS.clear()
        _KINDS[key] = ColumnWindows(columns, keys)
    return _KINDS[key]
