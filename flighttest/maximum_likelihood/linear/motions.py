"""Linear motions about a steady flight: short period and lateral motion, without a database.

Dimensional derivatives of [McRuer]_ 4 and 5, per second. Moments contain the products of inertia
(primed derivatives). Angles are those of the motion relative to the steady wind.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from flightmech.units import G0
from flighttest.maximum_likelihood.linear.state_space import LinearModel
from flighttest.maximum_likelihood.unknowns import Unknown

MOTIONS = ("short-period", "lateral")


class Motion(NamedTuple):
    """Names of a linear motion.

    Attributes
    ----------
    states : tuple of str
        States with aerodynamic rates.
    angle : str
        Angle of the airflow.
    force : str
        Output of the accelerometer, V times the rate of the angle that forces cause.
    rates : mapping of str to str
        Letter of the derivatives of each state.
    controls : tuple of str
    """

    states: tuple[str, ...]
    angle: str
    force: str
    rates: Mapping[str, str]
    controls: tuple[str, ...]


_MOTIONS = {
    "short-period": Motion(("alpha", "q"), "alpha", "az", {"alpha": "Z", "q": "M"}, ("delta_e",)),
    "lateral": Motion(
        ("beta", "p", "r"),
        "beta",
        "ay",
        {"beta": "Y", "p": "L", "r": "N"},
        ("delta_a", "delta_r"),
    ),
}
# The rate of the angle depends on the angle and the controls; rotation moves it by kinematics.
_KINEMATIC = ("alpha", "beta")


class Steady(NamedTuple):
    """Mean flight condition: true airspeed [m/s], angle of attack and pitch attitude [rad]."""

    V: float
    alpha: float
    theta: float


def motion_of(name: str) -> Motion:
    """Return a motion; raise ValueError for an unknown name."""
    if name not in _MOTIONS:
        raise ValueError(f"motion is {name!r}; allowed: {', '.join(MOTIONS)}")
    return _MOTIONS[name]


def steady_condition(records: Sequence[xr.Dataset]) -> Steady:
    """Return the mean condition of all records."""
    means = []
    for name in ("V", "alpha", "theta"):
        means.append(float(np.concatenate([record[name].values for record in records]).mean()))
    return Steady(*means)


def derivative_names(motion: Motion, controls: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Return rate and cause of every derivative by its name, such as ``M_alpha``."""
    names = {}
    for rate in motion.states:
        causes = [motion.angle] if rate in _KINEMATIC else list(motion.states)
        for cause in (*causes, *controls):
            # Ailerons have hardly any side force.
            if not (rate == "beta" and cause == "delta_a"):
                names[f"{motion.rates[rate]}_{cause}"] = rate, cause
    return names


def linear_motion(
    motion: Motion,
    steady: Steady,
    controls: Sequence[str],
    reference: Mapping[str, float] | None = None,
) -> LinearModel:
    """Return the linear model of a motion, with its derivatives as parameters, zero by default.

    Parameters
    ----------
    motion : Motion
    steady : Steady
    controls : sequence of str
        Controls that move.
    reference : mapping of str to float, optional
        Trim of angle, force and controls, see `trim_of`; default 0.

    References
    ----------
    .. [McRuer] McRuer, Ashkenas, Graham, Aircraft dynamics and automatic control, 1973.
    """
    names = derivative_names(motion, controls)
    is_lateral = motion.angle == "beta"
    states = (*motion.states, "phi") if is_lateral else motion.states
    outputs = (*states, motion.force)
    n, m = len(states), len(controls)

    def matrices(values: Mapping[str, float]) -> list[np.ndarray]:
        A, B = np.zeros((n, n)), np.zeros((n, m))
        for name, (rate, cause) in names.items():
            row = states.index(rate)
            if cause in controls:
                B[row, controls.index(cause)] = values.get(name, 0.0)
            else:
                A[row, states.index(cause)] = values.get(name, 0.0)
        # az = V (alpha' - q), ay = V (beta' + r cos alpha - p sin alpha - g / V phi cos theta):
        # the accelerometer feels the aerodynamic part of the rate.
        C = np.vstack([np.eye(n), steady.V * A[0]])
        D = np.vstack([np.zeros((n, m)), steady.V * B[0]])
        if is_lateral:
            turn = G0 / steady.V * np.cos(steady.theta)
            A[0, 1:] = np.sin(steady.alpha), -np.cos(steady.alpha), turn
            A[3, 1:3] = 1.0, np.tan(steady.theta)
        else:
            A[0, 1] = 1.0
        return [A, B, C, D]

    trim = dict(reference or {})
    return LinearModel(
        states, tuple(controls), outputs, matrices=matrices, parameters=tuple(names), reference=trim
    )


def trim_of(
    motion: Motion, controls: Sequence[str], records: Sequence[xr.Dataset]
) -> dict[str, float]:
    """Return the means of angle, force and controls over all records.

    With them the constants of the records are small, and the search starts near. Rates and bank
    have none: a constant rate is a constant change of the bank.
    """
    trim = {}
    for name in (motion.angle, motion.force, *controls):
        trim[name] = float(np.concatenate([record[name].values for record in records]).mean())
    return trim


def start_values(
    model: LinearModel, motion: Motion, records: Sequence[xr.Dataset]
) -> dict[str, Unknown]:
    """Return starts of the derivatives, and constants and first states of every record.

    The derivatives start from least squares of the states on integrals of states and controls, in
    which noise is small.
    """
    unknowns: dict[str, Unknown] = {}
    names = derivative_names(motion, model.inputs)
    kinematic = model.at({}).A
    for row, rate in enumerate(motion.states):
        own = {name: cause for name, (of, cause) in names.items() if of == rate}
        parts, targets = [], []
        for number, record in enumerate(records):
            t = record["time"].values
            columns = [record[c].values - model.reference.get(c, 0.0) for c in own.values()]
            x = np.column_stack([_integral(column, t) for column in columns])
            moved = [kinematic[row, k] * record[s].values for k, s in enumerate(model.states)]
            known = _integral(np.sum(moved, axis=0), t)
            # Each record has its constant and its drift.
            constants = np.zeros((len(t), 2 * len(records)))
            constants[:, 2 * number], constants[:, 2 * number + 1] = 1.0, t - t[0]
            parts.append(np.column_stack([x, constants]))
            targets.append(record[rate].values - known)
        found = np.linalg.lstsq(np.concatenate(parts), np.concatenate(targets), rcond=None)[0]
        unknowns |= {name: Unknown(float(value)) for name, value in zip(own, found)}
        drift = float(found[len(own) + 1 :: 2].mean())
        unknowns[f"drift.{rate}"] = Unknown(drift, own=True)
    for name in model.states:
        first = float(np.mean([record[name].values[:5].mean() for record in records]))
        unknowns[f"init.{name}"] = Unknown(first - model.reference.get(name, 0.0), own=True)
    unknowns[f"sensor.{motion.force}"] = Unknown(0.0, own=True)
    return unknowns


def _integral(x: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return the integral from the first sample on, by trapezia."""
    areas = 0.5 * (x[1:] + x[:-1]) * np.diff(t)
    return np.concatenate([[0.0], np.cumsum(areas)])
