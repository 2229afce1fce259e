"""A speed that is far outside of the tables of a model: mostly a number in another unit."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from flightmech.errors import AeromatchError, AeromatchWarning
from flightmech.names import value_text
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import AXIS
from flightmech.simulation.run import constant_inputs, initialise_run
from flightmech.simulation.stated_values.odd_values import describe_odd_values
from flightmech.steady_flight.flight_condition import SPEEDS, condition_parameters
from flightmech.steady_flight.trim_findings import shared_ranges
from flightmech.units import from_si, to_si

_BEYOND_MACH = 1.2
"""Mach number over the end of the tables from which on a speed is odd."""
_LEAST_LOAD = 0.8
"""Largest load factor of the tables below which a flight is far below the speed of the stall."""
_STEP = 0.02
"""Step of the angles of attack. [rad]"""


class _Reach(NamedTuple):
    """Mach number over the last one of the tables, and the largest load factor at a speed."""

    mach: float
    mach_ratio: float
    load: float

    @property
    def is_usual(self) -> bool:
        return self.mach_ratio <= 1.0 and self.load >= 1.0


def describe_odd_speed(sim: SimModel, values: Mapping[str, float]) -> str:
    """Return what is odd of the speed of a condition, empty if it is in reach of the tables.

    Parameters
    ----------
    sim : SimModel
        The compiled model.
    values : mapping of str to float
        Parameters, inputs and quantities of a flight, with or without ``init.``. [SI]

    Returns
    -------
    str
        A Mach number far beyond the tables, or a speed at which the greatest lift of the tables
        does not carry the weight, with the unit that is meant if the number fits in it.
    """
    named = {name.removeprefix("init."): value for name, value in values.items()}
    speeds = [name for name in SPEEDS if name in named]
    if len(speeds) != 1:
        return ""
    (speed,) = speeds
    # a trim refuses a slower flight
    if not named[speed] > (0.0 if speed == "mach" else 1.0):
        return ""
    reach = _reach(sim, named, speed, named[speed])
    if reach is None:
        return ""
    shown = value_text(speed, named[speed])
    if speed != "mach":
        shown = f"{speed} {named[speed]:.4g} m/s ({shown})"
    if reach.mach_ratio > _BEYOND_MACH:
        last = reach.mach / reach.mach_ratio
        text = f"{shown} is Mach {reach.mach:.3g}, and the tables end at Mach {last:.3g}"
    elif reach.load < _LEAST_LOAD:
        text = f"{shown} is below the stall: the greatest lift of the tables carries "
        text += f"{reach.load:.0%} of the weight"
    else:
        return ""
    if speed == "mach":
        return f"{text}; check the decimal point, or write a speed as V"
    # a number in knots taken as m/s, and the reverse
    knots = float(from_si(named[speed], "kt"))
    meant = {
        f"{named[speed]:.4g} kt": float(to_si(named[speed], "kt", "m s-1")),
        f"{knots:.4g} m/s": knots,
    }
    for number, other in meant.items():
        candidate = _reach(sim, named, speed, other)
        if candidate is not None and candidate.is_usual:
            return f'{text}; is {number} meant? write {speed} = "{number}"'
    return text


def describe_odd_flight(sim: SimModel, stated: Mapping[str, float]) -> list[str]:
    """Return stated values that no aeroplane has, and a speed far outside of the tables.

    Parameters
    ----------
    sim : SimModel
        The compiled model.
    stated : mapping of str to float
        Parameters, inputs and quantities of a flight that a caller states. [SI]

    Returns
    -------
    list of str
        One line each.
    """
    texts = [*describe_odd_values(sim, stated), describe_odd_speed(sim, stated)]
    return [text for text in texts if text]


def warn_of_odd_speed(sim: SimModel, stated: Mapping[str, float]) -> None:
    """Warn of the line of `describe_odd_speed`."""
    if text := describe_odd_speed(sim, stated):
        warnings.warn(text, AeromatchWarning, stacklevel=3)


def warn_of_odd_flight(sim: SimModel, stated: Mapping[str, float]) -> None:
    """Warn of each line of `describe_odd_flight`."""
    for text in describe_odd_flight(sim, stated):
        warnings.warn(text, AeromatchWarning, stacklevel=3)


def _all_angles(sim: SimModel) -> np.ndarray:
    """Return angles of attack over the longest table; none without tables. [rad]"""
    ends = [(row.low, row.high) for row in sim.entries(AXIS) if row.name == "alpha"]
    if not ends:
        return np.empty(0)
    return np.arange(min(low for low, _ in ends), max(high for _, high in ends), _STEP)


def _reach(sim: SimModel, named: Mapping[str, float], kind: str, speed: float) -> _Reach | None:
    """Return what the tables give at a speed, None where the condition has no meaning."""
    allowed = {"h", *sim.inputs, *sim.parameters}
    condition = {name: value for name, value in named.items() if name in allowed}
    condition |= {f"mass.{name}": named[name] for name in named if f"mass.{name}" in allowed}
    angles, mach = _all_angles(sim), shared_ranges(sim).get("mach")
    try:
        start = condition_parameters(sim, {**condition, kind: speed})
        start |= {"mode.trim": 0.0}
        inputs = constant_inputs(sim, start)
        loads, machs = [], []
        for alpha in angles if angles.size else [0.0]:
            run = initialise_run(sim, {**start, "init.alpha": float(alpha)}, inputs)
            outputs = run.outputs()
            loads.append(outputs[sim.outputs.index("nz")])
            machs.append(outputs[sim.outputs.index("mach")])
    except AeromatchError:
        # the trim itself reports such a condition
        return None
    ratio = 0.0 if mach is None else machs[0] / mach.high
    # without tables over the angle of attack nothing is known of the stall
    load = float(np.max(loads)) if angles.size else 1.0
    return _Reach(float(machs[0]), float(ratio), load)
