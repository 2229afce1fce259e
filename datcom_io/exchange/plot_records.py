"""The records of a plot file (unit 13), as the program wrote them.

FORMAT (1P10E12.4): ten fields of twelve columns, five significant digits, the common blocks of the
program in feet, pounds, degrees Rankine and degrees.  Nothing in the file names the next record,
but the records differ in length:

* a case opens with sixteen lines of ten numbers, and holds nothing else when it prints no static
  page (hypersonic flap, transverse jet);
* lines of 10, 9 and 4 numbers and a line of logicals stand before the first page of the case, and
  before its pages over ground;
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

# The common block FLOLOG of the program, in its order.
LOGICALS = (
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
    "DRCONV",
    "PART",
    "VFPL",
    "VFSC",
    "CTAB",
    "PLOT",
)
CONFIGURATIONS = ("BODY", "WING", "HT", "VT", "VF", "BW", "BH", "BV", "BWH", "BWV", "BWHV")
_WIDTH = 12
_PER_LINE = 10
_MOST_MACHS = 20
# Records of the case, its heading, a static page and a control device: name and size.
_CASE = {"FLC": 160}
_HEADING = {"SYNA": 19, "OPT": 4}
# What begins at a line, by the size of the first line behind it that does not have ten numbers.
_KIND_OF_LAST_LINE = {1: "page", 8: "control", 9: "heading"}
_TEN_NUMBERS = re.compile(
    r"(?: {1,2}-?\d\.\d{4}E[-+]\d\d| {12}|\*{12}|[ +-]*(?:NaN|Infinity)){10} *"
)
# Eleven configurations of ten blocks of twenty angles, downwash, factors, drag at zero lift.
_CONDITION = {**dict.fromkeys(CONFIGURATIONS, 200), "DWASH": 60, "FACT": 40, "CDO": 11}
_CONTROL = {
    "F": 138,
    "BODY_CONTROL": 200,
    "WING_CONTROL": 200,
    "HT_CONTROL": 180,
    "VT_CONTROL": 180,
}
# Codes of the program for a missing number.
_MARKS = {1.0e-30: NDM, 2.0e-30: NA, -1.0e-30: BLANK}


@dataclass(frozen=True, eq=False)
class PlotRecord:
    """Numbers of one record with their flags; ``line`` is its first line.

    The numbers are in feet, pounds, degrees Rankine and degrees.
    """

    line: int
    values: np.ndarray
    flags: np.ndarray

    def numbers(self, first: int, last: int) -> tuple[np.ndarray, np.ndarray]:
        """Return numbers ``first`` to ``last``, counted from 1 as in the program, and their flags.

        A missing number is NaN.
        """
        part = slice(first - 1, last)
        values = np.where(self.flags[part] == OK, self.values[part], np.nan)
        return values, self.flags[part].copy()

    def number(self, index: int) -> float:
        """Return one number, counted from 1; NaN where it is missing."""
        return float(self.numbers(index, index)[0][0])

    def count(self, index: int, most: int) -> int:
        """Return a number as a count, 0 when it is missing or larger than `most`."""
        number = self.number(index)
        if not 0 < number <= most:
            return 0
        return int(number)


@dataclass(eq=False)
class PlotCase:
    """One case: its records, and a dict of records per static page.

    A case without a static page has no logicals.  Page by page the program overwrites the blocks,
    so those of a page over ground hold the coefficients over ground.
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
        The file is not a plot file, or ends within a record.
    """
    lines = read_bytes(path, "a plot file (unit 13)").decode("latin-1").splitlines()
    while lines and not lines[-1].strip("\x1a "):
        lines.pop()
    file = Path(path).name
    cases: list[PlotCase] = []
    if not lines or not is_line_of_plot(lines[0]):
        problem = (
            f"a file of {len(lines)} lines whose first is not a line of ten numbers of "
            f"twelve columns"
        )
        raise ParseError(file, 0, problem, "a plot file (unit 13, written with card PLOT)")
    index = 0
    while index < len(lines):
        kind = _next_kind(lines, index, cases)
        if kind == "case":
            records, after = _read_sizes(file, lines, index, _CASE)
            cases.append(PlotCase(index + 1, records))
        elif kind == "heading":
            # The logicals follow the heading, in a line of letters.
            heading, logicals_line = _read_sizes(file, lines, index, _HEADING)
            cases[-1].records.update(heading)
            cases[-1].logicals = _read_logicals(file, lines, logicals_line)
            after = logicals_line + 1
        elif kind == "page":
            page, after = _read_sizes(file, lines, index, _CONDITION)
            cases[-1].pages.append(page)
        else:
            control, after = _read_sizes(file, lines, index, _CONTROL)
            cases[-1].pages[-1].update(control)
        index = after
    for case in cases:
        if case.pages and not case.logicals:
            raise ParseError(
                file,
                case.line,
                "static pages without a line of logicals",
                "34 logicals before the first of them; run again",
            )
    return cases


def _next_kind(lines: Sequence[str], index: int, cases: list[PlotCase]) -> str:
    """Return what begins at a line: ``case heading page control``."""
    if not cases:
        return "case"
    # Logicals without a page come before the first page.
    if cases[-1].logicals and not cases[-1].pages:
        return "page"
    return _kind_by_length(lines, index)


def is_line_of_plot(line: str) -> bool:
    """Return whether a line is ten numbers as the program writes them."""
    return _TEN_NUMBERS.fullmatch(line.rstrip("\r\n\x1a")) is not None


def _kind_by_length(lines: Sequence[str], index: int) -> str:
    """Return what begins at a line by the lines with ten numbers that follow."""
    end = index
    while end < len(lines) and len(_split_fields(lines[end])) == _PER_LINE:
        end += 1
    last_size = 0
    if end < len(lines):
        last_size = len(_split_fields(lines[end]))
    # A heading has one line of ten numbers; a case stands before it.
    if last_size == 9 and end - index > 1:
        return "case"
    if last_size in _KIND_OF_LAST_LINE:
        return _KIND_OF_LAST_LINE[last_size]
    if _counts_machs(lines[index]):
        return "case"
    return "page"


def _counts_machs(line: str) -> bool:
    """Return whether a line begins with a count of Mach numbers, not with a coefficient."""
    cell = read_cell(line[:_WIDTH])
    return cell is not None and cell[0] in range(1, _MOST_MACHS + 1)


def _read_logicals(file: str, lines: Sequence[str], index: int) -> dict[str, bool]:
    """Return the logicals of a line by their names."""
    texts: list[str] = []
    if index < len(lines):
        texts = lines[index].split()
    if len(texts) != len(LOGICALS) or not {"T", "F"}.issuperset(texts):
        raise ParseError(
            file,
            index + 1,
            f"{' '.join(texts)[:40]!r}",
            f"a line of {len(LOGICALS)} logicals, T or F; run the program again",
        )
    return dict(zip(LOGICALS, (word == "T" for word in texts)))


def _split_fields(line: str) -> list[str]:
    text = line.rstrip()
    return [text[k : k + _WIDTH] for k in range(0, len(text), _WIDTH)]


def _read_sizes(
    file: str, lines: Sequence[str], start: int, sizes: Mapping[str, int]
) -> tuple[dict[str, PlotRecord], int]:
    """Return records of known sizes from a line on, and the index of the line after them."""
    records = {}
    index = start
    for name, size in sizes.items():
        first = index
        values: list[float] = []
        flags: list[int] = []
        while len(values) < size:
            if index == len(lines):
                problem = f"the end of the file after {len(values)} numbers of {name}"
                raise ParseError(file, index, problem, f"{size}; run the program again")
            fields = _split_fields(lines[index])
            expected = min(_PER_LINE, size - len(values))
            if len(fields) != expected:
                raise ParseError(
                    file,
                    index + 1,
                    f"{len(fields)} fields in a line of {name}",
                    f"{expected} fields of {_WIDTH} columns",
                )
            for text in fields:
                value, flag = _read_number(file, index + 1, text)
                values.append(value)
                flags.append(flag)
            index += 1
        records[name] = PlotRecord(first + 1, np.array(values), np.array(flags, np.uint8))
    return records, index


def _read_number(file: str, line: int, text: str) -> tuple[float, int]:
    """Return value and flag of a field."""
    cell = read_cell(text)
    if cell is None or cell[1] not in (OK, SENTINEL, OVERFLOW, NOT_A_NUMBER):
        problem = f"{text.strip()!r} in a field of {_WIDTH} columns"
        raise ParseError(file, line, problem, "a number")
    value, flag = cell
    # The file has no words; the codes of the program for a missing number are written as numbers.
    if flag == SENTINEL:
        flag = _MARKS.get(value, SENTINEL)
    return value, flag
