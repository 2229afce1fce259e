"""Layout of a table in a terminal: widths of columns, cells broken between words, aligned lines."""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence
from itertools import zip_longest

import click

_GAP = "  "
# least width of a column that is broken to fit the terminal [columns]
_NARROW = 8


def table_lines(
    rows: Sequence[Sequence[str]], is_right: Sequence[bool], width: int | None
) -> list[str]:
    """Return the lines of a table whose first row is its head, broken at `width`.

    Notes
    -----
    The first column, which names the row, is not broken. A table with many columns can be wider.
    """
    widths = [max(map(_cell_width, column)) for column in zip(*rows, strict=True)]
    if width is not None:
        widths = _narrow_columns(widths, width - len(_GAP) * (len(widths) - 1))
    head, *body = [list(map(_break_cell, row, widths)) for row in rows]
    # texts of the head stand on its last line
    height = max(map(len, head), default=1)
    head = [[""] * (height - len(lines)) + lines for lines in head]
    heading = [_aligned_line(line, widths, is_right) for line in zip(*head)]
    if width is not None:
        heading = [click.style(line, bold=True) for line in heading]
    lines = []
    for row in body:
        for line in zip_longest(*row, fillvalue=""):
            lines.append(_aligned_line(line, widths, is_right))
    return [*heading, *lines]


def _narrow_columns(widths: Sequence[int], width: int) -> list[int]:
    """Return widths with the widest columns behind the first narrowed, until the sum is `width`."""
    narrowed = list(widths)
    for _ in range(sum(widths) - width):
        widest = max(narrowed[1:], default=0)
        if widest <= _NARROW:
            break
        narrowed[narrowed.index(widest, 1)] -= 1
    return narrowed


def _text_width(text: str) -> int:
    """Return the columns of a terminal that a line takes: two for each letter of East Asia."""
    if text.isascii():
        return len(text)
    widths = (2 if unicodedata.east_asian_width(letter) in "WF" else 1 for letter in text)
    # a combining mark stands above the letter before it
    return sum(widths) - sum(map(bool, map(unicodedata.combining, text)))


def _cell_width(text: str) -> int:
    return max(map(_text_width, text.split("\n")))


def _break_cell(text: str, width: int) -> list[str]:
    """Return the lines of a cell, broken between words where a line is wider than `width`."""
    lines = []
    for line in text.split("\n"):
        while _text_width(line) > width:
            end = 1
            while _text_width(line[: end + 1]) <= width:
                end += 1
            blank = line.rfind(" ", 1, end + 1)
            end = blank if blank > 0 else end
            lines.append(line[:end].rstrip())
            line = line[end:].lstrip()
        lines.append(line)
    return lines


def _aligned_line(line: Sequence[str], widths: Sequence[int], is_right: Sequence[bool]) -> str:
    """Return the cells of a line in columns of these widths, without spaces at the end."""
    cells = []
    for text, width, right in zip(line, widths, is_right):
        blank = " " * (width - _text_width(text.rstrip()))
        cells.append(blank + text.rstrip() if right else text.rstrip() + blank)
    return _GAP.join(cells).rstrip()
