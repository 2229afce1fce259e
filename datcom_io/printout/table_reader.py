"""Reading the lines of a page into tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ..cells import OK, read_cell
from .rows import Cells, shape_of, windows
from .tables import Table, Values

if TYPE_CHECKING:
    from .columns import Column, Line
    from .tables import Layout


def make_table(
    layout: Layout,
    rows: Sequence[tuple[int, str, Cells]],
    columns: tuple[Column, ...] = (),
    across: np.ndarray | None = None,
    across_line: int = 0,
    across_row: str = "",
) -> Table:
    """Return a table of rows given as line number, text, cells; `columns` are those of the layout unless given."""
    return Table(
        layout,
        columns or layout.columns,
        tuple(number for number, _, _ in rows),
        tuple(text for _, text, _ in rows),
        across,
        across_line,
        across_row,
        (np.array([values for _, _, (values, _) in rows]), np.array([flags for _, _, (_, flags) in rows], dtype=np.uint8)),
    )


def make_values(
    name: str,
    items: Iterable[tuple[int, str, str, str]],
    axes: dict[str, np.ndarray] | None = None,
    given: tuple[np.ndarray, np.ndarray] | None = None,
) -> Values:
    """Return a group of values given as line number, label, text, unit; `given` are values and flags that the texts do not give."""
    lines, labels, texts, units = zip(*items) if (items := list(items)) else ((), (), (), ())
    return Values(name, labels, lines, tuple(map(str.strip, texts)), units, axes or {}, given)


def pairs(text: str) -> list[tuple[str, str]]:
    """Return label and value of every ``label = value`` of a line; a label may hold blanks and signs of equality.

    Examples
    --------
    >>> pairs("   CLB/CL = 0.1616E-02     (CLB/CL)M=1.4 = 0.1000E-29")
    [('CLB/CL', '0.1616E-02'), ('(CLB/CL)M=1.4', '0.1000E-29')]
    """
    found = []
    label, *parts = text.split("=")
    for left, part in enumerate(parts, 1 - len(parts)):
        value, _, rest = part.strip().partition(" ")
        if left and not rest:  # no label before the next sign of equality: this one stands in a label
            label += f"={part}"
            continue
        found.append((label.strip(), value))
        label = rest
    return found


def read_table(layout: Layout, lines: list[Line], at: int) -> tuple[Table | None, int]:
    """Return the table whose heading stands before index `at`, and the index after it; None when no row follows."""
    columns, across, across_line, across_row = layout.columns, None, 0, ""
    if layout.across:
        found = _read_across(layout, lines, at)
        if found is None:
            return None, at
        columns, across, across_line, across_row, at = found
    kind = windows(columns, layout.keys)
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
    return Table(layout, columns, tuple(numbers), tuple(rows), across, across_line, across_row), after


def _read_across(layout: Layout, lines: list[Line], at: int) -> tuple[tuple[Column, ...], np.ndarray, int, str, int] | None:
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
    return (two_way_columns(layout, len(values)), np.array(values), number, text, at + 1) if values else None


@lru_cache(256)
def two_way_columns(layout: Layout, count: int) -> tuple[Column, ...]:
    """Return the columns of a two-way table with `count` heading values."""
    across = layout.across
    assert across is not None
    cell, shifts = across.cell, [k * across.step for k in range(count)]
    return (*layout.columns, *(cell._replace(first=cell.first + shift, last=cell.last + shift) for shift in shifts))
