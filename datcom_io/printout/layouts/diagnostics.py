"""Output of the cards NAMELIST, DUMP and PRINT EXTRAP: variables, arrays, and chart look-ups.

Card PRINT EXTRAP lists the look-ups beyond the limits of a chart.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from datcom_io.cells import OK
from datcom_io.printout.rows import Line
from datcom_io.printout.tables import Printed, PrintedBlock, PrintedValues, make_values

Item = tuple[int, str, str]
"""Line number, label, text."""

# Page LIST OF FINAL INPUTS, ``0VAR   = v, v, ...``: the name of the variable, the sign of equality,
# then up to eight fields of G14.7 with a comma behind each.
_VARIABLE_NAME, _EQUALS = slice(1, 8), 8
_FIELD_FIRST, _FIELD_STEP = 9, 15


def _namelist_fields(text: str) -> list[str]:
    """Return the values of a line of the namelist echo, none when they do not end in commas."""
    fields = []
    for start in range(_FIELD_FIRST, len(text.rstrip()), _FIELD_STEP):
        part = text[start : start + _FIELD_STEP].strip()
        if not part.endswith(","):
            return []
        fields.append(part[:-1].strip())
    return fields


def _read_namelist(lines: list[Line], opening: int) -> tuple[list[Printed], int] | None:
    """Read one namelist, from ``$NAME`` to ``$END``."""
    name = lines[opening][1][1:].strip().removeprefix("$")
    # Name of each variable, and line number and text of each of its values.
    variables: list[tuple[str, list[tuple[int, str]]]] = []
    index = opening + 1
    while index < len(lines):
        number, text = lines[index]
        if text[1:].strip() == "$END":
            index += 1
            break
        cells = [(number, field) for field in _namelist_fields(text)]
        begins_variable = text[_EQUALS : _EQUALS + 1] == "="
        continues_variable = bool(variables) and not text[:_FIELD_FIRST].strip()
        if cells and begins_variable:
            variables.append((text[_VARIABLE_NAME].strip(), cells))
        elif cells and continues_variable:
            variables[-1][1].extend(cells)
        elif text[1:].strip():
            break
        index += 1
    items = []
    for variable, cells in variables:
        for k, (number, field) in enumerate(cells, 1):
            # An array has a subscript in its labels, a scalar has none.
            subscript = ""
            if len(cells) > 1:
                subscript = f"({k})"
            items.append((number, f"{name}.{variable}{subscript}", field, ""))
    if not items:
        return None
    return [make_values("namelist", items)], index


# Dump pages, ``NAME(nnn)= value``: five elements on a line.
_ELEMENT = re.compile(r"(?<![A-Z0-9])([A-Z][A-Z0-9]*) *\( *(\d+)\)= *([^\s=]+)")


def _read_dump(lines: list[Line], opening: int) -> tuple[list[Printed], int] | None:
    """Read the elements of dumped arrays."""
    items: list[tuple[int, str, str, str]] = []
    index = opening
    while index < len(lines):
        number, text = lines[index]
        elements = _ELEMENT.findall(text)
        if text[1:].strip() and (not elements or _ELEMENT.sub("", text).strip()):
            break
        for name, element, value in elements:
            items.append((number, f"{name}({element})", value, ""))
        index += 1
    if not items:
        return None
    return [make_values("dump", items)], index


# Page EXTRAPOLATION MESSAGE SUMMARY: per figure a line with the types of extrapolation and a line
# with routines and limits, then per look-up a line with the result and its variables.  Two
# asterisks behind a variable mark that it was outside of the chart.
_MOST_VARIABLES = 4  # of a chart


def _read_extrapolation(lines: list[Line], opening: int) -> tuple[list[Printed], int] | None:
    """Read the look-ups of the summary."""
    items: list[Item] = []
    index = opening + 1
    while index < len(lines) and lines[index][1].lstrip().startswith(
        ("SUBROUTINES", "FINAL RESULT")
    ):
        index += 1
    while index < len(lines):
        number, text = lines[index]
        cells = [(label, cell.strip()) for label, cell in _look_up_cells(text) if cell.strip()]
        if text[1:].strip() and not cells:
            break
        for label, cell in cells:
            items.append((number, label, cell))
        index += 1
    if not items:
        return None
    return [_make_look_ups("extrapolation", items)], index


def _look_up_cells(text: str) -> list[tuple[str, str]]:
    """Return label and text of the cells of one line of the summary, none for any other line."""
    # First line of a chart: carriage control 0, overlay, figure, type of extrapolation per
    # variable.
    if text[0] == "0" and not text[1:].lstrip().startswith("*"):
        cells = [("OVERLAY", text[3:5]), ("FIGURE NUMBER", text[10:30])]
        for k, side in enumerate(_sides()):
            cells.append((f"TYPE OF EXTRAPOLATION {side}", text[38 + 10 * k : 46 + 10 * k]))
        return cells
    if text[0] != " ":
        return []
    # Second line: subroutines, and limits of the figure per variable.
    if text[10:26].strip() and not text[1:10].strip():
        cells = [("SUBROUTINES 1", text[10:18]), ("SUBROUTINES 2", text[18:26])]
        for k, side in enumerate(_sides()):
            cells.append((f"FIGURE LIMITS {side}", text[36 + 10 * k : 46 + 10 * k]))
        return cells
    # Third line: result, and the independent variables with a mark of extrapolation.
    if not text[1:24].strip():
        cells = [("FINAL RESULT", text[24:37])]
        for k in range(_MOST_VARIABLES):
            cells.append((f"INDEPENDENT VARIABLES {k + 1}", text[40 + 20 * k : 53 + 20 * k]))
            cells.append((f"** {k + 1}", text[53 + 20 * k : 57 + 20 * k]))
        return cells
    return []


def _sides() -> list[str]:
    """Return both sides of each variable of a chart, in the order of the print."""
    sides = []
    for k in range(1, _MOST_VARIABLES + 1):
        sides += [f"LOWER {k}", f"UPPER {k}"]
    return sides


def _make_look_ups(name: str, items: list[Item]) -> PrintedValues:
    """Return a group in which only overlays, limits, results and variables are numbers.

    The name of a figure, a routine and a code are texts: ``ok`` without a number.
    """
    group = make_values(name, [(number, label, text, "") for number, label, text in items])
    numbers = ("OVERLAY", "FIGURE LIMITS", "FINAL", "INDEPENDENT")
    is_text = np.array([not label.startswith(numbers) for label in group.labels])
    values = np.where(is_text, np.nan, group.values)
    flags = np.where(is_text, OK, group.flags).astype(np.uint8)
    return replace(group, given=(values, flags))


BLOCKS = (
    PrintedBlock(("namelist",), ("final inputs",), re.compile(r"^\$[A-Z]+$"), _read_namelist),
    PrintedBlock(("dump",), ("dump",), re.compile(r"^[A-Z][A-Z0-9]* ?\( ?\d+\)="), _read_dump),
    PrintedBlock(
        ("extrapolation",),
        ("extrapolation",),
        re.compile("^OVERLAY FIGURE NUMBER"),
        _read_extrapolation,
    ),
)
LAYOUTS = ()
