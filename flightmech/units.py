"""Exact unit factors and their parser: SI inside, other units at the edges only.

Every factor is the definition (foot 0.3048 m, nautical mile 1852 m, pound 0.45359237 kg, standard
gravity 9.80665 m/s2), never a rounded conversion.
"""

from __future__ import annotations

import math
import re
from difflib import get_close_matches
from functools import cache

from flightmech.errors import UnitError

FOOT = 0.3048
INCH = 0.0254
MILE = 5280.0 * FOOT
NAUTICAL_MILE = 1852.0
KNOT = NAUTICAL_MILE / 3600.0
POUND = 0.45359237
G0 = 9.80665
POUND_FORCE = POUND * G0
SLUG = POUND_FORCE / FOOT
DEGREE = math.pi / 180.0
MERCURY = 13595.1 * G0  # Pa in a metre of mercury at 0 degC

# unit: (dimension as powers of m, kg, s, K; angles and fractions count as pure numbers), factor to
# SI, offset
_BASE: dict[str, tuple[tuple[int, int, int, int], float]] = {
    "1": ((0, 0, 0, 0), 1.0),
    "%": ((0, 0, 0, 0), 0.01),
    "rad": ((0, 0, 0, 0), 1.0),
    "deg": ((0, 0, 0, 0), DEGREE),
    "mrad": ((0, 0, 0, 0), 0.001),
    "m": ((1, 0, 0, 0), 1.0),
    "cm": ((1, 0, 0, 0), 0.01),
    "mm": ((1, 0, 0, 0), 0.001),
    "km": ((1, 0, 0, 0), 1000.0),
    "mi": ((1, 0, 0, 0), MILE),
    "ft": ((1, 0, 0, 0), FOOT),
    "in": ((1, 0, 0, 0), INCH),
    "nmi": ((1, 0, 0, 0), NAUTICAL_MILE),
    "s": ((0, 0, 1, 0), 1.0),
    "ms": ((0, 0, 1, 0), 0.001),
    "us": ((0, 0, 1, 0), 1e-6),
    "ns": ((0, 0, 1, 0), 1e-9),
    "min": ((0, 0, 1, 0), 60.0),
    "h": ((0, 0, 1, 0), 3600.0),
    "kg": ((0, 1, 0, 0), 1.0),
    "lb": ((0, 1, 0, 0), POUND),
    "slug": ((0, 1, 0, 0), SLUG),
    "N": ((1, 1, -2, 0), 1.0),
    "daN": ((1, 1, -2, 0), 10.0),
    "kN": ((1, 1, -2, 0), 1000.0),
    "kgf": ((1, 1, -2, 0), G0),
    "lbf": ((1, 1, -2, 0), POUND_FORCE),
    "Pa": ((-1, 1, -2, 0), 1.0),
    "hPa": ((-1, 1, -2, 0), 100.0),
    "kPa": ((-1, 1, -2, 0), 1000.0),
    "MPa": ((-1, 1, -2, 0), 1e6),
    "bar": ((-1, 1, -2, 0), 1e5),
    "inHg": ((-1, 1, -2, 0), MERCURY * INCH),
    "mmHg": ((-1, 1, -2, 0), MERCURY * 0.001),
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
# units as recorders and people write them, in lower case: the one list of the product
_SPELT = {
    "knot": "kt", "knots": "kt", "kts": "kt", "kn": "kt", "kias": "kt", "kcas": "kt", "ktas": "kt", "keas": "kt", "kgs": "kt",
    "foot": "ft", "feet": "ft", "inch": "in", "inches": "in", "metre": "m", "metres": "m", "meter": "m", "meters": "m",
    "nm": "nmi", "sm": "mi", "mile": "mi", "miles": "mi", "mph": "mi/h", "kmh": "km/h", "kph": "km/h", "mps": "m/s", "fps": "ft/s",
    "fpm": "ft/min", "degree": "deg", "degrees": "deg", "radian": "rad", "radians": "rad", "dps": "deg/s", "degps": "deg/s",
    "radps": "rad/s", "mps2": "m/s2", "fps2": "ft/s2", "pound": "lb", "pounds": "lb", "lbs": "lb", "lbm": "lb", "slugs": "slug",
    "kilogram": "kg", "kilograms": "kg", "kgm": "kg", "newton": "N", "newtons": "N", "kilonewton": "kN", "lbsf": "lbf", "lbfs": "lbf",
    "pascal": "Pa", "pascals": "Pa", "mbar": "hPa", "mbars": "hPa", "mb": "hPa", "millibar": "hPa", "millibars": "hPa", "psia": "psi",
    "psid": "psi", "psig": "psi", "second": "s", "seconds": "s", "sec": "s", "secs": "s", "msec": "ms", "msecs": "ms", "usec": "us",
    "minute": "min", "minutes": "min", "mins": "min", "hour": "h", "hours": "h", "hr": "h", "hrs": "h", "hertz": "Hz",
    "celsius": "degC", "fahrenheit": "degF", "rankine": "degR", "kelvin": "K", "percent": "%", "pct": "%", "prc": "%", "pph": "lb/h",
    "lbph": "lb/h", "gs": "g", "g's": "g", "gee": "g", "gees": "g", "-": "1", "--": "1", "none": "1", "nd": "1", "n/d": "1",
    **dict.fromkeys(("g0", "gn"), "g"),
    **dict.fromkeys(("r/min", "rev/min", "revs/min", "rpms", "r.p.m", "u/min"), "rpm"),
    **dict.fromkeys(("% rpm", "%rpm", "% n1", "%n1", "% n2", "%n2", "% open", "% mac", "%mac", "per cent"), "%"),
    **dict.fromkeys(("degs",), "deg"), **dict.fromkeys(("rads",), "rad"),
    **dict.fromkeys(("ft msl", "ft agl", "ft amsl", "feet msl", "feet agl", "ft qnh"), "ft"),
    **dict.fromkeys(("m msl", "m agl", "m amsl"), "m"), "ft/mn": "ft/min", "kilonewtons": "kN",
    **dict.fromkeys(("ms-1", "ms^-1"), "m/s"), **dict.fromkeys(("ms-2", "ms^-2"), "m/s2"), "degs-1": "deg/s", "rads-1": "rad/s",
    **dict.fromkeys(("millisecond", "milliseconds", "millisec"), "ms"), **dict.fromkeys(("microsecond", "microseconds"), "us"),
    "degrees c": "degC", "degrees f": "degF", "centigrade": "degC", "kgph": "kg/h", "kmph": "km/h", "km/h": "km/h", "kg/h": "kg/h",
    "lb/h": "lb/h", "unitless": "1", "dimensionless": "1", "nondim": "1", "ratio": "1", "fraction": "1", "bool": "1", "boolean": "1", "mach": "1",
}  # fmt: skip
# the same, where the letter case decides or blanks, dots and hyphens stand between
_CASED = {
    "Nm": "N m",
    "NM": "nmi",
    "G": "g",
    "M": "m",
    "S": "s",
    "C": "degC",
    "F": "degF",
    "µs": "us",
    "μs": "us",
}
_WHOLE = {
    **{f"deg{letter}": f"deg{letter.upper()}" for letter in "cfr"},
    **dict.fromkeys(("inhg", "inchhg", "incheshg", "inchesofmercury"), "inHg"),
    **dict.fromkeys(("mmhg", "torr"), "mmHg"),
    **dict.fromkeys(("ftlb", "lbft", "ftlbf", "lbfft", "ftlbs", "lbsft"), "lbf ft"),
    **dict.fromkeys(("inlb", "lbin", "inlbf", "lbfin", "inlbs"), "lbf in"),
}
_UNCERTAIN = {"KN": "kN or kt"}
# misspelt units that errors explain
_MISSPELT = {"knott": "kt", "inche": "in", "kilo": "kg", "kmp": "km", "c": "degC", "n": "N"}
_SIGNS = {
    "℃": "degC", "℉": "degF", "°": "deg", "º": "deg", "˚": "deg", "⁻": "-", "−": "-", "¹": "1", "²": "2", "³": "3", "·": " ",
    "⋅": " ", "×": " ", "**": "", "^": "", "’": "'", "′": "'",
}  # fmt: skip
# capitals of a heading, DEG or HPA; not KN, which may be knots or kilonewtons, nor MS
_LOWER = {name.lower(): name for name in _BASE if len(name) > 1 and name not in ("kN", "ms", "MPa")}
_OFFSET = {"degC": 273.15, "degF": 459.67 / 1.8}
_FACTOR = re.compile(r"^(%|[A-Za-z]+|1(?!\d))\^?(-?\d+)?$")
_TENS = re.compile(r"^x?(10+)(?= *[A-Za-z])")  # 100 ft, x1000 lb: a multiple of a unit


@cache
def known_unit(text: str) -> str:
    """Return a unit as `parse_unit` spells it; a text that means no unit is returned without its blanks.

    Parameters
    ----------
    text : str
        As recorders and people write it, with or without brackets.

    Examples
    --------
    >>> known_unit("°/sec"), known_unit("m/s^2"), known_unit("KIAS"), known_unit("slug-ft²"), known_unit("lbs")
    ('deg/s', 'm/s2', 'kt', 'slug ft2', 'lb')
    """
    plain = text.strip().removesuffix(".")
    if len(plain) > 1 and (plain[0], plain[-1]) in (("[", "]"), ("(", ")")):
        plain = plain[1:-1].strip()
    if plain in _BASE or plain in _UNCERTAIN:
        return plain
    if tens := _TENS.match(plain):
        return f"{tens[1]} {known_unit(plain[tens.end() :])}"
    if spelt := _CASED.get(plain) or _SPELT.get(plain.lower()):
        return spelt
    for sign, letters in _SIGNS.items():
        plain = plain.replace(sign, letters)
    if spelt := _SPELT.get(plain.lower()):
        return spelt
    if all(word in _BASE for word in plain.split()):
        return " ".join(plain.split())  # in lb: a moment of mass; in-lb: a moment of force
    if spelt := _WHOLE.get(re.sub(r"[ .*-]+", "", plain).lower()):
        return spelt
    plain = re.sub(r"\s+per\s+", "/", plain)
    plain = re.sub(r"(?<=[A-Za-z2-4])-(?=[A-Za-z])", " ", plain)  # slug-ft2, but not the power s-1
    parts = []
    for part in plain.split("/"):
        words = [_known_word(word) for word in re.split(r"[ *.]+", part.strip())]
        if None in words:
            return text.strip()
        parts.append(" ".join(str(word) for word in words))
    return "/".join(parts)


def _known_word(word: str) -> str | None:
    """Return one factor of a unit as `parse_unit` spells it, None for a word that is no unit."""
    match = _FACTOR.match(word)
    if match is None:
        return None
    name, power = match.group(1), match.group(2) or ""
    lower = name.lower()
    if name in _UNCERTAIN:
        return None
    spelt = name if name in _BASE else _CASED.get(name) or _SPELT.get(lower) or _LOWER.get(lower)
    # a quotient such as fps cannot take a power, nor stand behind a slash
    return f"{spelt}{power}" if spelt in _BASE or (spelt and not power) else None


def fitted_unit(text: str, expected: str) -> str:
    """Return a unit as `known_unit` does; what it means by itself or not is settled by the quantity.

    A pound is one of force for a force, its moment or a pressure, and one of mass for a mass, its
    moment or a flow; ``kph`` is kg/h for a flow; ``1/min`` of a rotation is a revolution per minute.

    Parameters
    ----------
    text : str
    expected : str
        SI unit of the quantity.

    Examples
    --------
    >>> fitted_unit("lbs", "N"), fitted_unit("lbf", "kg"), fitted_unit("ft lb", "N m"), fitted_unit("in-lb", "kg m")
    ('lbf', 'lb', 'ft lbf', 'lb in')
    >>> fitted_unit("lb/in2", "Pa"), fitted_unit("1/min", "rad s-1"), fitted_unit("kph", "kg s-1")
    ('lbf/in2', 'rpm', 'kg/h')
    """
    unit = known_unit(text)
    if expected == "rad s-1" and unit in ("1/min", "min-1"):
        return "rpm"
    if expected == "kg s-1" and text.strip().lower() == "kph":
        return "kg/h"
    if expected == "Pa" and re.match(r"lb/(in|ft)2$", unit):
        return unit.replace("lb", "lbf")
    pound = {"N": "lbf", "N m": "lbf", "kg": "lb", "kg m": "lb"}.get(expected)
    words = unit.split()
    if pound is None or not {"lb", "lbf"} & set(words) or set(words) - {"lb", "lbf", "ft", "in"}:
        return unit
    return " ".join(pound if word in ("lb", "lbf") else word for word in words)


@cache
def parse_unit(unit: str) -> tuple[tuple[int, int, int, int], float, float]:
    """Return dimension, factor and offset of a unit text such as ``"deg/s"``, ``"kg m2"`` or ``"m
    s-1"``.

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
    text = known_unit(unit) or "1"
    if text in _OFFSET:
        return _BASE[text][0], _BASE[text][1], _OFFSET[text]
    dimension, factor = [0, 0, 0, 0], 1.0
    if tens := _TENS.match(text):
        factor, text = float(tens[1]), text[tens.end() :].strip()
    for i, part in enumerate(text.split("/")):
        for word in re.split(r"[ *.]+", part.strip()):
            match = _FACTOR.match(word)
            name, power = (match.group(1), int(match.group(2) or 1)) if match else ("", 0)
            if name not in _BASE:
                near = _near(word)
                known = (
                    f"known are {', '.join(sorted(_BASE))} and products, powers and "
                    f"quotients of them"
                )
                raise UnitError(
                    f"unknown unit {unit!r}; " + (f"near it: {near}" if near else known)
                )
            if name in _OFFSET:
                raise UnitError(
                    f"unit {unit!r}: {name} has an offset and cannot stand in a product; use K"
                )
            if i:
                power = -power
            dimension = [d + power * e for d, e in zip(dimension, _BASE[name][0], strict=True)]
            factor *= _BASE[name][1] ** power
    return (dimension[0], dimension[1], dimension[2], dimension[3]), factor, 0.0


def _near(word: str) -> str:
    """Return the unit that a word stands for or resembles, or nothing."""

    if word in _UNCERTAIN:
        return _UNCERTAIN[word]
    lower = word.lower()
    power = "2" if lower.startswith("sq") else "3" if lower.startswith("cu") else ""
    plain = lower.removeprefix("sq").removeprefix("cu") if power else lower
    names = {**_SPELT, **_MISSPELT}
    name = names.get(plain) or names.get(plain.removesuffix("s"))
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
    dimension, factor, offset = parse_unit(unit)
    if expected is not None and dimension != parse_unit(expected)[0]:
        raise UnitError(
            f"unit {unit!r} cannot be converted to {expected!r}; give a unit of the same quantity"
        )
    return value * factor + offset


def from_si(value, unit: str):
    """Convert an SI `value` to `unit`, the inverse of `to_si`."""
    _, factor, offset = parse_unit(unit)
    return (value - offset) / factor


_QUANTITY = re.compile(r"^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*$")


def parse_quantity(text: str | float | int, expected: str) -> float:
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
        raise UnitError(
            f"found {text!r}; expected a number in {expected} or a text with a unit such as "
            f"'1.5 {expected}'"
        )
    if isinstance(text, int | float):
        return float(text)
    match = _QUANTITY.match(text) if isinstance(text, str) else None
    if not match or not match.group(2):
        raise UnitError(
            f"found {text!r}; expected a number and a unit such as '1.5 {expected}', or a "
            f"bare number in {expected}"
        )
    return float(to_si(float(match.group(1)), match.group(2), expected))
