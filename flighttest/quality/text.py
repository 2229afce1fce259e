"""The quality of a record as plain text."""

from __future__ import annotations

from flightmech.units import from_si


def shown(value: float, units: str) -> str:
    """Return an SI value in the unit in which people read it."""
    display = {"rad": "deg", "rad s-1": "deg/s"}.get(units, units)
    number = from_si(value, display) if display != units else value
    return f"{number:.3g} {display}" if display != "1" else f"{number:.3g}"


def meaningful(moving: bool, correlation: float) -> bool:
    """Whether slope and correlation of a comparison mean anything."""
    return moving or correlation > 0.95
