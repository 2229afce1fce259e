"""Path of an aircraft as its inertial unit drives it from sample to sample."""

from __future__ import annotations

import numpy as np

from flightmech.simulation.driven_path import (
    BIAS,
    LAG,
    SCALE,
    WIND,
    DrivenPath,
    Inertial,
    Surroundings,
    Vanes,
)
from flighttest.reconstruction.problem.problem import (
    PathProblem,
    body_rates,
    inertial_gains,
    sensed_force,
    specific_force,
)
from flighttest.records.sensors.instruments import IMU
from flighttest.records.signals.delays import lag_weights

SCALES = tuple(f"scale.{name}" for name in IMU)
WINDS = ("wind_n", "wind_e", "wind_d")
_VANE_AXES = {"beta_vane": 1, "alpha_vane": 2}  # body axis of the velocity that a vane follows


def _driving_inputs() -> dict[str, int]:
    """Return the constants that act between the samples, with their number in the kernel."""
    inputs = {}
    for i, name in enumerate(IMU):
        inputs[f"bias.{name}"] = BIAS + i
    for i, name in enumerate(SCALES):
        inputs[name] = SCALE + i
    for i, name in enumerate(WINDS):
        inputs[name] = WIND + i
    inputs["lag.vanes"] = LAG
    return inputs


_DRIVING = _driving_inputs()


def path_surroundings(problem: PathProblem) -> Surroundings:
    """Return gravity and the rate of the Earth along a path."""
    return Surroundings(
        problem.g, problem.g_fall, problem.g_height, *problem.earth, problem.gyro_spin
    )


def driven_path(
    problem: PathProblem,
    x: np.ndarray,
    c: np.ndarray,
    columns: np.ndarray,
    part: slice = slice(None),
) -> DrivenPath:
    """Return a path as the inertial unit drives it from sample to sample.

    Parameters
    ----------
    problem : PathProblem
    x, c : array (N, n), (nc,)
        States of the path and constants.
    columns : array of int
        Indices of the constants to differentiate by.
    part : slice
        Samples of the path; all by default.
    """
    constants = problem.constants
    unit = Inertial(
        rates=body_rates(problem, c)[part],
        force=specific_force(problem, c)[part],
        sensed=sensed_force(problem, c)[part],
        gain=inertial_gains(problem, c),
        arm=problem.arm,
    )
    weights = (np.zeros(3), np.zeros(3))
    if problem.vanes:
        weights = lag_weights(constants.get(c, "lag.vanes"), problem.dt)
    wind = np.array([constants.get(c, name) for name in WINDS])
    axes = [_VANE_AXES[name] for name in problem.vanes]
    vanes = Vanes(axes, problem.vane_arms, wind, *weights)
    inputs = [_DRIVING[constants.names[i]] for i in columns]
    return DrivenPath(
        unit,
        x[part],
        dt=problem.dt,
        around=path_surroundings(problem),
        inputs=inputs,
        vanes=vanes,
        gusts=problem.has_gust_velocity,
        slow=slow_steps(problem.airborne[part]),
    )


def driving_constants(problem: PathProblem, free: np.ndarray | None = None) -> np.ndarray:
    """Return the indices of the constants that act between the samples of a path.

    Parameters
    ----------
    problem : PathProblem
    free : array of bool (nc,), optional
        Constants to choose from; all by default.
    """
    indices = []
    for i, name in enumerate(problem.constants.names):
        if name in _DRIVING and (free is None or free[i]):
            indices.append(i)
    return np.array(indices, int)


def slow_steps(airborne: np.ndarray) -> np.ndarray:
    """Return the steps over which the speed is too low for the vanes."""
    return ~(airborne[1:] & airborne[:-1])
