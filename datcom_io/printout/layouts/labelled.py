"""Lines of ``label = value``, cut by columns like the rows of a table.

Every number has fixed columns behind its label.  A label may itself hold signs of equality,
``(CLB/CL)M=1.4``, and a number may touch the label before it.  Only columns separate them.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from datcom_io.cells import read_cell
from datcom_io.printout.rows import Line, PrintedColumn
from datcom_io.printout.tables import Printed, PrintedBlock, make_values, normalise_heading

Item = tuple[int, str, str, str]
"""Line number, label, text, unit as printed: the input of `make_values`."""


class Labelled(NamedTuple):
    """One form of line: its text without the numbers, and the columns of the numbers.

    The text has single blanks; the columns are named by their labels.
    """

    text: str
    numbers: tuple[PrintedColumn, ...]


def read_line(form: Labelled, line: Line, subject: str = "") -> list[Item]:
    """Return the numbers of a line, none when it has another form.

    `subject` is put before the labels.
    """
    number, text = line
    # float() accepts 1_0 and digits of other scripts; the program prints neither.
    if "_" in text or not text.isascii():
        return []
    items, labels_text, edge = [], "", 0
    for column in form.numbers:
        labels_text += text[edge : column.first - 1] + " "
        edge = column.last
        part = text[column.first - 1 : edge]
        if not part.strip() or read_cell(part) is None:
            return []
        # The unit stands behind the number, before the next double blank.
        unit = text[edge:].partition("  ")[0].strip()
        items.append((number, f"{subject} {column.name}".strip(), part, unit))
    if normalise_heading(labels_text + text[edge:]) != form.text:
        return []
    return items


def read_lines(
    forms: Sequence[Labelled], lines: list[Line], start: int, subject: str = ""
) -> tuple[list[Item], int]:
    """Return the numbers of the lines from index `start` on, and the index after the last of them.

    The lines end at the first one that has a text and none of the forms.
    """
    items: list[Item] = []
    after = start
    for index in range(start, len(lines)):
        if not lines[index][1][1:].strip():
            continue
        numbers = _read_any_form(forms, lines[index], subject)
        if not numbers:
            break
        items += numbers
        after = index + 1
    return items, after


def _read_any_form(forms: Sequence[Labelled], line: Line, subject: str) -> list[Item]:
    # Most forms are ruled out by their first word.
    first_word = line[1][1:].split(None, 1)[0].partition("=")[0]
    for form in forms:
        if form.text.startswith(first_word):
            numbers = read_line(form, line, subject)
            if numbers:
                return numbers
    return []


def labelled_block(name: str, pages: tuple[str, ...], forms: Sequence[Labelled]) -> PrintedBlock:
    """Return the block of lines that have one of the forms, in any order.

    The block gives one group of values.
    """

    def read(lines: list[Line], opening: int) -> tuple[list[Printed], int] | None:
        items, after = read_lines(forms, lines, opening)
        if not items:
            return None
        return [make_values(name, items)], after

    labels = "|".join(re.escape(form.text.partition("=")[0].strip()) for form in forms)
    return PrintedBlock((name,), pages, re.compile(f"^(?:{labels}) ?="), read)


def title_block(pages: tuple[str, ...], *titles: str) -> PrintedBlock:
    """Return the block of lines that only name the content below them."""
    opens = re.compile(f"^(?:{'|'.join(map(re.escape, titles))})$")
    return PrintedBlock((), pages, opens, lambda lines, opening: ([], opening + 1))
