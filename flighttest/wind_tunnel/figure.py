"""Figure of balance fits: measured points and the fitted surface over angle of attack and sideslip, as [Grauer2010] Fig. 5.

References
----------
.. [Grauer2010] Grauer, Ulrich, Hubbard, Pines, Humbert, System identification of an ornithopter aerodynamics model, AIAA 2010-7632.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from flightmech.support.display import demand_drawable, new_figure, save_figure

from ..equation_error.fit import Fit

_NODES, _MOST = 25, 600  # of the surface along each angle; points drawn


def draw_surfaces(fits: Sequence[Fit], target: str | Path) -> None:
    """Draw each fit as a surface over ``alpha`` and ``beta`` inside the range of its points, with the points.

    Parameters
    ----------
    fits : sequence of Fit
        Other variables of a model are held at their mean.
    target : path
        File to write, atomically; its ending names the format (png, svg, pdf).
    """
    demand_drawable(target)
    figure = new_figure(7.0 * len(fits), 5.5)
    for k, fit in enumerate(fits, 1):
        points, name = fit.data, fit.model.coefficient
        axis = figure.add_subplot(1, len(fits), k, projection="3d")
        nodes = [np.linspace(*_range(points, angle), _NODES) for angle in ("alpha", "beta")]
        A, B = np.meshgrid(*nodes)
        held = {variable: ("sample", np.full(A.size, float(points[variable].mean()))) for variable in fit.model.variables}
        grid = xr.Dataset({**held, "alpha": ("sample", A.ravel()), "beta": ("sample", B.ravel())})
        terms = list(fit.model.terms)
        surface = fit.model.design(grid) @ fit.estimates["estimate"].sel(term=terms).values
        axis.plot_wireframe(np.degrees(A), np.degrees(B), surface.reshape(A.shape), color="#bc6c25", linewidth=0.5, label="model")
        thin = slice(None, None, max(1, points.sizes["sample"] // _MOST))
        z = points[name].values[thin]
        angles = [np.degrees(points[angle].values[thin]) if angle in points else np.zeros_like(z) for angle in ("alpha", "beta")]
        axis.scatter(*angles, z, color="black", s=2, label="points")
        axis.set_xlabel("alpha [deg]")
        axis.set_ylabel("beta [deg]")
        axis.set_title(str(fit.model), fontsize="small", loc="left")
        axis.set_zlabel(name)
    figure.axes[0].legend(fontsize="small")
    save_figure(figure, target, dpi=120)


def _range(points: xr.Dataset, angle: str) -> tuple[float, float]:
    return (float(points[angle].min()), float(points[angle].max())) if angle in points else (-0.1, 0.1)
