"""The records of a plot file (unit 13), as the program wrote them.

FORMAT (1P10E12.4): ten fields of twelve columns, five significant digits, the common blocks of the
program in feet, pounds, degrees Rankine and degrees.  Nothing in the file indicates what comes
next, but the records differ in length:

* a case opens with sixteen lines of ten numbers, and holds nothing else when it prints no static page (hypersonic flap, transverse jet);
* lines of 10, 9 and 4 numbers and a line of logicals stand before the first page of the case, and before its pages over ground;
* a static page has 231 lines of ten numbers and one of one;
* a control device behind it has eight numbers in its fourteenth line.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from datcom_io.cells import BLANK, NA, NDM, NOT_A_NUMBER, OK, OVERFLOW, SENTINEL, read_cell
from flightmech.errors import ParseError
from flightmech.support.input_files import read_bytes

# the common block FLOLOG of the program, in its order
LOGICALS = (
    *(
        "FLTC",
        "OPTI",
        "BO",
        "WGPL",
        "WGSC",
        "SYNT",
        "HTPL",
        "HTSC",
        "VTPL",
        "VTSC",
        "HEAD",
        "PRPOWR",
        "JETPOW",
        "LOASRT",
        "TVTPAN",
    ),
    *(
        "SUPERS",
        "SUBSON",
        "TRANSN",
        "HYPERS",
        "SYMFP",
        "ASYFP",
        "TRIMC",
        "TRIM",
        "DAMP",
        "HYPEF",
        "TRAJET",
        "BUILD",
        "FIRST",
    ),
    *("DRCONV", "PART", "VFPL", "VFSC", "CTAB", "PLOT"),
)
CONFIGURATIONS = ("BODY", "WING", "HT", "VT", "VF", "BW", "BH", "BV", "BWH", "BWV", "BWHV")
_WIDTH = 12
_MOST_MACHS = 20
_CASE = {"FLC": 160}
_HEADING = {"SYNA": 19, "OPT": 4}
_LAST_LINES = {
    1: "page",
    8: "control",
    9: "heading",
}  # by the numbers in the first line that has not ten
_TEN_NUMBERS = re.compile(
    r"(?: {1,2}-?\d\.\d{4}E[-+]\d\d| {12}|\*{12}|[ +-]*(?:NaN|Infinity)){10} *"
)
_CONDITION = {**dict.fromkeys(CONFIGURATIONS, 200), "DWASH": 60, "FACT": 40, "CDO": 11}
_CONTROL = {
    "F": 138,
    "BODY_CONTROL": 200,
    "WING_CONTROL": 200,
    "HT_CONTROL": 180,
    "VT_CONTROL": 180,
}
_MARKS = {1.0e-30: NDM, 2.0e-30: NA, -1.0e-30: BLANK}


@dataclass(frozen=True, eq=False)
class PlotRecord:
    """Numbers of one record with their flags; ``line`` is its first. [feet, pounds, degrees
    Rankine, degrees]
    """

    line: int
    values: np.ndarray
    flags: np.ndarray

    def numbers(self, first: int, last: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the numbers first ... last, counted from 1 as in the program, NaN where there is
        none, and their flags.
        """
        part = slice(first - 1, last)
        return np.where(self.flags[part] == OK, self.values[part], np.nan), self.flags[part].copy()

    def number(self, place: int) -> float:
        """Return one number, counted from 1; NaN where there is none."""
        return float(self.numbers(place, place)[0][0])


@dataclass(eq=False)
class PlotCase:
    """One case: what holds for all of it, and a dict of records per static page; without such a
    page it has no logicals.

    Page by page the program overwrites the blocks, so those of a page over ground hold the
    coefficients over ground.
    """

    line: int
    records: dict[str, PlotRecord]
    logicals: dict[str, bool] = field(default_factory=dict)
    pages: list[dict[str, PlotRecord]] = field(default_factory=list)


def read_records(path: str | os.PathLike[str]) -> list[PlotCase]:
    """Return the cases of a plot file.

    Raises
    ------
    ParseError
        The file is no plot file, or ends within a record.
    """
    lines = read_bytes(path, "a plot file (unit 13)").decode("latin-1").splitlines()
    while lines and not lines[-1].strip("\x1a "):
        lines.pop()
    file, at = Path(path).name, 0
    cases: list[PlotCase] = []
    if not lines or not is_line_of_plot(lines[0]):
        found = (
            f"a file of {len(lines)} lines whose first is no line of ten numbers of twelve columns"
        )
        raise ParseError(file, 0, found, "a plot file (unit 13, written with card PLOT)")
    while at < len(lines):
        expected = (
            "case" if not cases else "page" if cases[-1].logicals and not cases[-1].pages else ""
        )
        kind = expected or _kind(lines, at)
        if kind == "case":
            records, after = _take(file, lines, at, _CASE)
            cases.append(PlotCase(at + 1, records))
            at = after
        elif kind == "heading":
            heading, after = _take(file, lines, at, _HEADING)
            cases[-1].records.update(heading)
            cases[-1].logicals = _logicals(file, lines, after)
            at = after + 1
        elif kind == "page":
            page, at = _take(file, lines, at, _CONDITION)
            cases[-1].pages.append(page)
        else:
            control, at = _take(file, lines, at, _CONTROL)
            cases[-1].pages[-1].update(control)
    for case in cases:
        if case.pages and not case.logicals:
            raise ParseError(
                file,
                case.line,
                "static pages without a line of logicals",
                "34 logicals before the first of them; run again",
            )
    return cases


def is_line_of_plot(line: str) -> bool:
    """Return whether a line is ten numbers as the program writes them."""
    return _TEN_NUMBERS.fullmatch(line.rstrip("\r\n\x1a")) is not None


def _kind(lines: Sequence[str], at: int) -> str:
    """Return what begins at a line: ``case heading page control``."""
    end = next((k for k in range(at, len(lines)) if len(_fields(lines[k])) != 10), len(lines))
    count, last = end - at, len(_fields(lines[end])) if end < len(lines) else 0
    if last == 9 and count > 1:
        return "case"
    return _LAST_LINES.get(last, "case" if _counts_machs(lines[at]) else "page")


def _counts_machs(line: str) -> bool:
    """Return whether a line begins with the number of Mach numbers of a case, not with a
    coefficient.
    """
    found = read_cell(line[:_WIDTH])
    return found is not None and found[0] in range(1, _MOST_MACHS + 1)


def _logicals(file: str, lines: Sequence[str], at: int) -> dict[str, bool]:
    words = lines[at].split() if at < len(lines) else []
    if len(words) != len(LOGICALS) or not {"T", "F"}.issuperset(words):
        raise ParseError(
            file,
            at + 1,
            f"{' '.join(words)[:40]!r}",
            f"a line of {len(LOGICALS)} logicals, T or F; run the program again",
        )
    return dict(zip(LOGICALS, (word == "T" for word in words)))


def _fields(line: str) -> list[str]:
    text = line.rstrip()
    return [text[k : k + _WIDTH] for k in range(0, len(text), _WIDTH)]


def _take(
    file: str, lines: Sequence[str], at: int, sizes: Mapping[str, int]
) -> tuple[dict[str, PlotRecord], int]:
    """Return records of known sizes from a line on, and the index of the line after them."""
    records = {}
    for name, size in sizes.items():
        first = at
        cells: list[tuple[float, int]] = []
        while len(cells) < size:
            if at == len(lines):
                raise ParseError(
                    file,
                    at,
                    f"the end of the file after {len(cells)} numbers of {name}",
                    f"{size}; run the program again",
                )
            row = _fields(lines[at])
            wanted = min(10, size - len(cells))
            if len(row) != wanted:
                raise ParseError(
                    file,
                    at + 1,
                    f"{len(row)} fields in a line of {name}",
                    f"{wanted} fields of {_WIDTH} columns",
                )
            cells += [_cell(file, at + 1, text) for text in row]
            at += 1
        records[name] = PlotRecord(
            first + 1,
            np.array([value for value, _ in cells]),
            np.array([flag for _, flag in cells], np.uint8),
        )
    return records, at


def _cell(file: str, line: int, text: str) -> tuple[float, int]:
    found = read_cell(text)
    if found is None or found[1] not in (OK, SENTINEL, OVERFLOW, NOT_A_NUMBER):
        raise ParseError(file, line, f"{text.strip()!r} in a field of {_WIDTH} columns", "a number")
    value, flag = found
    return value, _MARKS.get(value, SENTINEL) if flag == SENTINEL else flag
