"""Exact unit factors and their parser: SI inside, other units at the edges only.

Every factor is the definition (foot 0.3048 m, nautical mile 1852 m, pound 0.45359237 kg, standard gravity
9.80665 m/s2), never a rounded conversion.
"""

from __future__ import annotations

import math
import re
from functools import cache

from .errors import UnitError

FOOT = 0.3048
INCH = 0.0254
NAUTICAL_MILE = 1852.0
KNOT = NAUTICAL_MILE / 3600.0
POUND = 0.45359237
G0 = 9.80665
POUND_FORCE = POUND * G0
SLUG = POUND_FORCE / FOOT
DEGREE = math.pi / 180.0

# unit: (dimension as powers of m, kg, s, K; angles and fractions count as pure numbers), factor to SI, offset
_BASE: dict[str, tuple[tuple[int, int, int, int], float]] = {
    "1": ((0, 0, 0, 0), 1.0),
    "%": ((0, 0, 0, 0), 0.01),
    "rad": ((0, 0, 0, 0), 1.0),
    "deg": ((0, 0, 0, 0), DEGREE),
    "m": ((1, 0, 0, 0), 1.0),
    "cm": ((1, 0, 0, 0), 0.01),
    "mm": ((1, 0, 0, 0), 0.001),
    "km": ((1, 0, 0, 0), 1000.0),
    "ft": ((1, 0, 0, 0), FOOT),
    "in": ((1, 0, 0, 0), INCH),
    "nmi": ((1, 0, 0, 0), NAUTICAL_MILE),
    "s": ((0, 0, 1, 0), 1.0),
    "ms": ((0, 0, 1, 0), 0.001),
    "min": ((0, 0, 1, 0), 60.0),
    "h": ((0, 0, 1, 0), 3600.0),
    "kg": ((0, 1, 0, 0), 1.0),
    "lb": ((0, 1, 0, 0), POUND),
    "slug": ((0, 1, 0, 0), SLUG),
    "N": ((1, 1, -2, 0), 1.0),
    "daN": ((1, 1, -2, 0), 10.0),
    "lbf": ((1, 1, -2, 0), POUND_FORCE),
    "Pa": ((-1, 1, -2, 0), 1.0),
    "hPa": ((-1, 1, -2, 0), 100.0),
    "kPa": ((-1, 1, -2, 0), 1000.0),
    "psi": ((-1, 1, -2, 0), POUND_FORCE / INCH**2),
    "psf": ((-1, 1, -2, 0), POUND_FORCE / FOOT**2),
    "kt": ((1, 0, -1, 0), KNOT),
    "g": ((1, 0, -2, 0), G0),
    "Hz": ((0, 0, -1, 0), 1.0),
    "rpm": ((0, 0, -1, 0), 2.0 * math.pi / 60.0),
    "K": ((0, 0, 0, 1), 1.0),
    "degR": ((0, 0, 0, 1), 1.0 / 1.8),
    "degC": ((0, 0, 0, 1), 1.0),
    "degF": ((0, 0, 0, 1), 1.0 / 1.8),
}
# units as people write them, in lower case and singular
_SPELT = {
    "knot": "kt", "kts": "kt", "kn": "kt", "knott": "kt", "foot": "ft", "feet": "ft", "inch": "in", "inche": "in", "metre": "m",
    "meter": "m", "degree": "deg", "radian": "rad", "pound": "lb", "lbm": "lb", "kilo": "kg", "kilogram": "kg", "newton": "N",
    "pascal": "Pa", "mbar": "hPa", "second": "s", "sec": "s", "minute": "min", "hour": "h", "hertz": "Hz", "celsius": "degC",
    "c": "degC", "kelvin": "K", "percent": "%", "pct": "%", "nm": "nmi", "kmh": "km/h", "kph": "km/h", "mps": "m/s", "fps": "ft/s",
    "fpm": "ft/min",
}  # fmt: skip
_OFFSET = {"degC": 273.15, "degF": 459.67 / 1.8}
_FACTOR = re.compile(r"^(%|[A-Za-z]+|1)\^?(-?\d+)?$")


@cache
def parse(unit: str) -> tuple[tuple[int, int, int, int], float, float]:
    """Return dimension, factor and offset of a unit text such as ``"deg/s"``, ``"kg m2"`` or ``"m s-1"``.

    Returns
    -------
    dimension : tuple of int
        Powers of metre, kilogram, second and kelvin.
    factor, offset : float
        value_SI = value * factor + offset.

    Raises
    ------
    UnitError
        Unknown unit, or a temperature with an offset inside a product.
    """
    text = unit.strip() or "1"
    if text in _OFFSET:
        return _BASE[text][0], _BASE[text][1], _OFFSET[text]
    dimension, factor = [0, 0, 0, 0], 1.0
    for i, part in enumerate(text.split("/")):
        for word in re.split(r"[ *.]+", part.strip()):
            match = _FACTOR.match(word)
            name, power = (match.group(1), int(match.group(2) or 1)) if match else ("", 0)
            if name not in _BASE:
                near = _near(word)
                known = f"known are {', '.join(sorted(_BASE))} and products, powers and quotients of them"
                raise UnitError(f"unknown unit {unit!r}; " + (f"near it: {near}" if near else known))
            if name in _OFFSET:
                raise UnitError(f"unit {unit!r}: {name} has an offset and cannot stand in a product; use K")
            if i:
                power = -power
            dimension = [d + power * e for d, e in zip(dimension, _BASE[name][0], strict=True)]
            factor *= _BASE[name][1] ** power
    return (dimension[0], dimension[1], dimension[2], dimension[3]), factor, 0.0


def _near(word: str) -> str:
    """Return the unit that a word stands for or resembles, or nothing."""
    from difflib import get_close_matches

    lower = word.lower()
    power = "2" if lower.startswith("sq") else "3" if lower.startswith("cu") else ""
    plain = lower.removeprefix("sq").removeprefix("cu") if power else lower
    name = _SPELT.get(plain) or _SPELT.get(plain.removesuffix("s"))
    if name:
        return name + power
    if plain in _BASE:
        return plain + power
    return ", ".join(get_close_matches(word, _BASE, n=3, cutoff=0.6))


def to_si(value, unit: str, expected: str | None = None):
    """Convert `value` in `unit` to SI; with `expected` (an SI unit) the dimensions must agree.

    Examples
    --------
    >>> to_si(1000.0, "ft", "m")
    304.8
    >>> to_si(15.0, "degC")
    288.15
    """
    dimension, factor, offset = parse(unit)
    if expected is not None and dimension != parse(expected)[0]:
        raise UnitError(f"unit {unit!r} cannot be converted to {expected!r}; give a unit of the same quantity")
    return value * factor + offset


def from_si(value, unit: str):
    """Convert an SI `value` to `unit`, the inverse of `to_si`."""
    _, factor, offset = parse(unit)
    return (value - offset) / factor


_QUANTITY = re.compile(r"^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*$")


def quantity(text: str | float | int, expected: str) -> float:
    """Return the SI value of a TOML entry: a bare number is SI, a string carries its unit.

    Parameters
    ----------
    text : str or number
        ``"1.5 deg"``, ``"4000 ft"``, or a number in SI.
    expected : str
        SI unit of the quantity, for the dimension check.

    Examples
    --------
    >>> round(quantity("1.5 deg", "rad"), 6)
    0.02618
    >>> quantity(3, "m")
    3.0
    """
    if isinstance(text, bool):
        raise UnitError(f"found {text!r}; expected a number in {expected} or a text with a unit such as '1.5 {expected}'")
    if isinstance(text, int | float):
        return float(text)
    match = _QUANTITY.match(text) if isinstance(text, str) else None
    if not match or not match.group(2):
        raise UnitError(f"found {text!r}; expected a number and a unit such as '1.5 {expected}', or a bare number in {expected}")
    return float(to_si(float(match.group(1)), match.group(2), expected))
