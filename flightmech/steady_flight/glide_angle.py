"""Path angle of a steady glide of an aircraft without engines."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import scipy

from flightmech.errors import SimulationError
from flightmech.steady_flight.compiled_aircraft import CompiledAircraft

# Path angle if there is no steady glide; the flight is then reported as not trimmed. [rad]
_NO_GLIDE = -0.05
_STEEPEST = 1.4  # steepest path angle of the search, without its sign [rad]
_GRID_SIZE = 29  # path angles of the grid search, every 0.05 rad
_ANGLE_TOLERANCE = 1e-12  # of the path angle [rad]


def find_glide_angle(compiled: CompiledAircraft, parameters: Mapping[str, float]) -> float:
    """Return the path angle at constant speed without thrust; a default if none exists. [rad]

    The default is -0.05 rad. Its flight is not trimmed, which `Point.is_trimmed` shows.
    """

    def speed_gain(gamma: float) -> float:
        return compiled.trim_outputs({**parameters, "init.gamma": gamma})["trim.u_dot"]

    try:
        search = scipy.optimize.root_scalar(
            speed_gain,
            x0=_NO_GLIDE,
            x1=2.0 * _NO_GLIDE,
            method="secant",
            xtol=_ANGLE_TOLERANCE,
            maxiter=50,
        )
    except SimulationError:
        # the secant method reached a path angle at which the kernel cannot trim
        return _bracket_glide_angle(speed_gain)
    if search.converged and abs(search.root) < _STEEPEST:
        return float(search.root)
    return _bracket_glide_angle(speed_gain)


def _bracket_glide_angle(speed_gain: Callable[[float], float]) -> float:
    """Return the shallowest root of the speed gain, from a grid and its refinement. [rad]"""
    grid = np.linspace(0.0, -_STEEPEST, _GRID_SIZE)
    gains = np.array([speed_gain(float(gamma)) for gamma in grid])
    changes = np.flatnonzero(np.sign(gains[:-1]) * np.sign(gains[1:]) <= 0.0)
    if not changes.size:
        return _NO_GLIDE
    bracket = grid[changes[0]], grid[changes[0] + 1]
    search = scipy.optimize.root_scalar(
        speed_gain, bracket=bracket, method="brentq", xtol=_ANGLE_TOLERANCE
    )
    return float(search.root)
