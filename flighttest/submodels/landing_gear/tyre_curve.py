"""Error of the cornering stiffness by the form of the tyre curve.

The curve of the model is the brush. A real tyre has another one, and the initial stiffness of the
brush nearest to it is not its own. The size of this difference is that between the brush and the
magic formula of [Pacejka]_ with the factors that JSBSim gives a tyre by default:

    Fy = mu N sin(c atan(x - e (x - atan x))),   x = C tan(slip) / (c mu N)

References
----------
.. [Pacejka] Pacejka, Tyre and Vehicle Dynamics, 3rd ed., 2012, section 4.3.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import scipy
import xarray as xr

from flighttest.submodels.landing_gear.explicit import FRICTION, LOAD, MOVING, brush_side_force
from flighttest.submodels.landing_gear.wheel_positions import WheelGroup

# shape c and curvature e of JSBSim's FGLGear
_SHAPE, _CURVATURE = 2.8, 1.03
_LARGEST = 3.0  # factor between two stiffnesses, at most
_AT_LIMIT = 0.01  # relative distance to a limit below which the factor is at it
_NO_SLIP = 1e-6  # tangent of the slip angle below which a wheel has no side force


class CurveError(NamedTuple):
    """Error of a cornering stiffness by the form of the tyre curve.

    Attributes
    ----------
    relative : float
        Error over the stiffness. [1]
    is_least : bool
        Whether the stiffnesses differ by the largest factor that is tried: the error is larger.
    """

    relative: float
    is_least: bool


def curve_error(
    constants: Mapping[str, float], group: WheelGroup, loads: Sequence[xr.Dataset]
) -> CurveError | None:
    """Return the error of the cornering stiffness of a group, or None if no wheel of it slips.

    The magic formula is fitted to the side forces of the brush at the recorded loads and slip
    angles, with the same friction; the result is the relative difference of both stiffnesses.

    Parameters
    ----------
    constants : mapping of str to float
        Friction, cornering stiffness and bend, named as in `explicit`.
    group : WheelGroup
    loads : sequence of Dataset
        Of `wheel_loads`, one of each record.
    """
    friction = constants[FRICTION]
    wheels, columns = list(group.names), [f"load.{name}" for name in group.names]
    loads_of, tangents = [], []
    for record in loads:
        along, across = (record[name].sel(wheel=wheels).values for name in ("along", "across"))
        N = record["force"].sel(output=columns).values
        rolls = (record["speed"].values[:, None] > MOVING) & (along > MOVING) & (N > 0.0)
        loads_of.append(N[rolls])
        tangents.append(across[rolls] / along[rolls])
    N, tangent = np.concatenate(loads_of), np.concatenate(tangents)
    if not (np.abs(tangent) > _NO_SLIP).any():
        return None
    bend = constants.get(group.parameter("bend"), 0.0)
    C = constants[group.parameter("cornering")] * N / (1.0 + bend * (N / LOAD) ** 2)
    force = brush_side_force(N, tangent, C, friction, np.zeros_like(N))

    def misfit(factor: float) -> float:
        return float(((magic_side_force(N, tangent, factor * C, friction) - force) ** 2).sum())

    limits = (1.0 / _LARGEST, _LARGEST)
    found = scipy.optimize.minimize_scalar(misfit, bounds=limits, method="bounded")
    factor = float(found.x)
    is_least = min(abs(factor / limit - 1.0) for limit in limits) < _AT_LIMIT
    return CurveError(abs(factor - 1.0), is_least)


def magic_side_force(load, tangent, C, mu) -> np.ndarray:
    """Return the side force of the magic formula, as `brush_side_force` without brake. [N]"""
    most = np.maximum(mu * load, 1e-9)
    x = C * tangent / (_SHAPE * most)
    return most * np.sin(_SHAPE * np.arctan(x - _CURVATURE * (x - np.arctan(x))))
