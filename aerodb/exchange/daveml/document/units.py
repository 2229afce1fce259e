"""Units of measure as S-119 encodes them: an underscore divides, powers follow their unit
(``ft_s2``, ``slugft2``, ``_deg``).
"""

from __future__ import annotations

import re

import numpy as np

from aerodb.exchange.xml_reader import Element
from flightmech import units
from flightmech.errors import UnitError

_FORTRAN = re.compile(r"(?<=[\d.])[dD](?=[-+]?\d)")  # 1.5D+03


def parse_number(text: str, element: Element) -> float:
    """Return the finite number a text stands for; anything else raises `ParseError` at the element."""
    found = parse_numbers(text, element)
    if found.size != 1:
        raise element.error(f"{text!r}", "one number")
    return float(found[0])


def parse_numbers(text: str, element: Element) -> np.ndarray:
    """Return the finite numbers of a list separated by commas, semicolons or blanks; anything else
    raises `ParseError`.
    """
    words = _FORTRAN.sub("e", re.sub("[,;]", " ", text)).split()
    try:
        found = np.array(words, float) if "_" not in text else None
    except ValueError:
        found = None
    if found is None or not np.isfinite(found).all():
        raise element.error(_culprit(words), "finite numbers, separated by commas or blanks")
    return found


def optional_number(element: Element, attribute: str, default: float) -> float:
    """Return the number of an attribute, or the default when it is not there."""
    return (
        parse_number(element.attributes[attribute], element)
        if attribute in element.attributes
        else default
    )


def _culprit(words: list[str]) -> str:
    for word in words:
        try:
            if "_" not in word and np.isfinite(float(word)):
                continue
        except ValueError:
            pass
        return repr(word[:40])
    return "no number"


PURE = ("", "nd", "none", "nondimensional", "dimensionless", "frac", "fract", "fraction", "-")
# code: unit of this package.  Variants found in published files follow the code of the standard.
_CODES = {
    "deg": "deg", "degs": "deg", "degrees": "deg", "d": "deg", "rad": "rad", "rads": "rad", "radians": "rad", "r": "rad",
    "pct": "%", "percent": "%", "nd": "1", "1": "1",
    "ft": "ft", "f": "ft", "feet": "ft", "m": "m", "cm": "cm", "mm": "mm", "km": "km", "in": "in", "nmi": "nmi",
    "s": "s", "sec": "s", "min": "min", "h": "h", "hr": "h", "Hz": "Hz", "rpm": "rpm",
    "kg": "kg", "lbm": "lb", "slug": "slug", "sl": "slug", "N": "N", "lbf": "lbf", "Pa": "Pa", "hPa": "hPa", "kPa": "kPa",
    "psf": "psf", "psi": "psi", "kt": "kt", "kts": "kt", "knots": "kt", "g": "g",
    "K": "K", "degK": "K", "R": "degR", "degR": "degR", "C": "degC", "degC": "degC", "F": "degF", "degF": "degF",
}  # fmt: skip
_WORD = re.compile(
    "(" + "|".join(sorted(map(re.escape, _CODES), key=len, reverse=True)) + r")(\d*)"
)
_OUT = {"%": "pct", "1": "nd"}


def unit_of_code(code: str) -> str:
    """Return the unit of `flightmech.units` that an S-119 code stands for.

    Examples
    --------
    >>> unit_of_code("slugft2"), unit_of_code("rad_s2"), unit_of_code("_deg"), unit_of_code("ND")
    ('slug ft2', 'rad/s2', '1/deg', '1')

    Raises
    ------
    UnitError
        A code that cannot be taken apart.
    """
    text = code.strip()
    if text.lower() in PURE:
        return "1"
    over, _, under = text.partition("_")
    parts = [_words(part, code) for part in (over, under) if part]
    return "/".join(parts) if over else "1/" + parts[0]


def code_of(unit: str) -> str:
    """Return the S-119 code of a unit of this package, such as ``"kg m2"`` or ``"m s-1"``.

    Examples
    --------
    >>> code_of("m s-1"), code_of("kg m2"), code_of("1")
    ('m_s', 'kgm2', 'nd')
    """
    over, under = "", ""
    for word in unit.split():
        name, power = re.fullmatch(r"(%|1|[A-Za-z]+)(-?\d*)", word).groups()  # type: ignore[union-attr]
        if power.startswith("-"):
            under += _OUT.get(name, name) + (power[1:] if power != "-1" else "")
        else:
            over += _OUT.get(name, name) + power
    return f"{over}_{under}" if under else over


def same_units(one: str, other: str) -> bool:
    """Whether two codes mean the same unit; a code that cannot be read equals itself only, an empty
    one equals all.
    """
    if not one.strip() or not other.strip() or one.strip() == other.strip():
        return True
    try:
        return units.parse_unit(unit_of_code(one)) == units.parse_unit(unit_of_code(other))
    except UnitError:
        return False


def convert_between(one: str, other: str) -> tuple[float, float] | None:
    """Return factor and offset of value [other] = factor * value [one] + offset, or None for units
    of different quantities.

    Equal codes and an empty one leave the value as it is.  An angle is no plain number: ``deg`` and
    ``nd`` are different quantities.

    Examples
    --------
    >>> between("km", "m"), between("nd", "deg")
    ((1000.0, 0.0), None)
    """
    if same_units(one, other):
        return 1.0, 0.0
    try:
        units_of = [unit_of_code(code) for code in (one, other)]
        (dimension, size, origin), (wanted, step, start) = map(units.parse_unit, units_of)
    except UnitError:
        return None
    if dimension != wanted or _is_angular(units_of[0]) != _is_angular(units_of[1]):
        return None
    return size / step, (origin - start) / step


def _is_angular(unit: str) -> bool:
    return re.search("deg(?![RFCK])|rad|rpm", unit) is not None


def _words(part: str, code: str) -> str:
    words, at = [], 0
    while at < len(part):
        match = _WORD.match(part, at)
        if match is None:
            raise UnitError(
                f"unknown unit code {code!r}; S-119 codes are made of {', '.join(_CODES)}, "
                f"powers and one underscore for 'per'"
            )
        words.append(_CODES[match[1]] + match[2])
        at = match.end()
    return " ".join(words)
