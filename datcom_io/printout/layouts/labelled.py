"""Lines of ``label = value``: every number stands in its own columns behind its label, so they are
cut like the rows of a table.

A label may itself hold signs of equality, ``(CLB/CL)M=1.4``, and a number may touch the one before
it; only columns separate them.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from datcom_io.cells import read_cell
from datcom_io.printout.rows import Line, PrintedColumn
from datcom_io.printout.tables import Printed, PrintedBlock, make_values, normalise_heading

Item = tuple[int, str, str, str]
"""Line number, label, text, unit as printed: what `make_values` takes."""


class Labelled(NamedTuple):
    """One form of line: its words without the numbers, with single blanks, and the columns of the
    numbers, named by their labels.
    """

    words: str
    numbers: tuple[PrintedColumn, ...]


def read_line(form: Labelled, line: Line, subject: str = "") -> list[Item]:
    """Return the numbers of a line, none when it has another form; `subject` is put before the
    labels.
    """
    number, text = line
    if "_" in text or not text.isascii():  # float() would take 1_0, and digits of other scripts
        return []
    items, words, edge = [], "", 0
    for column in form.numbers:
        words += text[edge : column.first - 1] + " "
        edge = column.last
        part = text[column.first - 1 : edge]
        if not part.strip() or read_cell(part) is None:
            return []
        unit = text[edge:].partition("  ")[0].strip()
        items.append((number, f"{subject} {column.name}".strip(), part, unit))
    return items if normalise_heading(words + text[edge:]) == form.words else []


def read_lines(
    forms: Sequence[Labelled], lines: list[Line], at: int, subject: str = ""
) -> tuple[list[Item], int]:
    """Return the numbers of the lines from index `at` on that have one of the forms, and the index
    after the last of them.
    """
    items: list[Item] = []
    after = at
    while at < len(lines):
        if lines[at][1][1:].strip():
            first = lines[at][1][1:].split(None, 1)[0].partition("=")[0]
            found = next(
                (
                    found
                    for form in forms
                    if form.words.startswith(first)
                    and (found := read_line(form, lines[at], subject))
                ),
                None,
            )
            if found is None:
                break
            items += found
            after = at + 1
        at += 1
    return items, after


def labelled_block(name: str, pages: tuple[str, ...], forms: Sequence[Labelled]) -> PrintedBlock:
    """Return the block of lines that have one of the forms, in any order; it gives one group of
    values.
    """

    def read(lines: list[Line], at: int) -> tuple[list[Printed], int] | None:
        items, after = read_lines(forms, lines, at)
        return ([make_values(name, items)], after) if items else None

    labels = "|".join(re.escape(form.words.partition("=")[0].strip()) for form in forms)
    return PrintedBlock((name,), pages, re.compile(f"^(?:{labels}) ?="), read)


def title_block(pages: tuple[str, ...], *titles: str) -> PrintedBlock:
    """Return the block of lines that only name what follows."""
    opens = re.compile(f"^(?:{'|'.join(map(re.escape, titles))})$")
    return PrintedBlock((), pages, opens, lambda lines, at: ([], at + 1))
