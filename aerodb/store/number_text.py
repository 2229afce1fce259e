"""Conditions and numbers as people read them."""

from __future__ import annotations

from flightmech.names import lookup
from flightmech.units import from_si

FREE_AIR = 1e4  # h_agl from here on is no height over ground [m]


def readable(name: str, value: float) -> str:
    """Return a value in the display unit of a quantity, ``12 deg``."""
    if name == "h_agl" and value >= FREE_AIR:
        return "in free air"
    unit = lookup(name).display_units
    return f"{plain_number(from_si(float(value), unit))}{'' if unit == '1' else f' {unit}'}"


def plain_number(value: float) -> str:
    """Return a number with four significant digits, larger ones whole.

    Examples
    --------
    >>> plain_number(20000.0), plain_number(-0.0), plain_number(0.123456)
    ('20000', '0', '0.1235')
    """
    return f"{value + 0.0:.0f}" if 1e4 <= abs(value) < 1e8 else f"{value + 0.0:.4g}"
