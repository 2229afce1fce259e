"""What a trim ends with, in words: ends of tables, limits, greatest lift, remaining accelerations.

Beyond its first and last breakpoint a table holds its value, so that its variable has no effect
there.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import NamedTuple

import numpy as np

from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import AXIS, INPUT
from flightmech.units import from_si

TRIMMED = 3e-4
"""Largest acceleration of a trimmed flight, rotations at half the span. [m s-2]

It is 0.001 ft/s2, as in the trim of JSBSim (FGTrim): 3e-5 of gravity, less than an accelerometer of
a flight test shows. `TRIMMED` of the kernel has the same value.
"""
# Remaining acceleration that is stated: where all can vanish, the kernel leaves 1e-11. [m s-2]
STATED = 1e-6
# Accelerations of a trim, with the control whose moment balances each.
_BALANCED_BY = {
    "u": "",
    "v": "delta_r",
    "w": "",
    "p": "delta_a",
    "q": "delta_e",
    "r": "delta_r",
}
# Distance beyond a table that counts, of its range: rounding, and what a limit may stand over.
_ROUNDING, _SLIGHT = 1e-6, 0.01
# Airspeed below which flow angles have no meaning. [m s-1]
_SLOWEST = 15.0
_FLOW = ("alpha", "beta")
# The effect of the ground ends with its table, on either side, by design; below the first Mach
# number the air counts as incompressible.
_GROUND, _MACH = "h_agl", "mach"
_AT_MAXIMUM = 0.98  # of the greatest lift coefficient: at the maximum


class TableEnds(NamedTuple):
    """Range that all tables over a variable share. [SI]"""

    low: float
    high: float
    unit: str


def shared_ranges(sim: SimModel) -> dict[str, TableEnds]:
    """Return the range that all tables of the coefficients share, by variable.

    A table with one breakpoint has no range. Tables of engines and legs are left out.
    """
    ranges: dict[str, TableEnds] = {}
    for row in sim.entries(AXIS):
        if row.low == row.high or "." in row.name or row.name == _GROUND:
            continue
        ends = ranges.get(row.name, TableEnds(-np.inf, np.inf, row.display_units))
        ranges[row.name] = ends._replace(low=max(ends.low, row.low), high=min(ends.high, row.high))
    return ranges


def describe_tables_left(sim: SimModel, state: Mapping[str, float]) -> dict[str, str]:
    """Return a text for each variable of a state that is beyond its tables, by variable.

    Parameters
    ----------
    sim : SimModel
        The model.
    state : mapping of str to float
        Outputs of the model; ``applied.delta_e`` is the deflection that its tables see. [SI]
    """
    texts = {}
    for name, ends in shared_ranges(sim).items():
        value = state.get(f"applied.{name}", state.get(name))
        if value is None or (name in _FLOW and state.get("V", np.inf) < _SLOWEST):
            continue
        if name == _MACH and value < ends.low:
            continue
        text = _describe_beyond(name, value, ends, _ROUNDING)
        if text:
            texts[name] = text
    return texts


def describe_limits_beyond_tables(sim: SimModel) -> list[str]:
    """Return a text for each limit of a control that is beyond the tables over the control.

    Up to 1 % of the range beyond a table is left out. This is not a warning: many tables end before
    the stop of the control, and no flight needs to go there.
    """
    ranges = shared_ranges(sim)
    texts = []
    for row in sim.entries(INPUT):
        if row.name not in ranges:
            continue
        for limit in (row.low, row.high):
            # a control without limits has those of the numbers
            if abs(limit) < np.sqrt(np.finfo(float).max):
                texts.append(
                    _describe_beyond(f"limit of {row.name}", limit, ranges[row.name], _SLIGHT)
                )
    return [text for text in texts if text]


def describe_inputs_beyond_limits(sim: SimModel, start: Mapping[str, float]) -> list[str]:
    """Return a text for each input of a start that is beyond its limits.

    The model flies with the value; the control of the aircraft does not reach it.

    Parameters
    ----------
    sim : SimModel
        The model.
    start : mapping of str to float
        Parameters and inputs of a trimmed flight. [SI]
    """
    texts = []
    for row in sim.entries(INPUT):
        value = start.get(row.name, 0.0)
        slack = _ROUNDING * (row.high - row.low) if np.isfinite(row.high - row.low) else 0.0
        if row.low - slack <= value <= row.high + slack:
            continue
        limit = row.low if value < row.low else row.high
        texts.append(
            f"{row.name} {_show(value, row.display_units)} is beyond its limit of "
            f"{_show(limit, row.display_units)}"
        )
    return texts


def weigh_accelerations(outputs: Mapping[str, float], span: float) -> dict[str, float]:
    """Return the sizes of the six accelerations that a trim left, rotations at half the span.

    Parameters
    ----------
    outputs : mapping of str to float
        Outputs of the kernel at the start: ``trim.u_dot`` ... ``trim.r_dot``. [SI]
    span : float
        Wing span. [m]

    Returns
    -------
    dict of str to float
        By the letter of the acceleration, ``u v w p q r``. [m s-2]
    """
    weighted = {}
    for letter in _BALANCED_BY:
        arm = 0.5 * span if letter in "pqr" else 1.0
        weighted[letter] = arm * abs(outputs[f"trim.{letter}_dot"])
    return weighted


def describe_accelerations(outputs: Mapping[str, float], letters: Collection[str]) -> str:
    """Return ``v_dot -0.016 m/s2, r_dot -0.001 rad/s2`` for some of the six accelerations."""
    texts = []
    for letter in letters:
        unit = "rad/s2" if letter in "pqr" else "m/s2"
        texts.append(f"{letter}_dot {outputs[f'trim.{letter}_dot']:.3g} {unit}")
    return ", ".join(texts)


def describe_missing_terms(letters: Collection[str], missing: Mapping[str, str]) -> list[str]:
    """Return a text for each term that the database lacks and that would balance accelerations.

    Parameters
    ----------
    letters : collection of str
        Accelerations that remain, such as ``v`` and ``r``.
    missing : mapping of str to str
        The term that is missing by control, as ``{"delta_r": "Cn/rudder"}``.
    """
    texts = []
    for control, term in missing.items():
        unbalanced = [f"{letter}_dot" for letter in letters if _BALANCED_BY[letter] == control]
        if unbalanced:
            texts.append(
                f"the database has no term of {control} that balances {' and '.join(unbalanced)}, "
                f"such as {term}"
            )
    return texts


def _describe_beyond(name: str, value: float, ends: TableEnds, slack: float) -> str:
    """Return ``delta_e -27 deg is beyond its table, which ends at -25 deg``; empty if it is not."""
    margin = slack * (ends.high - ends.low)
    if ends.low - margin <= value <= ends.high + margin:
        return ""
    end = ends.low if value < ends.low else ends.high
    return (
        f"{name} {_show(value, ends.unit)} is beyond its table, which ends at "
        f"{_show(end, ends.unit)}"
    )


def _show(value: float, unit: str) -> str:
    number = f"{from_si(value, unit):.4g}"
    return number if unit == "1" else f"{number} {unit}"


def describe_greatest_lift(CL: float, alpha: float, curve: tuple[np.ndarray, np.ndarray]) -> str:
    """Return ``CL 1.52 is at its maximum, near alpha 16 deg``; empty if it is below.

    Parameters
    ----------
    CL, alpha : float
        Lift coefficient and angle of attack of the flight. [1, rad]
    curve : tuple of array (alpha,)
        Angles of attack over the tables, and the lift coefficient there with all else as in the
        flight. [rad, 1]
    """
    angles, lift = curve
    top = int(np.argmax(lift))
    is_there = _AT_MAXIMUM * lift[top] <= CL or alpha > angles[top]
    if not (lift[top] > 0.0 and is_there):
        return ""
    return f"CL {CL:.3f} is at its maximum, near alpha {np.degrees(angles[top]):.3g} deg"


def alpha_grid(sim: SimModel) -> np.ndarray:
    """Return angles of attack over the tables, every quarter of a degree; none without tables."""
    ends = shared_ranges(sim).get("alpha")
    if ends is None:
        return np.empty(0)
    count = int(np.ceil(np.degrees(ends.high - ends.low) * 4.0)) + 1
    return np.linspace(ends.low, ends.high, count)
