"""Numbers with units in texts and in arguments of calls, as SI values."""

from __future__ import annotations

import math
import re
from typing import Any

from flightmech.errors import UnitError
from flightmech.units import to_si

_COMMA = re.compile(r"\s*[-+]?\d+,\d")
_QUANTITY = re.compile(r"^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*$")


def finite_number(text: str) -> float:
    """Return the number of a text; ValueError for any other text, also for nan, inf and 1e999."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def number_or_text(text: str) -> float | str:
    """Return a bare number as one, which is SI for `parse_quantity`; a text with a unit stays."""
    try:
        return finite_number(text)
    except ValueError:
        return text


def option_quantity(option: str, text: str | float, expected: str) -> float:
    """Return the SI value of an option of a command: a bare number is SI, a text has its unit.

    Parameters
    ----------
    option : str
        Name of the option, for an error.
    text : str or number
        Such as ``"8.95"``, ``"8.95 m"``.
    expected : str
        SI unit of the quantity.

    Raises
    ------
    UnitError
        With the name of the option.

    Examples
    --------
    >>> option_quantity("--station", "8.95", "m")
    8.95
    """
    try:
        return parse_quantity(number_or_text(text) if isinstance(text, str) else text, expected)
    except UnitError as error:
        raise UnitError(f"{option}: {error}") from error


def parse_quantity(text: str | float | int, expected: str) -> float:
    """Return the SI value of a TOML entry. A bare number is SI, a text has its unit.

    Parameters
    ----------
    text : str or number
        ``"1.5 deg"``, ``"4000 ft"``, or a number in SI.
    expected : str
        SI unit of the quantity, for the check of the dimension.

    Examples
    --------
    >>> round(parse_quantity("1.5 deg", "rad"), 6)
    0.02618
    >>> parse_quantity(3, "m")
    3.0
    """
    # bool is a subclass of int
    if isinstance(text, bool):
        raise UnitError(
            f"found {text!r}; expected a number in {expected} or a text with a unit such as "
            f"'1.5 {expected}'"
        )
    if isinstance(text, int | float):
        return float(text)
    comma = ""
    if isinstance(text, str) and _COMMA.match(text):
        comma = "; a decimal comma is not read, write a point"
    match = _QUANTITY.match(text) if isinstance(text, str) else None
    if comma or not match or not match.group(2):
        raise UnitError(
            f"found {text!r}; expected a number and a unit such as '1.5 {expected}', or a "
            f"bare number in {expected}{comma}"
        )
    value = float(to_si(float(match.group(1)), match.group(2), expected))
    if math.isinf(value):
        raise UnitError(f"found {text!r}, which is infinite; give a finite number")
    return value


def value_in_si(value: Any, expected: str, name: str = "") -> Any:
    """Return an argument of a call in SI: a text has its unit, as in the files; a number is SI.

    Parameters
    ----------
    value : str, number or array
        Only a text is converted.
    expected : str
        SI unit of the quantity, for the check of the dimension.
    name : str
        Name of the argument in an error.

    Raises
    ------
    UnitError
        A text that is not a number with a unit of this dimension.

    Examples
    --------
    >>> round(value_in_si("240 kt", "m s-1", "V_cas"), 3)
    123.467
    >>> value_in_si(90.0, "m s-1")
    90.0
    """
    if not isinstance(value, str):
        return value
    try:
        return parse_quantity(value, expected)
    except UnitError as error:
        raise UnitError(f"{name} = {value!r}: {error}" if name else str(error)) from error


def time_text(time: float, digits: int = 6) -> str:
    """Return a time on the clock of a record as text. [s]

    A clock of seconds of the day, the week or the year has more digits than a duration: from 10 000
    s on the text has two decimals.

    Parameters
    ----------
    time : float
        Time. [s]
    digits : int
        Significant digits of a smaller time.

    Examples
    --------
    >>> time_text(12.25), time_text(20945707.45), time_text(36907.4)
    ('12.25', '20945707.45', '36907.4')
    """
    if abs(time) < 1e4:
        return f"{time:.{digits}g}"
    return f"{time:.2f}".rstrip("0").rstrip(".")
