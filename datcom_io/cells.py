"""Reading of one printed field as a number and a flag.

The program keeps three sentinels for missing numbers: 1E-30, 2E-30 and -1E-30.  Its formatter
prints them as the words ``NDM`` and ``NA`` and as a blank.  Pages written without that formatter
print them as numbers.  A field that is too narrow prints asterisks.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np

OK, NDM, NA, BLANK, FILLED, OVERFLOW, NOT_A_NUMBER, SENTINEL, ABSENT, SUSPECT = range(10)

FLAGS = ("ok", "NDM", "NA", "blank", "filled", "overflow", "nan", "sentinel", "absent", "suspect")
"""Meaning of the flag codes 0 ... 9.

``ok`` a number; ``NDM`` no DATCOM method; ``NA`` method not applicable; ``blank`` nothing printed;
``filled`` taken from the first row of a column that is constant in alpha; ``overflow`` asterisks;
``nan`` the arithmetic of the program failed; ``sentinel`` a code for a missing number, printed as
a number; ``absent`` no such row or page in the listing; ``suspect`` a number that a known fault of
the program makes wrong, for example by what it carries over from the deflection before.
"""

# Bound of a sentinel times a unit factor; the largest one seen is 3.2808E-30.
_LARGEST_SENTINEL = 1.0001e-28
# A number with D as exponent letter, or without a letter: 5.800-002.
_NO_LETTER = re.compile(r"([-+]?(?:\d+(?:\.\d*)?|\.\d+))(?:[Dd]([-+]?\d+)|([-+]\d+))")
# NaN and infinity as some compilers print them: -1.#IND, 1.#QNAN.
_FAILED = re.compile(r"[-+]?(?:\d*\.?#(?:IND|QNAN|SNAN|INF)\d*|1\.#\w+)", re.IGNORECASE)
_WORDS = {"": BLANK, "NDM": NDM, "NA": NA}


def is_number_flag(flags: np.ndarray) -> np.ndarray:
    """Return where flags are those of cells that print a number: ``ok`` or ``suspect``."""
    return (flags == OK) | (flags == SUSPECT)


def read_cell(text: str) -> tuple[float, int] | None:
    """Return value and flag of a printed field.

    The result is None when the field is neither a number nor one of the words of the program.

    Examples
    --------
    >>> read_cell("  -.021"), read_cell(" 5.800-002"), read_cell(" NDM ")[1], read_cell("******")[1]
    ((-0.021, 0), (0.058, 0), 1, 5)
    """
    try:
        value = float(text)
    except ValueError:
        return _read_word(text.strip())
    if not math.isfinite(value):
        return value, NOT_A_NUMBER
    if -_LARGEST_SENTINEL < value < _LARGEST_SENTINEL and value != 0.0:
        return value, SENTINEL
    return value, OK


def read_cells(texts: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return values and flags of many fields, each as `read_cell` does.

    A text that is not a cell gets NaN and ``ok``.
    """
    numbers: list[float] = []
    word_indices: list[int] = []
    pending = iter(texts)
    # map(float, ...) stops at the first word; the loop notes its index and goes on behind it.
    while len(numbers) < len(texts):
        try:
            # One append for each number keeps the numbers before a word.
            for number in map(float, pending):
                numbers.append(number)
        except ValueError:
            word_indices.append(len(numbers))
            numbers.append(0.0)
    values, flags = np.array(numbers, float), np.zeros(len(numbers), np.uint8)
    flags[(np.abs(values) < _LARGEST_SENTINEL) & (values != 0.0)] = SENTINEL
    flags[~np.isfinite(values)] = NOT_A_NUMBER
    for i in word_indices:
        values[i], flags[i] = _read_word(texts[i].strip()) or (math.nan, OK)
    return values, flags


def _read_word(word: str) -> tuple[float, int] | None:
    """Return value and flag of a field that float() rejects."""
    if word in _WORDS:
        return math.nan, _WORDS[word]
    if not word.strip("*"):
        return math.nan, OVERFLOW
    number = _NO_LETTER.fullmatch(word)
    if number:
        return read_cell(f"{number[1]}e{number[2] or number[3]}")
    if _FAILED.fullmatch(word):
        return math.nan, NOT_A_NUMBER
    return None
