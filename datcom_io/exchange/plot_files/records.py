"""The records of a plot file (unit 13), as the program wrote them.

FORMAT (1P10E12.4): ten fields of twelve columns, five significant digits, the common blocks of the program in feet, pounds,
degrees Rankine and degrees.  Nothing in the file indicates what comes next, but the records differ in length: a case opens with
sixteen lines of ten numbers that end in 10, 9 and 4 numbers and a line of logicals; the record of a control device has eight
numbers in its fourteenth line.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from flightmech.errors import ParseError
from flightmech.support.input_files.text import read_bytes

from ...cells import BLANK, NA, NDM, NOT_A_NUMBER, OK, OVERFLOW, SENTINEL, read_cell

# the common block FLOLOG of the program, in its order
LOGICALS = (
    *("FLTC", "OPTI", "BO", "WGPL", "WGSC", "SYNT", "HTPL", "HTSC", "VTPL", "VTSC", "HEAD", "PRPOWR", "JETPOW", "LOASRT", "TVTPAN"),
    *("SUPERS", "SUBSON", "TRANSN", "HYPERS", "SYMFP", "ASYFP", "TRIMC", "TRIM", "DAMP", "HYPEF", "TRAJET", "BUILD", "FIRST"),
    *("DRCONV", "PART", "VFPL", "VFSC", "CTAB", "PLOT"),
)
CONFIGURATIONS = ("BODY", "WING", "HT", "VT", "VF", "BW", "BH", "BV", "BWH", "BWV", "BWHV")
_WIDTH = 12
_CASE = {"FLC": 160, "SYNA": 19, "OPT": 4}
_CONDITION = {**dict.fromkeys(CONFIGURATIONS, 200), "DWASH": 60, "FACT": 40, "CDO": 11}
_CONTROL = {"F": 138, "BODY_CONTROL": 200, "WING_CONTROL": 200, "HT_CONTROL": 180, "VT_CONTROL": 180}
_MARKS = {1.0e-30: NDM, 2.0e-30: NA, -1.0e-30: BLANK}


@dataclass(frozen=True, eq=False)
class Record:
    """Numbers of one record with their flags; ``line`` is its first. [feet, pounds, degrees Rankine, degrees]"""

    line: int
    values: np.ndarray
    flags: np.ndarray

    def numbers(self, first: int, last: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the numbers first ... last, counted from 1 as in the program, NaN where there is none, and their flags."""
        part = slice(first - 1, last)
        return np.where(self.flags[part] == OK, self.values[part], np.nan), self.flags[part].copy()

    def number(self, place: int) -> float:
        """Return one number, counted from 1; NaN where there is none."""
        return float(self.numbers(place, place)[0][0])


@dataclass(eq=False)
class PlotCase:
    """One case: what holds for all of it, and a dict of records per flight condition."""

    line: int
    records: dict[str, Record]
    logicals: dict[str, bool]
    conditions: list[dict[str, Record]] = field(default_factory=list)


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
    if not _opens_case(lines, 0):
        found = f"a file of {len(lines)} lines whose 20th is no line of 34 logicals"
        raise ParseError(file, 0, found, "a plot file (unit 13, written with card PLOT)")
    while at < len(lines):
        if _opens_case(lines, at):
            records, after = _take(file, lines, at, _CASE)
            cases.append(PlotCase(at + 1, records, dict(zip(LOGICALS, (word == "T" for word in lines[after].split())))))
            at = after + 1
            continue
        condition, at = _take(file, lines, at, _CONDITION)
        if _opens_control(lines, at):
            control, at = _take(file, lines, at, _CONTROL)
            condition |= control
        cases[-1].conditions.append(condition)
    return cases


def _opens_case(lines: Sequence[str], at: int) -> bool:
    words = lines[at + 19].split() if at + 19 < len(lines) else []
    return len(words) == len(LOGICALS) and {"T", "F"}.issuperset(words)


def _opens_control(lines: Sequence[str], at: int) -> bool:
    return at + 13 < len(lines) and len(_fields(lines[at + 13])) == 8


def _fields(line: str) -> list[str]:
    text = line.rstrip()
    return [text[k : k + _WIDTH] for k in range(0, len(text), _WIDTH)]


def _take(file: str, lines: Sequence[str], at: int, sizes: Mapping[str, int]) -> tuple[dict[str, Record], int]:
    """Return records of known sizes from a line on, and the index of the line after them."""
    records = {}
    for name, size in sizes.items():
        first = at
        cells: list[tuple[float, int]] = []
        while len(cells) < size:
            if at == len(lines):
                raise ParseError(file, at, f"the end of the file after {len(cells)} numbers of {name}", f"{size}; run the program again")
            row = _fields(lines[at])
            wanted = min(10, size - len(cells))
            if len(row) != wanted:
                raise ParseError(file, at + 1, f"{len(row)} fields in a line of {name}", f"{wanted} fields of {_WIDTH} columns")
            cells += [_cell(file, at + 1, text) for text in row]
            at += 1
        records[name] = Record(first + 1, np.array([value for value, _ in cells]), np.array([flag for _, flag in cells], np.uint8))
    return records, at


def _cell(file: str, line: int, text: str) -> tuple[float, int]:
    found = read_cell(text)
    if found is None or found[1] not in (OK, SENTINEL, OVERFLOW, NOT_A_NUMBER):
        raise ParseError(file, line, f"{text.strip()!r} in a field of {_WIDTH} columns", "a number")
    value, flag = found
    return value, _MARKS.get(value, SENTINEL) if flag == SENTINEL else flag
