"""What the cards NAMELIST, DUMP and PRINT EXTRAP print: variables, arrays, and look-ups beyond the
limits of a chart.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from datcom_io.cells import OK
from datcom_io.printout.rows import Line
from datcom_io.printout.tables import Printed, PrintedBlock, Values, make_values

_VARIABLE_NAME, _EQUALS = slice(1, 8), 8
_FIELD_FIRST, _FIELD_WIDTH, _FIELD_STEP = 9, 14, 15  # G14.7 and a comma, eight on a line
_ELEMENT = re.compile(r"(?<![A-Z0-9])([A-Z][A-Z0-9]*) *\( *(\d+)\)= *([^\s=]+)")
_MOST_VARIABLES = 4  # of a chart

Item = tuple[int, str, str]  # line number, label, text


def _fields(text: str) -> list[str] | None:
    """Return the values of a line of the namelist echo; None when they do not end in commas."""
    found = [
        text[at : at + _FIELD_STEP].strip()
        for at in range(_FIELD_FIRST, len(text.rstrip()), _FIELD_STEP)
    ]
    return (
        [part[:-1].strip() for part in found]
        if found and all(part.endswith(",") for part in found)
        else None
    )


def _read_namelist(lines: list[Line], at: int) -> tuple[list[Printed], int] | None:
    """Read one namelist, from ``$NAME`` to ``$END``; an array has an index in its labels, a scalar
    has none.
    """
    name = lines[at][1][1:].strip().removeprefix("$")
    variables: list[tuple[str, list[tuple[int, str]]]] = []
    at += 1
    while at < len(lines):
        number, text = lines[at]
        fields = _fields(text)
        if text[1:].strip() == "$END":
            at += 1
            break
        if fields is None or (
            text[_EQUALS : _EQUALS + 1] != "=" and (text[:_FIELD_FIRST].strip() or not variables)
        ):
            if text[1:].strip():
                break
        elif text[_EQUALS] == "=":
            variables.append((text[_VARIABLE_NAME].strip(), [(number, field) for field in fields]))
        else:
            variables[-1][1].extend((number, field) for field in fields)
        at += 1
    items = [
        (number, f"{name}.{variable}" + (f"({k})" if len(held) > 1 else ""), field, "")
        for variable, held in variables
        for k, (number, field) in enumerate(held, 1)
    ]
    return ([make_values("namelist", items)], at) if items else None


def _read_dump(lines: list[Line], at: int) -> tuple[list[Printed], int] | None:
    """Read lines of ``NAME(nnn)= value``, five on a line."""
    items: list[tuple[int, str, str, str]] = []
    while at < len(lines):
        number, text = lines[at]
        found = _ELEMENT.findall(text)
        if text[1:].strip() and (not found or _ELEMENT.sub("", text).strip()):
            break
        items += [(number, f"{name}({index})", value, "") for name, index, value in found]
        at += 1
    return ([make_values("dump", items)], at) if items else None


def _read_extrapolation(lines: list[Line], at: int) -> tuple[list[Printed], int] | None:
    """Read the look-ups: figure with types of extrapolation, routines with limits, then a result
    and its variables per look-up.
    """
    items: list[Item] = []
    at += 1
    while at < len(lines) and lines[at][1].lstrip().startswith(("SUBROUTINES", "FINAL RESULT")):
        at += 1
    while at < len(lines):
        number, text = lines[at]
        part = list(_look_up(number, text))
        if text[1:].strip() and not part:
            break
        items += part
        at += 1
    return ([_with_words("extrapolation", items)], at) if items else None


def _look_up(number: int, text: str) -> Iterator[Item]:
    """Yield the cells of one line of the summary; nothing for a line that is none."""
    if text[0] == "0" and not text[1:].lstrip().startswith("*"):
        cells = [("OVERLAY", text[3:5]), ("FIGURE NUMBER", text[10:30])]
        cells += [
            (f"TYPE OF EXTRAPOLATION {side}", text[38 + 10 * k : 46 + 10 * k])
            for k, side in enumerate(_sides())
        ]
    elif text[0] == " " and text[10:26].strip() and not text[1:10].strip():
        cells = [("SUBROUTINES 1", text[10:18]), ("SUBROUTINES 2", text[18:26])]
        cells += [
            (f"FIGURE LIMITS {side}", text[36 + 10 * k : 46 + 10 * k])
            for k, side in enumerate(_sides())
        ]
    elif text[0] == " " and not text[1:24].strip():
        cells = [("FINAL RESULT", text[24:37])]
        for k in range(_MOST_VARIABLES):
            cells.append((f"INDEPENDENT VARIABLES {k + 1}", text[40 + 20 * k : 53 + 20 * k]))
            cells.append((f"** {k + 1}", text[53 + 20 * k : 57 + 20 * k]))
    else:
        return
    yield from ((number, label, cell.strip()) for label, cell in cells if cell.strip())


def _sides() -> list[str]:
    return [f"{side} {k + 1}" for k in range(_MOST_VARIABLES) for side in ("LOWER", "UPPER")]


def _with_words(name: str, items: list[Item]) -> Values:
    """Return a group in which only limits, results and variables are numbers; a figure's name or a
    code is a text.
    """
    found = make_values(name, [(number, label, text, "") for number, label, text in items])
    words = np.array(
        [
            not label.startswith(("OVERLAY", "FIGURE LIMITS", "FINAL", "INDEPENDENT"))
            for label in found.labels
        ]
    )
    return replace(
        found,
        given=(
            np.where(words, np.nan, found.values),
            np.where(words, OK, found.flags).astype(np.uint8),
        ),
    )


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
