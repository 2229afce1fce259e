"""Cutting of printed rows into cells by their columns.

Cells of a row may touch, be blank or hold words, so blanks do not separate them.  Whether a line
cuts into the columns of a table does not depend on its digits.  The reader therefore judges lines
of the same shape once, a shape being the line with every digit written as 0.  The numbers are read
later, when they are used.
"""

from __future__ import annotations

import math
import re
import threading
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from datcom_io.cells import BLANK, NDM, read_cell


class PrintedColumn(NamedTuple):
    """One printed column: its window in the line and the quantity it holds.

    ``first`` and ``last`` count columns of the line from 1, the carriage-control column included.
    ``units`` is the printed unit: ``deg``, ``1``, ``1/deg``, or ``1/angle`` where card DERIV
    decides between degree and radian.  ``quantity`` is the name of the variable in the DataTree.
    ``constant`` flags a column whose first row may hold for all rows.  ``meaning`` is the long name
    of the variable in the DataTree; it is empty where the vocabulary has one.
    """

    name: str
    first: int
    last: int
    quantity: str = ""
    units: str = "1"
    constant: bool = False
    meaning: str = ""


class HeadingAxis(NamedTuple):
    """The second axis of a two-way table, whose values stand in a heading line.

    ``first`` and ``last`` bound the first heading value, ``cell`` is the first value column.  Both
    repeat every ``step`` columns.  ``counted`` is the namelist and the variable of the cards that
    count the values.
    """

    name: str
    quantity: str
    first: int
    last: int
    cell: PrintedColumn
    step: int
    counted: tuple[str, str] = ("SYMFLP", "NDELTA")


Line = tuple[int, str]
"""Line number and text."""

Cells = tuple[list[float], list[int]]
"""Values and flags of one row."""

_SHAPE = bytes.maketrans(b"123456789", b"000000000")
_MOST_SHAPES = 4096
# A key that is a plain number without exponent, or a word: the digits cannot change its flag.
_PLAIN = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)|\D*")


@lru_cache(1 << 16)
def read_cached_field(part: str) -> tuple[float, int]:
    """Return value and flag of a field of a row that cuts into its columns.

    A listing repeats the same texts many times, so the result is cached.
    """
    cell = read_cell(part)
    assert cell is not None
    return cell


class Cut(NamedTuple):
    """One window of a row.

    ``start`` and ``stop`` bound the window, ``gap`` is the blank part before it, ``touches`` states
    that it follows the window before without a gap.
    """

    start: int
    stop: int
    gap: slice | None
    touches: bool


def column_windows(columns: Sequence[PrintedColumn]) -> list[Cut]:
    """Return the windows of a table in order.

    The gap before the first window starts behind the carriage-control column.
    """
    windows: list[Cut] = []
    edge = 1
    for column in columns:
        start = column.first - 1
        gap = None
        if start > edge:
            gap = slice(edge, start)
        touches = bool(windows) and gap is None
        windows.append(Cut(start, column.last, gap, touches))
        edge = column.last
    return windows


def read_row(text: str, windows: list[Cut], keys: int) -> Cells | None:
    """Return values and flags of a row, or None when the line does not cut into the columns.

    A line cuts into the columns when every window holds a cell, no text straddles two windows or
    stands outside of them, and the keys are numbers.  A single key may be NDM: the program prints
    NDM for an angle of attack that NALPHA counts and the cards do not give.
    """
    # float() accepts 1_0 and digits of other scripts; the program prints neither.
    if "_" in text or not text.isascii():
        return None
    values, flags = [], []
    for start, stop, gap, touches in windows:
        if gap and text[gap].strip():
            return None
        if touches and _straddles(text, start, stop):
            return None
        cell = read_field(text[start:stop])
        if cell is None:
            return None
        values.append(cell[0])
        flags.append(cell[1])
    is_missing_key = any(flags[:keys])
    if is_missing_key and (keys > 1 or flags[0] != NDM):
        return None
    if text[windows[-1].stop :].strip():
        return None
    return values, flags


def _straddles(text: str, start: int, stop: int) -> bool:
    """Return whether one text covers the left edge of a window.

    A signed number with a point may touch the number before it: ``0.00E+00-2.40E-02``.
    """
    if text[start - 1 : start] <= " " or text[start : start + 1] <= " ":
        return False
    return text[start] not in "+-" or "." not in text[start:stop]


def read_field(part: str) -> tuple[float, int] | None:
    """Return value and flag of a window, None when it holds no cell."""
    # Blank windows are frequent, so they are found before a number is tried.
    if not part or part.isspace():
        return math.nan, BLANK
    return read_cell(part)


def read_fields(
    rows: Sequence[str], columns: Sequence[PrintedColumn]
) -> tuple[np.ndarray, np.ndarray]:
    """Return values and flags (row, column) of rows that cut into the columns."""
    values = np.empty((len(rows), len(columns)))
    flags = np.empty((len(rows), len(columns)), np.uint8)
    for k, column in enumerate(columns):
        part = slice(column.first - 1, column.last)
        cells = [read_cached_field(row[part]) for row in rows]
        values[:, k], flags[:, k] = zip(*cells)
    return values, flags


def shape_of(text: str) -> bytes:
    """Return a line with every digit written as 0."""
    return text.encode("latin-1", "replace").translate(_SHAPE)


class ColumnWindows:
    """The windows of a table, with the shapes of lines already judged."""

    def __init__(self, columns: tuple[PrintedColumn, ...], keys: int):
        self.columns = columns
        self.cuts = column_windows(columns)
        self.keys = keys
        self.shapes: dict[bytes, bool] = {}

    def hold(self, text: str) -> bool:
        """Return whether a line cuts into the columns."""
        shape = shape_of(text)
        fits = self.shapes.get(shape)
        if fits is None:
            return self.judge(text, shape)
        return fits

    def judge(self, text: str, shape: bytes) -> bool:
        """Return whether a line of a new shape cuts into the columns, and remember its shape."""
        fits = read_row(text, self.cuts, self.keys) is not None
        keys = [text[cut.start : cut.stop].strip() for cut in self.cuts[: self.keys]]
        # Do not remember a shape whose digits decide: 1.#QNAN, or a key of 1E-30.
        if b"#" in shape or not all(map(_PLAIN.fullmatch, keys)):
            return fits
        if len(self.shapes) == _MOST_SHAPES:
            self.shapes.clear()
        self.shapes[shape] = fits
        return fits


_WINDOWS_BY_COLUMNS: dict[tuple[int, int], ColumnWindows] = {}
_MOST_KINDS = 1024
# Threads read listings at the same time; one of them may clear the dict.
_LOCK = threading.Lock()


def cached_column_windows(columns: tuple[PrintedColumn, ...], keys: int) -> ColumnWindows:
    """Return the windows of a kind of table, the same object for all its tables."""
    # The windows keep a reference to the columns, so the identity of the columns stays unique.
    key = (id(columns), keys)
    with _LOCK:
        windows = _WINDOWS_BY_COLUMNS.get(key)
        if windows is None:
            if len(_WINDOWS_BY_COLUMNS) == _MOST_KINDS:
                _WINDOWS_BY_COLUMNS.clear()
            windows = _WINDOWS_BY_COLUMNS[key] = ColumnWindows(columns, keys)
    return windows
