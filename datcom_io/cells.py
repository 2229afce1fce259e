"""One printed field to a number and a flag.

The program keeps three sentinels, 1E-30, 2E-30 and -1E-30, which a formatter turns into the words
``NDM`` and ``NA`` and into a blank; pages written without that formatter leak them as numbers.  A
field that is too narrow prints asterisks.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np

OK, NDM, NA, BLANK, FILLED, OVERFLOW, NOT_A_NUMBER, SENTINEL, ABSENT, SUSPECT = range(10)

FLAGS = ("ok", "NDM", "NA", "blank", "filled", "overflow", "nan", "sentinel", "absent", "suspect")
"""Meaning of the flag codes 0 ... 9.

``ok`` a number; ``NDM`` no DATCOM method; ``NA`` method not applicable; ``blank`` nothing printed; ``filled`` taken from the
first row of a column that is constant in alpha; ``overflow`` asterisks; ``nan`` the program's arithmetic failed;
``sentinel`` the program's code for a missing number, printed as a number; ``absent`` no such row or page in the listing;
``suspect`` a number that a known fault of the program makes wrong, for example by what it carries over from the deflection before.
"""

_LARGEST_SENTINEL = 1.0001e-28  # a sentinel times a unit factor: 3.2808E-30 is seen
_NO_LETTER = re.compile(r"([-+]?(?:\d+(?:\.\d*)?|\.\d+))(?:[Dd]([-+]?\d+)|([-+]\d+))")
_FAILED = re.compile(r"[-+]?(?:\d*\.?#(?:IND|QNAN|SNAN|INF)\d*|1\.#\w+)", re.IGNORECASE)
_WORDS = {"": BLANK, "NDM": NDM, "NA": NA}


def is_number_flag(flags: np.ndarray) -> np.ndarray:
    """Return where flags are those of cells that print a number: ``ok`` or ``suspect``."""
    return (flags == OK) | (flags == SUSPECT)


def read_cell(text: str) -> tuple[float, int] | None:
    """Return value and flag of a printed field; None when it is neither a number nor one of the
    program's words.

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
    """Return values and flags of many fields, each as `read_cell` does; NaN and ``ok`` where a text
    is no cell.
    """
    values: list[float] = []
    words: list[int] = []
    rest = iter(texts)
    while len(values) < len(texts):
        try:
            for value in map(float, rest):
                values.append(value)  # one by one: those before a word are kept
        except ValueError:
            words.append(len(values))
            values.append(0.0)
    found, flags = np.array(values, float), np.zeros(len(values), np.uint8)
    flags[(np.abs(found) < _LARGEST_SENTINEL) & (found != 0.0)] = SENTINEL
    flags[~np.isfinite(found)] = NOT_A_NUMBER
    for i in words:
        found[i], flags[i] = _read_word(texts[i].strip()) or (math.nan, OK)
    return found, flags


def _read_word(word: str) -> tuple[float, int] | None:
    if word in _WORDS:
        return math.nan, _WORDS[word]
    if not word.strip("*"):
        return math.nan, OVERFLOW
    if number := _NO_LETTER.fullmatch(word):
        return read_cell(f"{number[1]}e{number[2] or number[3]}")
    if _FAILED.fullmatch(word):
        return math.nan, NOT_A_NUMBER
    return None
