"""Curves of a strut and of a tyre from measured loads, where compression, slip and forces are given sample by sample (rig, drop test)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from ..expressions.separable_model import SeparableModel
from ..separable.regression import regress_separable
from .result import GearConstant

_STIFFEST = (0.5, 60.0)  # cornering stiffness over friction [rad-1]
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
        A variable that the data do not hold.
    """
    model = SeparableModel.parse("load = s + s^2 + rate*abs(rate)", units={"load": "N", "s": "m", "rate": "m s-1"})
    data = [drop.rename(compression="s").isel(time=np.flatnonzero(drop["compression"].values > touching)) for drop in drops]
    fit = regress_separable(model, data, "strut")
    terms = {"stiffness": "s", "stiffness_square": "s^2", "orifice": "rate*abs(rate)"}
    return {name: GearConstant(*fit.value(term), _SOURCE) for name, term in terms.items()}


def fit_side_force(points: xr.Dataset) -> dict[str, GearConstant]:
    """Fit Fy = -mu Fz tanh(g slip / mu) to side forces of a rolling wheel.

    Parameters
    ----------
    points : Dataset (time,) or (point,)
        ``load`` [N], ``slip`` [rad], ``side_force`` (to the right for a wheel that moves to its left) [N].

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
    time = {"time": points["time"].values if dim == "time" else np.arange(points.sizes[dim], dtype=float)}
    data = xr.Dataset({name: ("time", points[name].values) for name in units if name in points}, time)
    fit = regress_separable(model, data, "side force")
    values, C = fit.derived("-[load*tanh(g*slip)]", "-[load*tanh(g*slip)]*g")
    return {name: GearConstant(float(x), float(v**0.5), _SOURCE) for name, x, v in zip(("mu", "cornering"), values, C.diagonal())}
