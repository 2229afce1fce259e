"""Corrections of a-priori tables of propellers and engines: forms and a-priori standard errors.

A coefficient gets a factor, polynomials of the advance ratio, and of the blade angle where the
blades turn; see `equations`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

# A-priori standard errors of the orders of a coefficient, relative to its size. Without a stderr in
# the prior: 10 % in level and slope, which is the scatter of propeller charts against tests of the
# same blades (our judgement), less in the shape.
ORDERS = {"scale": 0.10, "slope": 0.08, "curvature": 0.04, "cubic": 0.02}
WINDMILLING, FEATHERED = 0.3, 0.5
# Where the blades turn: change over the flown blade angles, and the same at all of them. The latter
# is the profile drag of the blades: without power it makes a thrust of about -8 % of the rms, and a
# chart knows it to about 30 % (our judgement). Without this term it would count as drag.
PITCH = {"offset": 0.025, "pitch": 0.04, "pitch slope": 0.02}
# Of power and fuel flow by the chart of a maker, which states 2.5 to 5 % (our judgement).
POWER = {"scale": 0.05, "slope": 0.03}
FUEL = 0.10
# Axes over which the power of an engine may have a slope.
POWER_AXES = ("manifold_pressure", "n1")


class PriorValue(NamedTuple):
    """Prior value and standard error of an unknown."""

    value: float
    stderr: float


class FlownRange(NamedTuple):
    """Interval of a variable, and size of a coefficient on it."""

    low: float
    high: float
    size: float

    def place(self, x: np.ndarray) -> np.ndarray:
        """Return -1 ... 1 over the interval, held outside; 0 for an interval without length."""
        if not self.high > self.low:
            return np.zeros_like(np.asarray(x, float))
        return np.clip(2.0 * (x - self.low) / (self.high - self.low) - 1.0, -1.0, 1.0)

    def orders(self, x: np.ndarray) -> dict[str, np.ndarray]:
        """Return the polynomials of first to third order."""
        z = self.place(x)
        return {
            "slope": self.size * z,
            "curvature": self.size * (1.5 * z**2 - 0.5),
            "cubic": self.size * (2.5 * z**3 - 1.5 * z),
        }


def corrected(
    name: str,
    prior: np.ndarray,
    at: Mapping[str, np.ndarray],
    shapes: Mapping[str, FlownRange],
    value: Mapping[str, float],
) -> np.ndarray:
    """Return a coefficient of a turning propeller with its corrections (point,).

    Parameters
    ----------
    name : {"CT_prop", "CP_prop"}
    prior : array (point,)
        A-priori coefficient.
    at : dict of str to array (point,)
        ``J``, and ``blade_angle`` where the blades turn.
    shapes : mapping of str to FlownRange
        As `PropulsionEquations.shapes`.
    value : mapping of str to float
        Unknowns by name.
    """
    total = (1.0 + value.get(f"{name} scale", 0.0)) * prior
    columns = shapes[name].orders(at["J"])
    if "blade_angle" in shapes:
        y = shapes[name].size * shapes["blade_angle"].place(at["blade_angle"])
        columns |= {
            "offset": np.full_like(y, shapes[name].size),
            "pitch": y,
            "pitch slope": y * shapes[name].place(at["J"]),
        }
    for order, column in columns.items():
        total = total + value.get(f"{name} {order}", 0.0) * column
    return total + value.get(f"{name} windmilling", 0.0) * np.minimum(prior, 0.0)


def coefficient_slopes(
    name: str,
    prior: np.ndarray,
    at: Mapping[str, np.ndarray],
    shapes: Mapping[str, FlownRange],
    unknowns: Sequence[str],
) -> np.ndarray:
    """Return the slopes of a coefficient over the unknowns (point, unknown).

    The arguments are those of `corrected`.
    """
    slopes = np.zeros((len(prior), len(unknowns)))
    for k, unknown in enumerate(unknowns):
        # The coefficients are linear in the unknowns: each slope is a difference of one unit.
        if unknown.startswith(f"{name} "):
            slopes[:, k] = corrected(name, prior, at, shapes, {unknown: 1.0}) - prior
    return slopes


def relative_error(leaf: xr.Dataset) -> float:
    """Return the relative a-priori standard error of a coefficient."""
    if "stderr" not in leaf:
        return ORDERS["scale"]
    value, stderr = leaf["value"].values, leaf["stderr"].values
    size = float(np.sqrt(np.mean(value**2)))
    return float(np.sqrt(np.nanmean(stderr**2))) / size if size else ORDERS["scale"]
