"""An evaluation as plain text."""

from __future__ import annotations

import math

from flightmech.units import from_si

DISPLAY = {"rad": "deg", "rad s-1": "rad/s", "m s-1": "m/s", "s-2": "1/s2 per rad"}


def number(value: float, unit: str, digits: int = 4) -> str:
    """Return an SI value for people, angles in degrees; a dash for what is not there."""
    if not math.isfinite(value):
        return "-"
    return f"{from_si(value, 'deg') if unit == 'rad' else value:.{digits}g}"


def unit_shown(unit: str) -> str:
    """Return the unit that `number` shows."""
    return "" if unit == "1" else DISPLAY.get(unit, unit)


def limits_shown(low: float, high: float, unit: str) -> str:
    """Return the bounds as text."""
    if math.isinf(high):
        return f"at least {number(low, unit)}"
    return f"at most {number(high, unit)}" if math.isinf(low) else f"{number(low, unit)} ... {number(high, unit)}"
