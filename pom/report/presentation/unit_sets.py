"""Sets of units in which a report shows quantities.

The tolerance table prints kt, ft, deg, lbf and g, and a report without a set shows those, with
masses in kg.  A set has one unit for each kind of quantity on every page, in remarks too.  Verdicts
stay in the units of the table, and files of numbers in SI.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from flightmech.units import parse_unit

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


# Units in texts that a set replaces, the longest spelling first.  Not "in": it is a word, too.
_WRITTEN = {
    "SI": ("slug ft2", "lbf ft", "lb/h", "ft/s2", "lbf", "psi", "kt", "ft", "lb"),
    "kt-ft-lb": ("kg m2", "kg/m3", "kg/s", "m s-2", "m s-1", "m/s2", "m/s", "N m", "kg", "m", "N"),
}
_NUMBER = r"[+\-\N{MINUS SIGN}]?\d+(?:\.\d+)?(?:e[+-]?\d+)?"
_LEAST_DIGITS = 3  # of a converted number, as the remarks print theirs


def units_in_text(text: str) -> str:
    """Return a remark with its quantities in the set of units in use.

    Remarks are written before a set is chosen.  The numbers keep their number of digits, three at
    least.  Without a set the text stays as it is.

    Examples
    --------
    >>> with shown_in("kt-ft-lb"):
    ...     units_in_text("off by 158 m at 20.4 s, 5 ... 10 m/s, mass 2000 kg")
    'off by 518 ft at 20.4 s, 9.72 ... 19.4 kt, mass 4409 lb'
    >>> with shown_in("SI"):
    ...     units_in_text("trim.F_column -14.1 lbf is beyond 5 lbf")
    'trim.F_column -62.7 N is beyond 22.2 N'
    """
    written = _WRITTEN.get(current_units())
    if written is None:
        return text
    names = "|".join(map(re.escape, written))
    # not a part of a name such as `x_2 m` or of a longer unit such as `m/km`
    pattern = rf"(?<![\w.])((?:{_NUMBER}(?: \.\.\. | … | to ))*{_NUMBER}) ({names})(?![\w/^*])"
    return re.sub(pattern, _convert_match, text)


def _convert_match(match: re.Match[str]) -> str:
    """Return numbers and their unit in the set in use."""
    numbers, unit = match.groups()
    shown = display_unit_of(_SI_UNITS[unit], "ft" if unit == "m" else "", current_units())
    factor = parse_unit(unit)[1] / parse_unit(shown)[1]
    text = re.sub(_NUMBER, lambda number: _scaled_number(number.group(), factor), numbers)
    return f"{text} {_PRINTED.get(shown, shown)}"


# SI units of the units in texts, by which a set has its own, and units as texts print them
_SI_UNITS = {
    "slug ft2": "kg m2",
    "lbf ft": "N m",
    "lb/h": "kg s-1",
    "ft/s2": "m s-2",
    "lbf": "N",
    "psi": "Pa",
    "kt": "m s-1",
    "ft": "m",
    "lb": "kg",
    "kg m2": "kg m2",
    "kg/m3": "kg m-3",
    "kg/s": "kg s-1",
    "m s-2": "m s-2",
    "m s-1": "m s-1",
    "m/s2": "m s-2",
    "m/s": "m s-1",
    "N m": "N m",
    "kg": "kg",
    "m": "m",
    "N": "N",
}
_PRINTED = {"m s-1": "m/s", "m s-2": "m/s2", "kg s-1": "kg/s"}


def _scaled_number(text: str, factor: float) -> str:
    """Return a written number times a factor, with its sign and its number of digits."""
    mantissa = text.replace("\N{MINUS SIGN}", "-").partition("e")[0]
    digits = max(len(mantissa.strip("+-").replace(".", "").lstrip("0")), _LEAST_DIGITS)
    value = float(text.replace("\N{MINUS SIGN}", "-")) * factor
    shown = f"{abs(float(f'{value:.{digits}g}')):.10g}"
    sign = text[0] if text[0] in "+-\N{MINUS SIGN}" else ""
    return f"{sign}{shown}"
