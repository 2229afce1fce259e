"""Values of a flight that no aeroplane has: mostly a number without its unit.

A bare number is SI. Degrees, knots, feet, hectopascals or inches without their unit give a flight
that the model computes without a word, with all its tables at their ends.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from flightmech.errors import AeromatchWarning, UnknownName
from flightmech.names import lookup, value_text
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import INPUT, PARAMETER
from flightmech.units import from_si, to_si

_GROUPS = ("init.", "mass.", "env.")


class UsualRange(NamedTuple):
    """Range of a quantity of any flight, and the unit in which such a number is usual. [SI]"""

    low: float
    high: float
    meant: str


_LONGEST = 1800.0  # s, of a flight with controls: half an hour
_COARSEST = 5.0  # s between two samples of such a flight

_USUAL = {
    **dict.fromkeys(("alpha", "beta", "gamma", "theta", "lat"), UsualRange(-1.6, 1.6, "deg")),
    **dict.fromkeys(("phi", "psi", "lon"), UsualRange(-7.0, 7.0, "deg")),
    # levers and wheels of the cockpit turn further than a surface: power levers to 130 deg
    **dict.fromkeys(("pla", "wheel", "tiller"), UsualRange(-3.5, 3.5, "deg")),
    **dict.fromkeys(("p", "q", "r", "psi_dot"), UsualRange(-7.0, 7.0, "deg/s")),
    # hypersonic pages of DATCOM reach Mach 20: a larger number is a speed
    "mach": UsualRange(0.0, 25.0, "1"),
    "V": UsualRange(0.0, 8000.0, "kt"),
    **dict.fromkeys(("V_cas", "V_eas"), UsualRange(0.0, 1500.0, "kt")),
    "h": UsualRange(-600.0, 30e3, "ft"),
    "hdot": UsualRange(-300.0, 300.0, "ft/min"),
    "delta_T": UsualRange(-80.0, 80.0, "K"),
    "qnh": UsualRange(85e3, 109e3, "hPa"),
    "nz": UsualRange(-6.0, 12.0, "1"),
}
"""Limits are wide: a full turn of bank in place of half of one, heights up to 30 km."""

_OTHER_UNITS = {"qnh": "Pa"}
"""Units of parameters outside of the vocabulary."""
_SLACK = 0.01
"""Part of the travel by which an input may stand beyond its limit: rounding of a record."""
_UNIT_FACTOR = 2.0
"""Size over the limit from which on an input has mostly lost its unit."""
_RATIO = 4.0
"""Mass over that of the aircraft file, or its inverse, from which on it is odd."""
_MASS = ("mass", "Ixx", "Iyy", "Izz")
_ARMS = ("x_cg_b", "y_cg_b", "z_cg_b")
_LONG_ARM = 10.0
"""Distance of a c.g. from the moment reference point that is odd. [m]"""


def describe_odd_quantity(name: str, value: float) -> str:
    """Return what is odd of a value of a flight, empty if nothing is.

    Parameters
    ----------
    name : str
        Quantity of the vocabulary, or a start value or parameter of a model: ``theta init.theta
        env.qnh``.
    value : float
        Its value. [SI]

    Examples
    --------
    >>> describe_odd_quantity("theta", 0.1)
    ''
    >>> describe_odd_quantity("theta", 5.0)
    "theta 5 rad (286.5 deg) is outside of -1.6 to 1.6 rad; is 5 deg meant? write '5 deg'"
    """
    plain = _plain_name(name)
    # a quantity of one engine, such as engine1.pla
    usual = _USUAL.get(plain.rpartition(".")[2])
    if plain in _ARMS:
        usual = UsualRange(-_LONG_ARM, _LONG_ARM, "in")
    elif usual is None and _units(plain) == "rad":
        # no surface, tab or flow angle turns by more than a right angle
        usual = UsualRange(-1.6, 1.6, "deg")
    if usual is None or usual.low <= value <= usual.high:
        return ""
    units = _units(plain)
    text = f"{name} {_both_units(plain, value)} is outside of {usual.low:g} to {usual.high:g}"
    text += f" {units}" * (units != "1")
    if usual.meant in ("1", units):
        return f"{text}; a number without a unit is in {units}"
    if not usual.low <= to_si(value, usual.meant) <= usual.high:
        return text
    return f"{text}; is {value:g} {usual.meant} meant? write '{value:g} {usual.meant}'"


def describe_odd_values(
    sim: SimModel,
    values: Mapping[str, float],
    inputs: Mapping[str, Any] | xr.Dataset | None = None,
) -> list[str]:
    """Return what is odd of the stated values of a flight of a model.

    Parameters
    ----------
    sim : SimModel
        The compiled model, with the limits of the controls and the mass of the aircraft file.
    values : mapping of str to float
        Parameters, inputs and quantities that the caller states. [SI]
    inputs : mapping of str to array, optional
        Inputs over time. [SI]

    Returns
    -------
    list of str
        One line for each value that no aeroplane has, or that the control does not reach.
    """
    # the limits of an input say more than a right angle
    stated = {name: value for name, value in values.items() if name not in sim.inputs}
    texts = [describe_odd_quantity(name, value) for name, value in stated.items()]
    texts += _of_mass(sim, values)
    histories: dict[str, Any] = dict(values)
    if inputs is not None:
        histories |= {str(name): history for name, history in inputs.items()}
    texts += [
        _of_input(row, histories[row.name]) for row in sim.entries(INPUT) if row.name in histories
    ]
    return [text for text in texts if text]


def warn_of_odd_values(
    sim: SimModel,
    values: Mapping[str, float],
    inputs: Mapping[str, Any] | xr.Dataset | None = None,
) -> None:
    """Warn of each value of `describe_odd_values`."""
    for text in describe_odd_values(sim, values, inputs):
        warnings.warn(text, AeromatchWarning, stacklevel=3)


def describe_bare_numbers(stated: Mapping[str, float]) -> str:
    """Return in which unit values without one were taken, empty without such a value.

    Parameters
    ----------
    stated : mapping of str to float
        Values that the caller gave without a unit. [SI]

    Examples
    --------
    >>> describe_bare_numbers({"V": 100.0, "mode.trim": 2.0})
    'taken without a unit: V 100 m/s (194.4 kt)'
    """
    texts = []
    for name, value in stated.items():
        plain = _plain_name(name)
        shown = _both_units(plain, value)
        # a quantity with one unit has nothing to be mistaken
        if shown.endswith(")"):
            texts.append(f"{plain} {shown}")
    if not texts:
        return ""
    return f"taken without a unit: {', '.join(texts)}"


def _of_mass(sim: SimModel, values: Mapping[str, float]) -> Iterator[str]:
    """Yield masses and inertias of another size than those of the aircraft file."""
    defaults = {
        row.name: row.value for row in sim.entries(PARAMETER) if row.name.startswith("mass.")
    }
    for name in _MASS:
        own = defaults.get(f"mass.{name}", 0.0)
        value = values.get(f"mass.{name}", values.get(name))
        if value is None or not own > 0.0 or own / _RATIO <= value <= own * _RATIO:
            continue
        yield (
            f"{name} {_both_units(name, value)} is {value / own:.3g} times that of the aircraft "
            f"file, {value_text(name, own)}; a number without a unit is in {_units(name)}"
        )


def _of_input(row: Any, history: Any) -> str:
    """Return what is odd of an input over time, empty if the control reaches it."""
    limit = max(abs(row.low), abs(row.high))
    # a control without limits has those of the numbers
    if not 0.0 < limit < np.sqrt(np.finfo(float).max):
        return ""
    values = np.asarray(getattr(history, "values", history), float)
    low, high = float(np.nanmin(values, initial=0.0)), float(np.nanmax(values, initial=0.0))
    slack = _SLACK * (row.high - row.low)
    if row.low - slack <= low and high <= row.high + slack:
        return ""
    farthest = low if row.low - low > high - row.high else high
    beyond = row.low if farthest == low else row.high
    shown = [value_text(row.name, value) for value in (farthest, beyond)]
    if abs(farthest) > _UNIT_FACTOR * limit and row.units != "1":
        return (
            f"{row.name} reaches {shown[0]}, its limit is {shown[1]}; a number or a column without "
            f"a unit is in {_readable(row.units)}: write the unit, such as '{farthest:g} "
            f"{row.display_units}' or a heading '{row.name} [{row.display_units}]'"
        )
    return (
        f"{row.name} reaches {shown[0]}, its limit is {shown[1]}; the model flies with it, the "
        f"control of the aircraft does not reach it: correct the value, or [limits] of the "
        f"aircraft file"
    )


def _plain_name(name: str) -> str:
    """Return the quantity of a parameter: ``V`` of ``init.V``."""
    for group in _GROUPS:
        if name.startswith(group):
            return name.removeprefix(group)
    return name


def _units(plain: str) -> str:
    """Return the SI unit of a quantity, ``1`` for a name outside of the vocabulary."""
    try:
        return _readable(lookup(plain).units)
    except UnknownName:
        return _OTHER_UNITS.get(plain, "1")


def _readable(unit: str) -> str:
    """Return ``m/s`` for the unit ``m s-1`` of the vocabulary."""
    return unit.replace(" s-1", "/s").replace(" s-2", "/s2")


def _both_units(plain: str, value: float) -> str:
    """Return a value in SI, and in its display unit if that is another one."""
    try:
        row = lookup(plain)
    except UnknownName:
        return f"{value:g} {_OTHER_UNITS.get(plain, '')}".rstrip()
    if row.units == "1":
        return f"{value:g}"
    text = f"{value:g} {_readable(row.units)}"
    if row.display_units == row.units:
        return text
    return f"{text} ({float(from_si(value, row.display_units)):.4g} {row.display_units})"


def warn_of_odd_time(time: np.ndarray) -> None:
    """Warn of inputs over more than half an hour in coarse steps: mostly times in milliseconds.

    Parameters
    ----------
    time : array (time,)
        [s]

    Warns
    -----
    AeromatchWarning
        With duration and step.
    """
    if len(time) < 2:
        return
    span, step = float(time[-1] - time[0]), float(np.median(np.diff(time)))
    if span > _LONGEST and step >= _COARSEST:
        text = (
            f"the inputs last {span:g} s in {len(time)} samples, {step:g} s apart; inputs of a "
            f"flight last some minutes at most. A column 'time' is in s: write 'time [ms]' if its "
            f"numbers are milliseconds"
        )
        warnings.warn(text, AeromatchWarning, stacklevel=2)
