"""Sets of units in which a report shows quantities.

The tolerance table prints kt, ft, deg, lbf and g, and a report without a set shows those, with masses
in kg.  A set has one unit for each kind of quantity on every page.  Verdicts stay in the units of
the table, and files of numbers in SI.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

# Angles, temperatures and pressures of the air are printed alike in both.
_ALIKE = {
    "rad": "deg",
    "rad s-1": "deg/s",
    "rad s-2": "deg/s2",
    "K": "degC",
}
SETS: dict[str, dict[str, str]] = {
    "": {},
    "SI": {**_ALIKE, "Pa": "hPa"},
    "kt-ft-lb": {
        **_ALIKE,
        "m": "ft",  # of heights; shorter lengths are in inches
        "m2": "ft2",
        "m s-1": "kt",
        "m s-2": "ft/s2",
        "kg": "lb",
        "kg m2": "slug ft2",
        "kg m-3": "slug/ft3",
        "kg s-1": "lb/h",
        "N": "lbf",
        "N m": "lbf ft",
        "Pa": "psi",
    },
}
"""By set: SI unit to display unit.  A unit that is not listed stays SI; the empty set has none."""

# Kinds that a set leaves as the vocabulary shows them: rates of climb, static pressure, a
# temperature difference, shares in percent.
_KEPT = {
    "SI": {"%", "hPa", "K"},
    "kt-ft-lb": {"%", "ft/min", "hPa", "K"},
}

_current: ContextVar[str] = ContextVar("unit_set", default="")


def current_units() -> str:
    """Return the name of the set in use; empty for the units of the tolerance table."""
    return _current.get()


@contextmanager
def shown_in(units: str) -> Iterator[None]:
    """Show quantities in a set of units inside the block."""
    token = _current.set(units)
    try:
        yield
    finally:
        _current.reset(token)


def display_unit_of(si_unit: str, display_unit: str, units: str) -> str:
    """Return the unit in which a set shows a quantity.

    Parameters
    ----------
    si_unit, display_unit : str
        Of the vocabulary.
    units : str
        Name of the set.

    Examples
    --------
    >>> display_unit_of("kg", "kg", "kt-ft-lb"), display_unit_of("m s-1", "ft/min", "kt-ft-lb")
    ('lb', 'ft/min')
    >>> display_unit_of("m", "ft", "SI")
    'm'
    """
    # a centre of gravity or a travel is inches, a height feet
    if units == "kt-ft-lb" and si_unit == "m" and display_unit != "ft":
        return "in"
    if not units or display_unit in _KEPT[units] or si_unit in ("1", "s"):
        return display_unit
    return SETS[units].get(si_unit, si_unit)
