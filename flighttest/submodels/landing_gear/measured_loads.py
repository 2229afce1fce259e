"""Fits of strut and tyre constants to directly measured loads."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from flighttest.regression.separable.fit import regress_separable
from flighttest.regression.separable_model import SeparableModel
from flighttest.submodels.landing_gear.result import GearConstant

# Range of the cornering stiffness over friction. [rad-1]
_STIFFEST = (0.5, 60.0)
_SOURCE = "measured loads"


def fit_strut(drops: Sequence[xr.Dataset], touching: float = 2e-3) -> dict[str, GearConstant]:
    """Fit F = K1 s + K2 s^2 + C s' |s'| to touch-downs.

    Parameters
    ----------
    drops : sequence of Dataset (time,)
        ``compression`` [m], ``rate`` [m s-1], ``load`` [N].
    touching : float
        Compression below which the wheel may be off the ground. [m]

    Returns
    -------
    dict of str to GearConstant
        ``stiffness`` [N m-1], ``stiffness_square`` [N m-2], ``orifice`` [N s2 m-2].

    Raises
    ------
    IdentificationError
        Too few samples, or terms that they do not distinguish.
    UnknownName
        The data do not contain a variable.
    """
    model = SeparableModel.parse(
        "load = s + s^2 + rate*abs(rate)", units={"load": "N", "s": "m", "rate": "m s-1"}
    )
    # The spring carries the load only while the wheel touches.
    data = []
    for drop in drops:
        on_ground = np.flatnonzero(drop["compression"].values > touching)
        data.append(drop.rename(compression="s").isel(time=on_ground))
    fit = regress_separable(model, data, "strut")
    terms = {"stiffness": "s", "stiffness_square": "s^2", "orifice": "rate*abs(rate)"}
    return {name: GearConstant(*fit.value(term), _SOURCE) for name, term in terms.items()}


def fit_side_force(points: xr.Dataset) -> dict[str, GearConstant]:
    """Fit Fy = -mu Fz tanh(g slip / mu) to side forces of a rolling wheel.

    Parameters
    ----------
    points : Dataset (time,) or (point,)
        ``load`` [N], ``slip`` [rad], ``side_force`` (to the right for a wheel that moves to its
        left) [N].

    Returns
    -------
    dict of str to GearConstant
        ``mu`` [1], ``cornering``: cornering stiffness over load [rad-1].

    Raises
    ------
    IdentificationError, UnknownName
        As `fit_strut`.
    """
    units = {"side_force": "N", "load": "N", "slip": "rad"}
    model = SeparableModel.parse("side_force = load*tanh(g*slip)", {"g": _STIFFEST}, units)
    (dim,) = points["load"].dims
    time = np.arange(points.sizes[dim], dtype=float)
    if dim == "time":
        time = points["time"].values
    columns = {name: ("time", points[name].values) for name in units if name in points}
    fit = regress_separable(model, xr.Dataset(columns, {"time": time}), "side force")
    # The coefficient of the term is -mu, and g is the cornering stiffness over mu.
    values, C = fit.derived("-[load*tanh(g*slip)]", "-[load*tanh(g*slip)]*g")
    constants = {}
    for name, value, variance in zip(("mu", "cornering"), values, C.diagonal()):
        constants[name] = GearConstant(float(value), float(variance**0.5), _SOURCE)
    return constants
