"""Ways to harm a listing as files get harmed: cut, lines and pages lost or doubled, columns
shifted, counts changed, rubbish between.

Every way takes the lines of a listing, those of other listings, and `pick(n)`, which chooses a
number from 0 to n - 1.
"""

from __future__ import annotations

import re
from collections.abc import Callable

Lines = list[str]
Pick = Callable[[int], int]
Way = Callable[[Lines, list[Lines], Pick], Lines]

RUBBISH = (
    *"\x00\x1a\f\x0b\x1c\x85\u2028\té٣\udcff*-.=$(E10+",
    *(
        "**********",
        "==",
        ")=",
        " NDM ",
        " NA ",
        "NaN",
        "1E400",
        "-1.#IND",
        "Infinity",
        "1_0",
        "0x10",
        "1.0E-30",
        "9" * 40,
    ),
    *("ALPHA", "DELTA = ", "END OF JOB."),
)
HEADINGS = (
    "0 ALPHA     CD       CL       CM       CN       CA       XCP        CLA          CMA    "
    "      CYB          CNB          CLB",
    "0                                  ALPHA     Q/QINF    EPSLON  D(EPSLON)/D(ALPHA)",
    "0    ALPHA       CLQ          CMQ           CLAD         CMAD         CLP          CYP  "
    "        CNP          CNR          CLR",
    "0     DELTA     D(CL)     D(CM)    D(CL MAX)    D(CD MIN)                (CLA)D     "
    "(CH)A       (CH)D",
    "0            --------- INDUCED DRAG COEFFICIENT INCREMENT , D(CDI) , DUE TO DEFLECTION "
    "---------",
    "0       DELTA = -20.0     -15.0     -10.0      -5.0",
    "0(DELTAL-DELTAR)= -40.0       -30.0",
    "0                                             DELTAL          DELTAR          (CL)ROLL",
    "1                               AUTOMATED STABILITY AND CONTROL METHODS PER APRIL 1976 "
    "VERSION OF DATCOM",
    " -----------------------  FLIGHT CONDITIONS  ------------------------           "
    "--------------  REFERENCE DIMENSIONS  ------------",
    "                                         CHARACTERISTICS AT ANGLE OF ATTACK AND IN SIDESLIP",
    "                                              CONFIGURATION AUXILIARY AND PARTIAL OUTPUT",
    "                                                     SPECIAL CONTROL METHODS",
    "1          THE FOLLOWING IS A LIST OF ALL INPUT CARDS FOR THIS CASE.",
    "1          THE FOLLOWING IS A LIST OF FINAL INPUTS FOR THIS CASE",
    "1                                                  EXTRAPOLATION MESSAGE SUMMARY",
    "1                         CONERR - INPUT ERROR CHECKING",
    "0 INPUT DIMENSIONS ARE IN M , SCALE FACTOR IS 1.0000",
    "0**** FOLLOWING ARE THE BASIC INPUT DATA BLOCKS ****",
    "1 END OF JOB.",
    "1",
)
_COUNT = re.compile(r"\b(NALPHA|NMACH|NALT|NDELTA|NGH|LOOP|NX)=[\d.]+")
COUNTS = (
    "0.0",
    "1.0",
    "2.0",
    "3.0",
    "19.0",
    "20.0",
    "21.0",
    "-1.0",
    "1.5",
    "1.0E9",
    "",
    "NaN",
    "300.0",
)
_HUGE = 20_000


def _span(lines: Lines, pick: Pick) -> tuple[int, int]:
    """Return first and last + 1 of some lines that stand together."""
    first = pick(len(lines))
    return first, min(len(lines), first + 1 + pick(12))


def _page(lines: Lines, pick: Pick) -> tuple[int, int]:
    starts = [k for k, line in enumerate(lines) if line.startswith("1")] or [0]
    first = starts[pick(len(starts))]
    return first, next((start for start in starts if start > first), len(lines))


def _rows(lines: Lines, pick: Pick) -> int:
    """Return the index of a line that looks like a row of numbers."""
    rows = [k for k, line in enumerate(lines) if re.match(r" +-?\d*\.\d", line)] or [0]
    return rows[pick(len(rows))]


def cut(lines, others, pick):
    at = pick(len(lines))
    return [*lines[:at], lines[at][: pick(len(lines[at]) + 1)]]


def lose(lines, others, pick):
    first, after = _span(lines, pick)
    return lines[:first] + lines[after:]


def double(lines, others, pick):
    first, after = _span(lines, pick)
    return lines[:after] + lines[first:]


def swap(lines, others, pick):
    a, b = sorted((pick(len(lines)), pick(len(lines))))
    return [
        *lines[:a],
        lines[b],
        *lines[a + 1 : b],
        *([lines[a]] if a != b else []),
        *lines[b + 1 :],
    ]


def lose_page(lines, others, pick):
    first, after = _page(lines, pick)
    return lines[:first] + lines[after:]


def double_page(lines, others, pick):
    first, after = _page(lines, pick)
    return lines[:after] + lines[first:]


def move_page(lines, others, pick):
    first, after = _page(lines, pick)
    rest = lines[:first] + lines[after:]
    at = pick(len(rest) + 1)
    return rest[:at] + lines[first:after] + rest[at:]


def overwrite(lines, others, pick):
    at = pick(len(lines))
    line, text = lines[at], RUBBISH[pick(len(RUBBISH))]
    column = pick(max(len(line), 1))
    return [*lines[:at], line[:column] + text + line[column + len(text) :], *lines[at + 1 :]]


def shift(lines, others, pick):
    at = _rows(lines, pick)
    line = lines[at]
    column, by = pick(max(len(line), 1)), 1 + pick(6)
    moved = (
        line[:column] + " " * by + line[column:] if pick(2) else line[:column] + line[column + by :]
    )
    return [*lines[:at], moved, *lines[at + 1 :]]


def rewrite_row(lines, others, pick):
    """Put a word, asterisks or another row into a row."""
    at = _rows(lines, pick)
    line = lines[at]
    column = pick(max(len(line), 1))
    text = (
        "*" * (1 + pick(140)),
        " " * 60,
        lines[_rows(lines, pick)][column:],
        RUBBISH[pick(len(RUBBISH))] * 3,
    )[pick(4)]
    return [*lines[:at], (line[:column] + text)[:140], *lines[at + 1 :]]


def lose_row(lines, others, pick):
    at = _rows(lines, pick)
    return lines[:at] + lines[at + 1 :]


def double_row(lines, others, pick):
    at = _rows(lines, pick)
    return lines[: at + 1] + lines[at:]


def change_count(lines, others, pick):
    counts = [k for k, line in enumerate(lines) if _COUNT.search(line)]
    if not counts:
        return lines
    at = counts[pick(len(counts))]
    value = COUNTS[pick(len(COUNTS))]
    return [*lines[:at], _COUNT.sub(rf"\g<1>={value}", lines[at]), *lines[at + 1 :]]


def insert_heading(lines, others, pick):
    at = pick(len(lines) + 1)
    return [*lines[:at], HEADINGS[pick(len(HEADINGS))], *lines[at:]]


def insert_rubbish(lines, others, pick):
    at = pick(len(lines) + 1)
    return [*lines[:at], RUBBISH[pick(len(RUBBISH))] * (1, 3, 50)[pick(3)], *lines[at:]]


def insert_huge(lines, others, pick):
    at = pick(len(lines))
    line, piece = (
        lines[at],
        (*RUBBISH, lines[at], " ", "A ", "1.0 ", "X(1)=", "A = ", "0.1,")[pick(len(RUBBISH) + 7)]
        or " ",
    )
    huge = line + piece * (_HUGE // len(piece))
    return [*lines[:at], huge, *lines[at + (pick(2)) :]]


def splice(lines, others, pick):
    """Go on with another listing from somewhere."""
    other = others[pick(len(others))]
    at, after = pick(len(lines)), pick(len(other))
    return lines[:at] + other[after:]


def foreign_page(lines, others, pick):
    other = others[pick(len(others))]
    first, after = _page(other, pick)
    at = pick(len(lines) + 1)
    return lines[:at] + other[first:after] + lines[at:]


def without_column_one(lines, others, pick):
    at = pick(len(lines))
    return lines[:at] + [line[1:] for line in lines[at:]]


WAYS: tuple[Way, ...] = (
    cut, lose, double, swap, lose_page, double_page, move_page, overwrite, shift, rewrite_row,
    lose_row, double_row, change_count,
    insert_heading, insert_rubbish, insert_huge, splice, foreign_page, without_column_one,
)  # fmt: skip


def harm(lines: Lines, others: list[Lines], pick: Pick, times: int) -> Lines:
    """Return the lines after some harms, one after the other."""
    for _ in range(times):
        lines = WAYS[pick(len(WAYS))](lines, others, pick) or [""]
    return lines
