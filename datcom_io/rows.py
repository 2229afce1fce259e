"""Cutting a printed row into cells by columns: cells may touch, be blank or hold words, so blanks tell nothing."""

from __future__ import annotations

import math
from typing import NamedTuple

from .cells import BLANK, read_cell
from .layouts.form import Column

Cells = tuple[list[float], list[int]]


class Cut(NamedTuple):
    """Where to cut a row: ends of a window, ends of the gap before it, whether it touches the window before."""

    start: int
    stop: int
    gap: slice | None
    touches: bool


def cuts(columns: tuple[Column, ...]) -> list[Cut]:
    """Return the windows of a table in order; the gap before the first one starts behind the control column."""
    found: list[Cut] = []
    edge = 1
    for column in columns:
        gap = slice(edge, column.first - 1) if column.first - 1 > edge else None
        found.append(Cut(column.first - 1, column.last, gap, bool(found) and gap is None))
        edge = column.last
    return found


def read_row(text: str, windows: list[Cut], keys: int) -> Cells | None:
    """Return values and flags of a row, or None when the line does not cut into the columns.

    It cuts when every window holds a cell, no text straddles two windows or stands outside of them, and the keys are numbers.
    """
    if "_" in text:  # float() would take 1_0
        return None
    values, flags = [], []
    for start, stop, gap, touches in windows:
        if (gap and text[gap].strip()) or (touches and text[start - 1 : start] > " " and text[start : start + 1] > " "):
            return None
        part = text[start:stop]
        cell = (math.nan, BLANK) if not part or part.isspace() else read_cell(part)
        if cell is None:
            return None
        values.append(cell[0])
        flags.append(cell[1])
    if any(flags[:keys]) or text[windows[-1].stop :].strip():
        return None
    return values, flags
