"""Exact unit factors, and a parser of units. The product computes in SI units.

Every factor is the definition of the unit (foot 0.3048 m, nautical mile 1852 m, pound
0.45359237 kg, standard gravity 9.80665 m/s2), not a rounded conversion.
"""

from __future__ import annotations

import math
import re
from difflib import get_close_matches
from functools import cache
from typing import Any

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
# pressure of a metre of mercury at 0 degC [Pa m-1]
MERCURY = 13595.1 * G0

Powers = tuple[int, int, int, int, int]
"""Powers of metre, kilogram, second, kelvin and ampere."""

# By unit: dimension, and factor to SI. Angles and fractions are pure numbers.
_BASE: dict[str, tuple[Powers, float]] = {
    "1": ((0, 0, 0, 0, 0), 1.0),
    "%": ((0, 0, 0, 0, 0), 0.01),
    "rad": ((0, 0, 0, 0, 0), 1.0),
    "deg": ((0, 0, 0, 0, 0), DEGREE),
    "mrad": ((0, 0, 0, 0, 0), 0.001),
    "rev": ((0, 0, 0, 0, 0), 2.0 * math.pi),
    "m": ((1, 0, 0, 0, 0), 1.0),
    "cm": ((1, 0, 0, 0, 0), 0.01),
    "mm": ((1, 0, 0, 0, 0), 0.001),
    "km": ((1, 0, 0, 0, 0), 1000.0),
    "mi": ((1, 0, 0, 0, 0), MILE),
    "ft": ((1, 0, 0, 0, 0), FOOT),
    "in": ((1, 0, 0, 0, 0), INCH),
    "nmi": ((1, 0, 0, 0, 0), NAUTICAL_MILE),
    "s": ((0, 0, 1, 0, 0), 1.0),
    "ms": ((0, 0, 1, 0, 0), 0.001),
    "us": ((0, 0, 1, 0, 0), 1e-6),
    "ns": ((0, 0, 1, 0, 0), 1e-9),
    "min": ((0, 0, 1, 0, 0), 60.0),
    "h": ((0, 0, 1, 0, 0), 3600.0),
    "kg": ((0, 1, 0, 0, 0), 1.0),
    "lb": ((0, 1, 0, 0, 0), POUND),
    "slug": ((0, 1, 0, 0, 0), SLUG),
    "N": ((1, 1, -2, 0, 0), 1.0),
    "daN": ((1, 1, -2, 0, 0), 10.0),
    "kN": ((1, 1, -2, 0, 0), 1000.0),
    "kgf": ((1, 1, -2, 0, 0), G0),
    "lbf": ((1, 1, -2, 0, 0), POUND_FORCE),
    "Pa": ((-1, 1, -2, 0, 0), 1.0),
    "hPa": ((-1, 1, -2, 0, 0), 100.0),
    "kPa": ((-1, 1, -2, 0, 0), 1000.0),
    "MPa": ((-1, 1, -2, 0, 0), 1e6),
    "bar": ((-1, 1, -2, 0, 0), 1e5),
    "inHg": ((-1, 1, -2, 0, 0), MERCURY * INCH),
    "mmHg": ((-1, 1, -2, 0, 0), MERCURY * 0.001),
    "psi": ((-1, 1, -2, 0, 0), POUND_FORCE / INCH**2),
    "psf": ((-1, 1, -2, 0, 0), POUND_FORCE / FOOT**2),
    "kt": ((1, 0, -1, 0, 0), KNOT),
    "g": ((1, 0, -2, 0, 0), G0),
    "Hz": ((0, 0, -1, 0, 0), 1.0),
    "W": ((2, 1, -3, 0, 0), 1.0),
    "kW": ((2, 1, -3, 0, 0), 1000.0),
    "hp": ((2, 1, -3, 0, 0), 550.0 * FOOT * POUND_FORCE),
    "A": ((0, 0, 0, 0, 1), 1.0),
    "Ah": ((0, 0, 1, 0, 1), 3600.0),
    "mAh": ((0, 0, 1, 0, 1), 3.6),
    "V": ((2, 1, -3, 0, -1), 1.0),
    "ohm": ((2, 1, -3, 0, -2), 1.0),
    "rpm": ((0, 0, -1, 0, 0), 2.0 * math.pi / 60.0),
    "K": ((0, 0, 0, 1, 0), 1.0),
    "degR": ((0, 0, 0, 1, 0), 1.0 / 1.8),
    "degC": ((0, 0, 0, 1, 0), 1.0),
    "degF": ((0, 0, 0, 1, 0), 1.0 / 1.8),
}
# Other spellings in lower case, as recorders and people write them. Other modules use this list.
_SPELT = {
    "knot": "kt", "knots": "kt", "kts": "kt", "kn": "kt", "kias": "kt", "kcas": "kt",
    "ktas": "kt", "keas": "kt", "kgs": "kt", "foot": "ft", "feet": "ft", "inch": "in",
    "inches": "in", "metre": "m", "metres": "m", "meter": "m", "meters": "m", "nm": "nmi",
    "sm": "mi", "mile": "mi", "miles": "mi", "mph": "mi/h", "kmh": "km/h", "kph": "km/h",
    "mps": "m/s", "fps": "ft/s", "fpm": "ft/min", "degree": "deg", "degrees": "deg",
    "radian": "rad", "radians": "rad", "dps": "deg/s", "degps": "deg/s", "radps": "rad/s",
    "mps2": "m/s2", "fps2": "ft/s2", "pound": "lb", "pounds": "lb", "lbs": "lb", "lbm": "lb",
    "slugs": "slug", "kilogram": "kg", "kilograms": "kg", "kgm": "kg", "newton": "N",
    "newtons": "N", "kilonewton": "kN", "lbsf": "lbf", "lbfs": "lbf", "pascal": "Pa",
    "pascals": "Pa", "mbar": "hPa", "mbars": "hPa", "mb": "hPa", "millibar": "hPa",
    "millibars": "hPa", "psia": "psi", "psid": "psi", "psig": "psi", "second": "s",
    "seconds": "s", "sec": "s", "secs": "s", "msec": "ms", "msecs": "ms", "usec": "us",
    "minute": "min", "minutes": "min", "mins": "min", "hour": "h", "hours": "h", "hr": "h",
    "hrs": "h", "hertz": "Hz", "celsius": "degC", "fahrenheit": "degF", "rankine": "degR",
    "kelvin": "K", "percent": "%", "pct": "%", "prc": "%", "pph": "lb/h", "lbph": "lb/h",
    "gs": "g", "g's": "g", "gee": "g", "gees": "g", "-": "1", "--": "1", "none": "1", "nd": "1",
    "n/d": "1", "kilonewtons": "kN", "ft/mn": "ft/min", "degs-1": "deg/s", "rads-1": "rad/s",
    "degrees c": "degC", "degrees f": "degF", "centigrade": "degC", "kgph": "kg/h",
    "kmph": "km/h", "km/h": "km/h", "kg/h": "kg/h", "lb/h": "lb/h", "unitless": "1",
    "dimensionless": "1", "nondim": "1", "ratio": "1", "fraction": "1", "bool": "1",
    "boolean": "1", "mach": "1",
}  # fmt: skip
# several spellings of one unit, also with the reference of a height, or with the quantity
for _unit, _spellings in {
    "g": ("g0", "gn"),
    "rpm": ("r/min", "rev/min", "revs/min", "rpms", "r.p.m", "u/min"),
    "%": ("% rpm", "%rpm", "% n1", "%n1", "% n2", "%n2", "% open", "% mac", "%mac", "per cent"),
    "deg": ("degs",),
    "rad": ("rads",),
    "ft": ("ft msl", "ft agl", "ft amsl", "feet msl", "feet agl", "ft qnh"),
    "m": ("m msl", "m agl", "m amsl"),
    "m/s": ("ms-1", "ms^-1"),
    "m/s2": ("ms-2", "ms^-2", "mss", "m/s/s"),
    "ms": ("millisecond", "milliseconds", "millisec"),
    "us": ("microsecond", "microseconds"),
}.items():
    _SPELT.update(dict.fromkeys(_spellings, _unit))
# other spellings in which the case of the letters matters
_CASED = {
    "Nm": "N m",
    "NM": "nmi",
    "G": "g",
    "M": "m",
    "S": "s",
    "C": "degC",
    "F": "degF",
    "Grad": "deg",  # German for degree
    "µs": "us",
    "μs": "us",
}
# other spellings in lower case, without spaces, dots, asterisks and hyphens
_COMPACT = {
    **{f"deg{letter}": f"deg{letter.upper()}" for letter in "cfr"},
    **dict.fromkeys(("inhg", "inchhg", "incheshg", "inchesofmercury"), "inHg"),
    **dict.fromkeys(("mmhg", "torr"), "mmHg"),
    **dict.fromkeys(("ftlb", "lbft", "ftlbf", "lbfft", "ftlbs", "lbsft"), "lbf ft"),
    **dict.fromkeys(("inlb", "lbin", "inlbf", "lbfin", "inlbs"), "lbf in"),
}
# Ambiguous spellings are errors. The message lists the meanings.
_AMBIGUOUS = {"KN": "kN or kt", "grad": "deg (German Grad) or gon", "GRAD": "deg or gon"}
# misspelt units for which an error suggests the unit
_MISSPELT = {"knott": "kt", "inche": "in", "kilo": "kg", "kmp": "km", "c": "degC", "n": "N"}
# signs of Unicode, and other notations of powers and products
_SIGNS = {
    "℃": "degC", "℉": "degF", "°": "deg", "º": "deg", "˚": "deg", "⁻": "-", "−": "-", "¹": "1",
    "²": "2", "³": "3", "·": " ", "⋅": " ", "×": " ", "**": "", "^": "", "’": "'", "′": "'",
}  # fmt: skip
# Units in capital letters, such as DEG and HPA. KN can mean knots or kilonewtons, MS can mean
# milliseconds or metres per second, and MPA can mean mPa: they are not accepted.
_LOWER = {name.lower(): name for name in _BASE if len(name) > 1 and name not in ("kN", "ms", "MPa")}
_ANGLES = frozenset({"rad", "deg", "mrad", "rev", "rpm"})
# value_SI = value * factor + offset
_OFFSET = {"degC": 273.15, "degF": 459.67 / 1.8}
_FACTOR = re.compile(r"^(%|[A-Za-z]+|1(?!\d))\^?(-?\d)?$")
# Longest text of a unit. The powers of a longer one overflow, and its multiples nest without end.
_LONGEST = 60
# a multiple of a unit, 100 ft or x1000 lb
_MULTIPLE = re.compile(r"^x?(10+)(?= *[A-Za-z])")


@cache
def known_unit(text: str) -> str:
    """Return a unit in the spelling of `parse_unit`.

    A text that is not a unit is returned without surrounding blanks.

    Parameters
    ----------
    text : str
        Any usual spelling, with or without brackets.

    Examples
    --------
    >>> known_unit("°/sec"), known_unit("m/s^2"), known_unit("KIAS")
    ('deg/s', 'm/s2', 'kt')
    >>> known_unit("slug-ft²"), known_unit("lbs")
    ('slug ft2', 'lb')
    """
    if len(text) > _LONGEST:
        return text.strip()
    plain = text.strip().removesuffix(".")
    if len(plain) > 1 and (plain[0], plain[-1]) in (("[", "]"), ("(", ")")):
        plain = plain[1:-1].strip()
    if plain in _BASE or plain in _AMBIGUOUS:
        return plain
    if multiple := _MULTIPLE.match(plain):
        return f"{multiple[1]} {known_unit(plain[multiple.end() :])}"
    if unit := _CASED.get(plain) or _SPELT.get(plain.lower()):
        return unit
    for sign, letters in _SIGNS.items():
        plain = plain.replace(sign, letters)
    # once more, for a spelling with Unicode signs
    if unit := _SPELT.get(plain.lower()):
        return unit
    # before _COMPACT: "in lb" is a moment of mass, but "in-lb" is a moment of force
    if all(word in _BASE for word in plain.split()):
        return " ".join(plain.split())
    if unit := _COMPACT.get(re.sub(r"[ .*-]+", "", plain).lower()):
        return unit
    plain = re.sub(r"\s+per\s+", "/", plain)
    # the hyphen of a product, slug-ft2, but not the sign of a power, s-1
    plain = re.sub(r"(?<=[A-Za-z2-4])-(?=[A-Za-z])", " ", plain)
    parts = []
    for part in plain.split("/"):
        factors = [_known_factor(word) for word in re.split(r"[ *.]+", part.strip())]
        if None in factors:
            return text.strip()
        parts.append(" ".join(map(str, factors)))
    return "/".join(parts)


def _known_factor(word: str) -> str | None:
    """Return one factor of a unit in the spelling of `parse_unit`, None if it is not a unit."""
    match = _FACTOR.match(word)
    if match is None:
        return None
    name, power = match.group(1), match.group(2) or ""
    if name in _AMBIGUOUS:
        return None
    if name in _BASE:
        return name + power
    lower = name.lower()
    unit = _CASED.get(name) or _SPELT.get(lower) or _LOWER.get(lower)
    # a quotient such as fps (ft/s) cannot have a power
    if unit is None or (power and unit not in _BASE):
        return None
    return unit + power


def fitted_unit(text: str, expected: str) -> str:
    """Return a unit as `known_unit` does. The quantity decides ambiguous units.

    A pound is a unit of force in a force, its moment or a pressure, and a unit of mass in a mass,
    its moment or a flow. ``kph`` is kg/h in a flow. ``1/min`` of a rotation is a revolution per
    minute, and Hz a revolution per second.

    Parameters
    ----------
    text : str
    expected : str
        SI unit of the quantity.

    Examples
    --------
    >>> fitted_unit("lbs", "N"), fitted_unit("lbf", "kg")
    ('lbf', 'lb')
    >>> fitted_unit("ft lb", "N m"), fitted_unit("in-lb", "kg m")
    ('ft lbf', 'lb in')
    >>> fitted_unit("lb/in2", "Pa"), fitted_unit("1/min", "rad s-1"), fitted_unit("kph", "kg s-1")
    ('lbf/in2', 'rpm', 'kg/h')
    >>> fitted_unit("Hz", "rad s-1")
    'rev/s'
    """
    unit = known_unit(text)
    if expected == "rad s-1" and unit == "Hz":
        return "rev/s"
    if expected == "rad s-1" and unit in ("1/min", "min-1"):
        return "rpm"
    if expected == "kg s-1" and text.strip().lower() == "kph":
        return "kg/h"
    if expected == "Pa" and re.match(r"lb/(in|ft)2$", unit):
        return unit.replace("lb", "lbf")
    pound = {"N": "lbf", "N m": "lbf", "kg": "lb", "kg m": "lb"}.get(expected)
    factors = unit.split()
    has_pound = not {"lb", "lbf"}.isdisjoint(factors)
    if pound is None or not has_pound or set(factors) - {"lb", "lbf", "ft", "in"}:
        return unit
    replacement = {"lb": pound, "lbf": pound}
    return " ".join(replacement.get(factor, factor) for factor in factors)


@cache
def parse_unit(unit: str) -> tuple[Powers, float, float]:
    """Return dimension, factor and offset of a unit.

    Parameters
    ----------
    unit : str
        For example ``"deg/s"``, ``"kg m2"`` or ``"m s-1"``.

    Returns
    -------
    dimension : tuple of int
        Powers of metre, kilogram, second, kelvin and ampere.
    factor, offset : float
        value_SI = value * factor + offset.

    Raises
    ------
    UnitError
        Unknown unit, a text of more than 60 characters, a factor beyond the floating-point numbers,
        or a temperature with an offset inside a product.
    """
    if len(unit) > _LONGEST:
        start = unit[:_LONGEST]
        raise UnitError(f"a unit of {len(unit)} characters, {start!r}...; at most {_LONGEST}")
    text = known_unit(unit) or "1"
    if text in _OFFSET:
        return _BASE[text][0], _BASE[text][1], _OFFSET[text]
    dimension, factor = [0, 0, 0, 0, 0], 1.0
    if multiple := _MULTIPLE.match(text):
        factor, text = float(multiple[1]), text[multiple.end() :].strip()
    # factors behind a slash, parts 1 and on, have a negative power
    for i, part in enumerate(text.split("/")):
        for word in re.split(r"[ *.]+", part.strip()):
            match = _FACTOR.match(word)
            if match is None or match.group(1) not in _BASE:
                raise UnitError(f"unknown unit {unit!r}; {_suggest_units(word)}")
            name, power = match.group(1), int(match.group(2) or 1)
            if name in _OFFSET:
                raise UnitError(
                    f"unit {unit!r}: {name} has an offset and cannot stand in a product; use K"
                )
            if i > 0:
                power = -power
            dimension = [d + power * e for d, e in zip(dimension, _BASE[name][0], strict=True)]
            factor *= _BASE[name][1] ** power
    if not 0.0 < factor < math.inf:
        raise UnitError(f"unit {unit!r}: its factor to SI is {factor:g}; divide its powers")
    m, kg, s, K, A = dimension
    return (m, kg, s, K, A), factor, 0.0


def _suggest_units(word: str) -> str:
    """Return the part of an error message that suggests units in place of an unknown one."""
    if near := _near_units(word):
        return f"near it: {near}"
    return f"known are {', '.join(sorted(_BASE))} and products, powers and quotients of them"


def _near_units(word: str) -> str:
    """Return units that a word can mean, as a text that may be empty."""
    if word in _AMBIGUOUS:
        return _AMBIGUOUS[word]
    plain, power = word.lower(), ""
    # prefixes of square and cubic units, "sqft" and "cuft"
    for prefix, digit in (("sq", "2"), ("cu", "3")):
        if not power and plain.startswith(prefix):
            plain, power = plain.removeprefix(prefix), digit
    names = {**_SPELT, **_MISSPELT}
    name = names.get(plain) or names.get(plain.removesuffix("s"))
    if name:
        return name + power
    if plain in _BASE:
        return plain + power
    return ", ".join(get_close_matches(word, _BASE, n=3, cutoff=0.6))


def to_si(value: Any, unit: str, expected: str | None = None) -> Any:
    """Convert `value` in `unit` to SI.

    Parameters
    ----------
    value : float or array
    unit : str
    expected : str, optional
        SI unit of the quantity, for a check of the dimension. Hz of a quantity in rad/s are turns
        per second, and a quantity in Hz may be stated in rad/s or rpm.  A quantity in s-1 counts
        neither turns nor radians.

    Raises
    ------
    UnitError
        An unknown unit, a unit of another quantity, or rpm or deg/s of a quantity in s-1.

    Examples
    --------
    >>> to_si(1000.0, "ft", "m")
    304.8
    >>> to_si(15.0, "degC")
    288.15
    >>> round(to_si(1.0, "Hz", "rad s-1"), 6), to_si(600.0, "rpm", "Hz")
    (6.283185, 10.0)
    """
    dimension, factor, offset = parse_unit(unit)
    _refuse_turns(unit, expected)
    factor *= _turn_factor(unit, expected)
    if expected is not None and dimension != parse_unit(expected)[0]:
        raise UnitError(
            f"unit {unit!r} cannot be converted to {expected!r}; give a unit of the same quantity"
        )
    return value * factor + offset


@cache
def _refuse_turns(unit: str, expected: str | None) -> None:
    """Raise for rpm, deg/s and the like of a quantity in 1/s, which counts no angle.

    One rpm would be 1/60 or 2 pi/60.  A radian is 1 in both readings.
    """
    words = re.split(r"[ */.]+", known_unit(unit))
    if expected == "s-1" and not _ANGLES.isdisjoint(words) and "rad" not in words:
        raise UnitError(
            f"unit {unit!r} counts turns or radians, and a quantity in 's-1' neither; give it in "
            "1/s or 1/min"
        )


@cache
def _turn_factor(unit: str, expected: str | None) -> float:
    """Return 2 pi for Hz of an angular frequency, 1/2 pi for the reverse, else 1."""
    text = known_unit(unit)
    if expected == "rad s-1" and text == "Hz":
        return 2.0 * math.pi
    if expected == "Hz" and not _ANGLES.isdisjoint(re.split(r"[ */.]+", text)):
        return 0.5 / math.pi
    return 1.0


def from_si(value: Any, unit: str) -> Any:
    """Convert an SI `value` to `unit`, the inverse of `to_si`."""
    _, factor, offset = parse_unit(unit)
    return (value - offset) / factor
