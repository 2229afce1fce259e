"""Units of measure and numbers as DAVE-ML files write them.

In a unit code of S-119 an underscore divides, and a power follows its unit: ``ft_s2``,
``slugft2``, ``_deg``.
"""

from __future__ import annotations

import re

import numpy as np

from aerodb.exchange.xml_reader import Element
from flightmech import units
from flightmech.errors import UnitError

_FORTRAN = re.compile(r"(?<=[\d.])[dD](?=[-+]?\d)")  # 1.5D+03
_MOST_CHARACTERS = 40  # of a faulty text in a message


def parse_number(text: str, element: Element) -> float:
    """Return a finite number, or raise `ParseError` at the element."""
    numbers = parse_numbers(text, element)
    if numbers.size != 1:
        raise element.error(f"{text!r}", "one number")
    return float(numbers[0])


def parse_numbers(text: str, element: Element) -> np.ndarray:
    """Return finite numbers separated by commas, semicolons or blanks, or raise `ParseError`."""
    parts = _FORTRAN.sub("e", re.sub("[,;]", " ", text)).split()
    # Python reads 1_000 as a number, XML does not.
    if "_" in text:
        raise _number_error(parts, element)
    try:
        numbers = np.array(parts, float)
    except ValueError:
        raise _number_error(parts, element) from None
    if not np.isfinite(numbers).all():
        raise _number_error(parts, element)
    return numbers


def _number_error(parts: list[str], element: Element) -> Exception:
    """Return the error for the first text that is not a finite number."""
    return element.error(_first_fault(parts), "finite numbers, separated by commas or blanks")


def _first_fault(parts: list[str]) -> str:
    for part in parts:
        try:
            is_number = "_" not in part and np.isfinite(float(part))
        except ValueError:
            is_number = False
        if not is_number:
            return repr(part[:_MOST_CHARACTERS])
    return "no number"


def optional_number(element: Element, attribute: str, default: float) -> float:
    """Return the number of an attribute, or the default if the attribute is missing."""
    if attribute not in element.attributes:
        return default
    return parse_number(element.attributes[attribute], element)


PURE = ("", "nd", "none", "nondimensional", "dimensionless", "frac", "fract", "fraction", "-")
# Code: unit of this package.  Variants in published files follow the code of the standard.
_CODES = {
    "deg": "deg", "degs": "deg", "degrees": "deg", "d": "deg", "rad": "rad", "rads": "rad",
    "radians": "rad", "r": "rad",
    "pct": "%", "percent": "%", "nd": "1", "1": "1",
    "ft": "ft", "f": "ft", "feet": "ft", "m": "m", "cm": "cm", "mm": "mm", "km": "km", "in": "in",
    "nmi": "nmi",
    "s": "s", "sec": "s", "min": "min", "h": "h", "hr": "h", "Hz": "Hz", "rpm": "rpm",
    "kg": "kg", "lbm": "lb", "slug": "slug", "sl": "slug", "N": "N", "lbf": "lbf", "Pa": "Pa",
    "hPa": "hPa", "kPa": "kPa",
    "psf": "psf", "psi": "psi", "kt": "kt", "kts": "kt", "knots": "kt", "g": "g",
    "W": "W", "kW": "kW", "hp": "hp", "A": "A", "V": "V",
    "K": "K", "degK": "K", "R": "degR", "degR": "degR", "C": "degC", "degC": "degC", "F": "degF",
    "degF": "degF",
}  # fmt: skip
# The longest code first, so that "slug" is not read as "s" and "lug".
_LONGEST_FIRST = sorted(map(re.escape, _CODES), key=len, reverse=True)
_CODE_AND_POWER = re.compile("(" + "|".join(_LONGEST_FIRST) + r")(\d*)")
_OUT = {"%": "pct", "1": "nd"}


def unit_of_code(code: str) -> str:
    """Return the unit of `flightmech.units` of an S-119 code.

    Examples
    --------
    >>> unit_of_code("slugft2"), unit_of_code("rad_s2"), unit_of_code("_deg"), unit_of_code("ND")
    ('slug ft2', 'rad/s2', '1/deg', '1')

    Raises
    ------
    UnitError
        The code contains an unknown part.
    """
    text = code.strip()
    if text.lower() in PURE:
        return "1"
    numerator, _, denominator = text.partition("_")
    parts = [_split_code(part, code) for part in (numerator, denominator) if part]
    if not parts:
        raise UnitError(f"{code!r} is not a unit of S-119; write a code such as rad_s2, or nd")
    return "/".join(parts) if numerator else "1/" + parts[0]


def code_of(unit: str) -> str:
    """Return the S-119 code of a unit of this package, such as ``"kg m2"`` or ``"m s-1"``.

    Examples
    --------
    >>> code_of("m s-1"), code_of("kg m2"), code_of("1")
    ('m_s', 'kgm2', 'nd')
    """
    numerator, denominator = "", ""
    for factor in unit.split():
        match = re.fullmatch(r"(%|1|[A-Za-z]+)(-?\d*)", factor)
        assert match is not None
        name, power = match.groups()
        code = _OUT.get(name, name)
        # A power of -1 is written without a number behind the underscore.
        if power == "-1":
            denominator += code
        elif power.startswith("-"):
            denominator += code + power[1:]
        else:
            numerator += code + power
    return f"{numerator}_{denominator}" if denominator else numerator


def same_units(code: str, other_code: str) -> bool:
    """Return whether two codes mean the same unit.

    An empty code equals every code.  A code that cannot be read equals only itself.
    """
    if not code.strip() or not other_code.strip() or code.strip() == other_code.strip():
        return True
    try:
        return units.parse_unit(unit_of_code(code)) == units.parse_unit(unit_of_code(other_code))
    except UnitError:
        return False


def convert_between(code: str, other_code: str) -> tuple[float, float] | None:
    """Return factor and offset from one unit to another, or None for different quantities.

    The conversion is value [other_code] = factor * value [code] + offset.  Equal codes and an empty
    code leave the value unchanged.  An angle is not a pure number: ``deg`` and ``nd`` are different
    quantities.

    Examples
    --------
    >>> convert_between("km", "m"), convert_between("nd", "deg")
    ((1000.0, 0.0), None)
    """
    if same_units(code, other_code):
        return 1.0, 0.0
    try:
        unit, other_unit = unit_of_code(code), unit_of_code(other_code)
        dimension, size, origin = units.parse_unit(unit)
        other_dimension, other_size, other_origin = units.parse_unit(other_unit)
    except UnitError:
        return None
    # Angles and pure numbers have the same dimension, so the units themselves are compared.
    if dimension != other_dimension or _is_angular(unit) != _is_angular(other_unit):
        return None
    return size / other_size, (origin - other_origin) / other_size


def _is_angular(unit: str) -> bool:
    # degR, degF, degC and degK are temperatures.
    return re.search("deg(?![RFCK])|rad|rpm", unit) is not None


def _split_code(part: str, code: str) -> str:
    """Return the numerator or denominator of a code as units with powers, separated by blanks."""
    factors, position = [], 0
    while position < len(part):
        match = _CODE_AND_POWER.match(part, position)
        if match is None:
            raise UnitError(
                f"unknown unit code {code!r}; S-119 codes are made of {', '.join(_CODES)}, "
                f"powers and one underscore for 'per'"
            )
        factors.append(_CODES[match[1]] + match[2])
        position = match.end()
    return " ".join(factors)
