"""Look-up tables of DAVE-ML functions: gridded with several interpolation rules, or scattered.

Every interpolation rule is linear in the values of the table.  So an axis gives weights of its
breakpoints, and a look-up is the sum of the values times the products of the weights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline, LinearNDInterpolator

from flightmech.errors import OutOfRange

INTERPOLATE = ("linear", "discrete", "floor", "ceiling", "cubicSpline")
EXTRAPOLATE = ("neither", "min", "max", "both")
MAX_AXES = 8  # a look-up costs 2**axes
_SHEAR = 1e-6  # off-diagonal of the metric of scattered points
_BLOCK = 8192  # samples of one pass; limits the memory of a look-up
# Boundary conditions of `scipy.interpolate.CubicSpline`: order of the derivative at an end.
_SLOPE, _CURVATURE = 1, 2


@dataclass(frozen=True, eq=False)
class FunctionAxis:
    """One input of a gridded function.

    Parameters
    ----------
    points : array (node,)
        Breakpoints, rising. [unit of the input]
    interpolate : str
        One of `INTERPOLATE`.  ``discrete`` takes the nearest breakpoint, the upper one at the
        middle; ``floor`` the last one not above the input; ``ceiling`` the first one not below it.
    extrapolate : str
        One of `EXTRAPOLATE`: the sides on which the table continues with the slope of its end.  On
        the other sides it holds its end value.
    low, high : float
        Limits of the input, applied before the look-up.
    """

    points: np.ndarray
    interpolate: str = "linear"
    extrapolate: str = "neither"
    low: float = -np.inf
    high: float = np.inf

    @property
    def open_low(self) -> bool:
        """Whether the table continues below its first breakpoint."""
        return self.extrapolate in ("min", "both")

    @property
    def open_high(self) -> bool:
        """Whether the table continues above its last breakpoint."""
        return self.extrapolate in ("max", "both")

    def weights(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return node indices and weights (sample, share) of inputs (sample,).

        The weights of a NaN input are NaN.
        """
        x = np.clip(x, self.low, self.high)
        if self.interpolate == "cubicSpline" and len(self.points) > 1:
            return self._spline_weights(x)
        if self.interpolate == "linear" and len(self.points) > 1:
            return self._linear_weights(x)
        # One node with the weight 1.
        weight = np.where(np.isnan(x), np.nan, 1.0)[:, None]
        if len(self.points) == 1:
            return np.zeros((len(x), 1), np.intp), weight
        return self._step_nodes(x)[:, None], weight

    def _linear_weights(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        points = self.points
        low = np.clip(np.searchsorted(points, x, side="right") - 1, 0, len(points) - 2)
        fraction = (x - points[low]) / (points[low + 1] - points[low])
        # At an open end the fraction may leave 0 ... 1, which is the extrapolation.
        least = -np.inf if self.open_low else 0.0
        largest = np.inf if self.open_high else 1.0
        fraction = np.clip(fraction, least, largest)
        return np.stack([low, low + 1], axis=1), np.stack([1.0 - fraction, fraction], axis=1)

    def _step_nodes(self, x: np.ndarray) -> np.ndarray:
        """Return the node of each input for ``floor``, ``ceiling`` and ``discrete``."""
        points = self.points
        if self.interpolate == "floor":
            node = np.searchsorted(points, x, side="right") - 1
        elif self.interpolate == "ceiling":
            node = np.searchsorted(points, x, side="left")
        else:
            node = np.searchsorted((points[1:] + points[:-1]) / 2.0, x, side="right")
        return np.clip(node, 0, len(points) - 1)

    def _spline_weights(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the weights of a cubic spline, as the reference manual suggests.

        The spline is natural at a closed end.  At an open end it has the slope of the last two
        points.
        """
        # The spline is linear in the values, so the splines of unit values are the weights.
        points, unit = self.points, np.eye(len(self.points))
        first_slope = (unit[1] - unit[0]) / (points[1] - points[0])
        last_slope = (unit[-1] - unit[-2]) / (points[-1] - points[-2])
        natural = (_CURVATURE, np.zeros(len(points)))
        first_end = (_SLOPE, first_slope) if self.open_low else natural
        last_end = (_SLOPE, last_slope) if self.open_high else natural
        inside = np.clip(x, points[0], points[-1])
        weights = CubicSpline(points, unit, bc_type=(first_end, last_end))(inside)
        # Beyond an open end the spline continues as a straight line.
        if self.open_low:
            weights = weights + np.outer(np.where(x < points[0], x - inside, 0.0), first_slope)
        if self.open_high:
            weights = weights + np.outer(np.where(x > points[-1], x - inside, 0.0), last_slope)
        return np.broadcast_to(np.arange(len(points)), weights.shape), weights


@dataclass(frozen=True, eq=False)
class Gridded:
    """Table over the product of breakpoint sets.

    Parameters
    ----------
    values : array (breakpoints of axis 1, breakpoints of axis 2, ...)
        Values at the nodes.
    """

    values: np.ndarray

    def look_up(self, axes: Sequence[FunctionAxis], inputs: Sequence[np.ndarray]) -> np.ndarray:
        """Return the table at inputs (sample,), one per axis."""
        blocks = [np.zeros(0)]
        for start in range(0, len(inputs[0]), _BLOCK):
            blocks.append(self._look_up_block(axes, [x[start : start + _BLOCK] for x in inputs]))
        return np.concatenate(blocks)

    def _look_up_block(
        self, axes: Sequence[FunctionAxis], inputs: Sequence[np.ndarray]
    ) -> np.ndarray:
        # Index into the flat table, and weight, of every corner (sample, corner). Each axis
        # multiplies the number of corners by its number of nodes per sample.
        index = np.zeros((len(inputs[0]), 1), np.intp)
        weight = np.ones((len(inputs[0]), 1))
        for axis, x in zip(axes, inputs, strict=True):
            axis_node, axis_weight = axis.weights(x)
            corners = (index * len(axis.points))[:, :, None] + axis_node[:, None, :]
            index = corners.reshape(len(x), -1)
            weight = (weight[:, :, None] * axis_weight[:, None, :]).reshape(len(x), -1)
        return (weight * self.values.ravel()[index]).sum(axis=1)


@dataclass(frozen=True, eq=False)
class Scattered:
    """Table over scattered points, joined by Delaunay's triangulation.

    Four points of a rectangle lie on one circle, and two triangulations are valid.  A slightly
    sheared metric selects the one whose diagonal runs where both inputs rise.  The check case of
    the University of Toronto's example demands it.

    Parameters
    ----------
    points : array (point, axis)
        Coordinates of the points.
    values : array (point,)
        Values at the points.
    """

    points: np.ndarray
    values: np.ndarray

    @cached_property
    def _shear(self) -> np.ndarray:
        """The root L of the metric L L^T = (1 + s) I - s, in which distances are measured."""
        count = self.points.shape[1]
        return np.linalg.cholesky((1.0 + _SHEAR) * np.eye(count) - _SHEAR)

    @cached_property
    def _surface(self) -> Any:
        return LinearNDInterpolator(self.points @ self._shear, self.values)

    def look_up(self, axes: Sequence[FunctionAxis], inputs: Sequence[np.ndarray]) -> np.ndarray:
        """Return the table at inputs (sample,), one per axis.

        An input beyond the box of the points is set to the side of the box.

        Raises
        ------
        OutOfRange
            An input in the box is not inside any triangle of points.
        """
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        limited = [np.clip(x, axis.low, axis.high) for axis, x in zip(axes, inputs, strict=True)]
        x = np.clip(np.stack(limited, axis=1), low, high)
        if self.points.shape[1] == 1:
            order = np.argsort(self.points[:, 0])
            return np.interp(x[:, 0], self.points[order, 0], self.values[order])
        values = self._surface(x @ self._shear)
        # A NaN input gives a NaN value, which is not an error.
        outside = np.isnan(values) & ~np.isnan(x).any(axis=1)
        if outside.any():
            point = ", ".join(f"{value:.6g}" for value in x[outside][0])
            raise OutOfRange(
                f"({point}) lies between no points of an ungridded table; ask inside the "
                f"area its points cover",
                outside,
            )
        return values
