"""Figures of fits to the points of a balance, as surfaces over the angles of the flow."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flightmech.support.figures import demand_drawable, new_figure, write_figure
from flighttest.regression.equation_error.fit import Fit

# Nodes of a surface along each angle, and largest number of points in a figure.
_NODES, _MOST = 25, 600
# Range of an angle that the points do not have [rad].
_NO_RANGE = (-0.1, 0.1)
_ANGLES = ("alpha", "beta")


def draw_surfaces(fits: Sequence[Fit], target: str | Path) -> None:
    """Draw each fit as a surface over ``alpha`` and ``beta``, with the points of the fit.

    The surface covers the range of the points.

    Parameters
    ----------
    fits : sequence of Fit
        Other variables of a model have their mean value.
    target : path
        File to write, atomically; its ending names the format (png, svg, pdf).
    """
    demand_drawable(target)
    figure = new_figure(7.0 * len(fits), 5.5)
    for k, fit in enumerate(fits, 1):
        axis = figure.add_subplot(1, len(fits), k, projection="3d")
        _draw_model(axis, fit)
        _draw_points(axis, fit)
        axis.set_xlabel("alpha [deg]")
        axis.set_ylabel("beta [deg]")
        axis.set_title(str(fit.model), fontsize="small", loc="left")
        axis.set_zlabel(fit.model.coefficient)
    figure.axes[0].legend(fontsize="small")
    write_figure(figure, target, dpi=120)


def _draw_model(axis: Any, fit: Fit) -> None:
    """Draw the surface of a model."""
    alpha, beta = (np.linspace(*_angle_range(fit.data, name), _NODES) for name in _ANGLES)
    A, B = np.meshgrid(alpha, beta)
    columns = {}
    for variable in fit.model.variables:
        mean = float(fit.data[variable].mean())
        columns[variable] = ("sample", np.full(A.size, mean))
    columns["alpha"], columns["beta"] = ("sample", A.ravel()), ("sample", B.ravel())
    estimates = fit.estimates["estimate"].sel(term=list(fit.model.terms)).values
    surface = fit.model.design(xr.Dataset(columns)) @ estimates
    axis.plot_wireframe(
        np.degrees(A),
        np.degrees(B),
        surface.reshape(A.shape),
        color="#bc6c25",
        linewidth=0.5,
        label="model",
    )


def _draw_points(axis: Any, fit: Fit) -> None:
    """Draw the points of a fit, thinned to a readable number."""
    points = fit.data
    thin = slice(None, None, max(1, points.sizes["sample"] // _MOST))
    z = points[fit.model.coefficient].values[thin]
    angles = []
    for name in _ANGLES:
        if name in points:
            angles.append(np.degrees(points[name].values[thin]))
        else:
            angles.append(np.zeros_like(z))
    axis.scatter(*angles, z, color="black", s=2, label="points")


def _angle_range(points: xr.Dataset, name: str) -> tuple[float, float]:
    if name not in points:
        return _NO_RANGE
    return float(points[name].min()), float(points[name].max())
