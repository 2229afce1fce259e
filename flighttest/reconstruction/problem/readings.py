"""Linearised readings of the sensors along a path.

A reading lies between two samples of the path. Its position is the sample k before it and the
fraction f of the step, so the state at the reading is (1-f) x_k + f x_k+1.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flighttest.reconstruction.problem.problem import (
    PathProblem,
    Sensor,
    body_rates,
    inertial_gains,
)
from flighttest.records.sensors.instruments import IMU

_GYROS = IMU[:3]
# s: a reading this close before a sample belongs to the sample. Clocks have rounding errors.
_CLOCK_ROUNDING = 1e-9
# Fraction of a step below which a reading counts as taken at the sample.
_SAME_SAMPLE = 1e-6


def reading_positions(
    problem: PathProblem, sensor: Sensor, c: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions of the readings of a sensor, without its delay.

    Returns
    -------
    k : array of int (M,)
        Sample before each reading.
    f : array (M,)
        Fraction of the step from sample k to the reading.
    """
    delay = 0.0
    if sensor.delay:
        delay = problem.constants.get(c, sensor.delay)
    instants = sensor.time - delay
    following = np.searchsorted(problem.time, instants + _CLOCK_ROUNDING, side="right")
    k = np.clip(following - 1, 0, len(problem.time) - 1)
    f = (instants - problem.time[k]) / problem.dt
    # No step follows the last sample of a segment.
    ends_segment = ~np.append(problem.linked, False)
    return k, np.where((np.abs(f) < _SAME_SAMPLE) | ends_segment[k], 0.0, f)


def states_and_rates(problem: PathProblem, x: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Return states and body rates (N, n + 3)."""
    return np.concatenate([x, body_rates(problem, c)], axis=1)


def linearise_sensor(problem: PathProblem, sensor: Sensor, values: np.ndarray, c: np.ndarray):
    """Return the output of a sensor, linearised at its readings.

    Parameters
    ----------
    problem : PathProblem
    sensor : Sensor
    values : array (N, n + 3)
        The path, see `states_and_rates`.
    c : array (nc,)
        Constants.

    Returns
    -------
    r : array (M, m)
        Model minus reading.
    k, f : array (M,)
        Positions of the readings, see `reading_positions`.
    J : array (M, m, n) or (1, m, n)
        Derivative by the state at k + f, of each reading or of all.
    columns : array of int
        Indices of the constants involved.
    Jc : array (M, m, columns)
        Derivative by these constants.
    """
    n = problem.states
    k, f = reading_positions(problem, sensor, c)
    state = _interpolate(values, k, f)
    y, J, names, Jc = sensor.model(sensor, problem, state, c)
    slopes: list[np.ndarray] = []
    if sensor.delay:
        names = (*names, sensor.delay)
        slopes.append(_slope_by_delay(problem, values, k, J))
    if J.shape[-1] > n:
        # The output depends on the body rates too. Only the errors of the gyros are unknown.
        for name, axis, slope in _rate_slopes(problem, c, state[:, n:]):
            names = (*names, name)
            slopes.append(J[..., n + axis] * slope)
    if slopes:
        Jc = np.concatenate([Jc, np.stack(slopes, axis=-1)], axis=-1)
    return y - sensor.z, k, f, J[..., :n], problem.constants.index(*names), Jc


def sensor_residuals(
    problem: PathProblem, sensor: Sensor, x: np.ndarray, c: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return readings minus model (M, m) of a sensor and the nearest sample of each (M,)."""
    k, f = reading_positions(problem, sensor, c)
    state = _interpolate(states_and_rates(problem, x, c), k, f)
    y, *_ = sensor.model(sensor, problem, state, c)
    return sensor.z - y, k + (f > 0.5)


def _slope_by_delay(
    problem: PathProblem, values: np.ndarray, k: np.ndarray, J: np.ndarray
) -> np.ndarray:
    """Return the derivative of the outputs by the delay (M, m): minus their rate of change."""
    before, after = _neighbours(values, k)
    step = (after - before)[:, : J.shape[-1]]
    if problem.shown:
        # Such gust states belong to the readings, not to the instant in the air.
        step[:, problem.gusts] = 0.0
    if len(J) == 1:
        change = step @ J[0].T
    else:
        change = np.einsum("kij,kj->ki", J, step)
    return change / -problem.dt


def _rate_slopes(
    problem: PathProblem, c: np.ndarray, omega: np.ndarray
) -> Iterator[tuple[str, int, np.ndarray | float]]:
    """Yield each constant of the gyros, its axis, and the derivative of the body rate by it."""
    gain = inertial_gains(problem, c)
    # omega = (reading - bias) gain, gain = 1/(1 + scale)
    for axis, name in enumerate(_GYROS):
        if f"bias.{name}" in problem.constants:
            yield f"bias.{name}", axis, -gain[axis] * 1.0
    for axis, name in enumerate(_GYROS):
        if f"scale.{name}" in problem.constants:
            yield f"scale.{name}", axis, -gain[axis] * omega[:, axis, None]


def _neighbours(values: np.ndarray, k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return values (N, n) at samples k (M,) and at the samples after them."""
    last = len(values) - 1
    consecutive = len(k) and k[-1] - k[0] == len(k) - 1 and (np.diff(k) == 1).all()
    if not consecutive:
        return values[k], values[np.minimum(k + 1, last)]
    # Readings with the clock of the path need views only, no copy.
    before = values[k[0] : k[-1] + 1]
    if k[-1] < last:
        return before, values[k[0] + 1 : k[-1] + 2]
    return before, np.concatenate([before[1:], values[-1:]])


def _interpolate(values: np.ndarray, k: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Return values (N, n) at the positions k + f (M, n)."""
    before, after = _neighbours(values, k)
    if not f.any():
        return before
    return (1.0 - f)[:, None] * before + f[:, None] * after
