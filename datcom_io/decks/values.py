"""Values of a namelist: how the program reads numbers and logicals, and how they are written for it.

The program gathers the digits on each side of the decimal point in 32-bit integers and computes in single precision.  Nine
digits therefore hold everything it can distinguish, and more than nine can overflow (source of January 1996, routine TODEC).
"""

from __future__ import annotations

import re
from functools import lru_cache

from ..cells import OK, read_cell

Value = float | bool
DIGITS = 9  # significant digits that identify any number of single precision
_LARGEST_INTEGER = 2**31 - 1
_LARGEST_REPEAT = 300
_LARGEST = 3.4e38  # of single precision
_SHOWN = 40  # characters of a value that a message shows
_REPEAT = re.compile(r"(\d{1,4}) ?\* ?(.+)")
_NUMBER = re.compile(r"[-+]?(\d*)(?:(\.)(\d*))?(?:(E)[-+]?\d{1,3})?")
_LOGICAL = re.compile(r"\.([TF])[A-Z]*\.?|([TF])|TRUE|FALSE")
_LOGICAL_FORMS = (".TRUE.", ".FALSE.", ".T.", ".F.")


def read_values(text: str) -> tuple[tuple[Value, ...], list[tuple[str, str]]]:
    """Read one value with its repeat count, ``3*2.0``.

    Returns
    -------
    values : tuple
        Empty when it is no value.
    complaints : list of (str, str)
        Severity and text of what the program would not read as it is meant.

    Examples
    --------
    >>> read_values("3*2.0"), read_values(".TRUE.")
    (((2.0, 2.0, 2.0), []), ((True,), []))
    """
    repeat = _REPEAT.fullmatch(text)
    count, word = (int(repeat[1]), repeat[2].strip()) if repeat else (1, text)
    if not 0 < count <= _LARGEST_REPEAT:
        return (), [("error", f"has the repeat count {count}; allowed is 1 ... {_LARGEST_REPEAT}")]
    value, severity, complaint = _known(word) if len(word) <= _LONGEST_KNOWN else _read(word)
    return (() if value is None else (value,) * count), [(severity, complaint)] if complaint else []


def _read(word: str) -> tuple[Value | None, str, str]:
    if _LOGICAL.fullmatch(word):
        problem = "" if word in _LOGICAL_FORMS else f"has the value {word}; the program knows .TRUE. and .FALSE. with both points"
        return "T" in word[:2], "error", problem
    number = _NUMBER.fullmatch(word)
    if number and (number[1] or number[3]):
        value = float(word)
        if abs(value) > _LARGEST:
            return None, "error", f"has the value {_short(word)}, which is too large"
        if any(_overflows(digits or "") for digits in (number[1], number[3])):
            problem = f"has the value {_short(word)}: too many digits, the program's integers overflow; write {DIGITS} digits"
            return value, "error", problem
        return value, "warning", "" if number[2] else f"has the value {word} without a point; the program uses it and flags a syntax error"
    if " " in word:
        joined, severity, problem = _read(word.replace(" ", ""))
        return joined, severity if problem else "warning", problem or f"has the value {word!r} with a blank in it"
    cell = read_cell(word)
    if cell and cell[1] == OK and abs(cell[0]) <= _LARGEST:
        return cell[0], "error", f"has the value {word}; the program reads only E exponents in upper case"
    return None, "error", f"has the value {_short(word)!r}, which is no number"


_known = lru_cache(4096)(_read)  # a run prints its cards once for the job and once for every case
_LONGEST_KNOWN = 24


def _overflows(digits: str) -> bool:
    significant = digits.lstrip("0")
    return len(significant) > DIGITS + 1 or int(significant or 0) > _LARGEST_INTEGER


def _short(word: str) -> str:
    return word if len(word) <= _SHOWN else f"{word[:_SHOWN]}..."


def value_text(value: Value) -> str:
    """Return a value as the program reads it, with nine significant digits.

    Examples
    --------
    >>> [value_text(x) for x in (2.0, -0.021, 1.0e-5, 4.0e6, 1.0e12, True)]
    ['2.0', '-0.021', '1.0E-5', '4000000.0', '1.0E12', '.TRUE.']
    """
    if isinstance(value, bool):
        return ".TRUE." if value else ".FALSE."
    mantissa, letter, exponent = f"{value:.{DIGITS}g}".partition("e")
    if "." not in mantissa:
        mantissa += ".0"
    return mantissa + (f"E{int(exponent)}" if letter else "")
