"""The records of a plot file (unit 13), as the program wrote them.

FORMAT (1P10E12.4): ten fields of twelve columns, five significant digits, the common blocks of the
program in feet, pounds, degrees Rankine and degrees.  The sizes of all records are fixed; which of
them a case has is the subject of `datcom_io.exchange.plot_files.plot_cases`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
_TEN_NUMBERS = re.compile(
    r"(?: {1,2}-?\d\.\d{4}E[-+]\d\d| {12}|\*{12}|[ +-]*(?:NaN|Infinity)){10} *"
)
# Sizes of the records of each part of the file.
SIZES: dict[str, dict[str, int]] = {
    # Flight conditions of the case, in check of the cards.
    "case": {"FLC": 160},
    # Positions and reference quantities.
    "heading": {"SYNA": 19, "OPT": 4},
    # Ten blocks of twenty angles for each configuration, downwash, factors, drag at zero lift.
    "page": {**dict.fromkeys(CONFIGURATIONS, 200), "DWASH": 60, "FACT": 40, "CDO": 11},
    "control": {
        "F": 138,
        "BODY_CONTROL": 200,
        "WING_CONTROL": 200,
        "HT_CONTROL": 180,
        "VT_CONTROL": 180,
    },
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


def is_line_of_plot(line: str) -> bool:
    """Return whether a line is ten numbers as the program writes them."""
    return _TEN_NUMBERS.fullmatch(line.rstrip("\r\n\x1a")) is not None


class PlotLines:
    """Lines of a plot file.

    Parameters
    ----------
    path : path

    Raises
    ------
    ParseError
        The first line is not one of ten numbers.
    """

    def __init__(self, path: str | os.PathLike[str]):
        self.lines = read_bytes(path, "a plot file (unit 13)").decode("latin-1").splitlines()
        while self.lines and not self.lines[-1].strip("\x1a "):
            self.lines.pop()
        self.file = Path(path).name
        if not self.lines or not is_line_of_plot(self.lines[0]):
            problem = (
                f"a file of {len(self.lines)} lines whose first is not a line of ten numbers of "
                f"twelve columns"
            )
            raise ParseError(self.file, 0, problem, "a plot file (unit 13, written with card PLOT)")

    def __len__(self) -> int:
        return len(self.lines)

    def count_fields(self, index: int) -> int:
        """Return the number of fields of a line, 0 behind the end of the file."""
        if index >= len(self.lines):
            return 0
        return len(_split_fields(self.lines[index]))

    def number(self, index: int, place: int) -> float:
        """Return a number of a line, counted from 1; NaN where there is none."""
        if index >= len(self.lines):
            return float("nan")
        cell = read_cell(self.lines[index][(place - 1) * _WIDTH : place * _WIDTH])
        return float("nan") if cell is None else cell[0]

    def read_records(self, start: int, part: str) -> tuple[dict[str, PlotRecord], int]:
        """Return the records of a part of the file, and the index of the line after them."""
        return _read_sizes(self.file, self.lines, start, SIZES[part])

    def read_logicals(self, index: int) -> dict[str, bool]:
        """Return the logicals of a line by their names."""
        return _read_logicals(self.file, self.lines, index)


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
