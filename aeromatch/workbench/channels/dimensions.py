"""Dimensions of channels and of expressions of them.

A dimension is the powers of metre, kilogram, second and kelvin, and of the angle.  The angle is a
pure number in sums of products (``V*q`` is an acceleration as ``az`` is), but a bare number is not
added to an angle: nobody could see whether it is in radians or in degrees.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from flightmech.errors import UnitError, UnknownName
from flightmech.names import lookup
from flightmech.units import known_unit, parse_unit

_ANGLES = re.compile(r"(?<![A-Za-z])(?:m?rad|deg|rev|rpm)(?![A-Za-z])(-?\d*)")
_UNITS = ("m", "kg", "s", "K", "A", "rad")
# Display units of results that are no channel of the vocabulary, by dimension.
_DISPLAYED: dict[tuple[float, ...], str] = {
    (0, 0, 0, 0, 0, 1): "deg",
    (0, 0, -1, 0, 0, 1): "deg/s",
    (0, 0, -2, 0, 0, 1): "deg/s2",
    (0, 0, 1, 0, 0, 1): "deg s",
}


class Dimension(NamedTuple):
    """Powers of metre, kilogram, second, kelvin, ampere and angle."""

    metre: float = 0
    kilogram: float = 0
    second: float = 0
    kelvin: float = 0
    ampere: float = 0
    angle: float = 0

    def times(self, other: Dimension, power: float = 1) -> Dimension:
        """Return the dimension of a product with a power of another quantity."""
        return Dimension(*(a + power * b for a, b in zip(self, other, strict=True)))

    def to_power(self, power: float) -> Dimension:
        """Return the dimension of a power."""
        return Dimension(*(power * a for a in self))

    @property
    def is_number(self) -> bool:
        """Whether the quantity is a pure number or an angle."""
        return not any(self[:5])

    def matches(self, other: Dimension) -> bool:
        """Return whether two quantities can be added; the angle is a pure number here."""
        return self[:5] == other[:5]

    def unit(self) -> str:
        """Return the SI unit as a text, or degrees for angles and their rates."""
        if self in _DISPLAYED:
            return _DISPLAYED[self]
        words = []
        # A product with an angle in it, such as V*q, is not an angle any more.
        powers = (*self[:5], self.angle if self.is_number else 0)
        for name, power in zip(_UNITS, powers, strict=True):
            if power:
                words.append(name if power == 1 else f"{name}{power:g}")
        return " ".join(words) or "1"


NUMBER = Dimension()
ANGLE = Dimension(angle=1)


def dimension_of_unit(unit: str) -> Dimension:
    """Return the dimension of a unit such as ``deg/s``.

    Raises
    ------
    UnitError
        An unknown unit.
    """
    powers, _, _ = parse_unit(unit)
    # other spellings, such as degrees or dps, name the same angle
    unit = known_unit(unit)
    angle = 0
    for part, sign in zip(unit.partition("/")[::2], (1, -1), strict=True):
        for match in _ANGLES.finditer(part):
            angle += sign * int(match[1] or 1)
    return Dimension(*powers, angle)


def dimension_of_channel(name: str) -> Dimension | None:
    """Return the dimension of a channel; None for a name that the vocabulary does not have."""
    try:
        return dimension_of_unit(lookup(name).units)
    except (UnknownName, UnitError):
        return None
