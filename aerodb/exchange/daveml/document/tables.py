"""Tables of DAVE-ML functions and their look-up: gridded over any mix of interpolation rules, or
scattered points.

An interpolation rule is linear in the values of the table, so each axis becomes weights on its
breakpoints, and a look-up the sum over the products of the weights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline, LinearNDInterpolator

from flightmech.errors import OutOfRange

INTERPOLATE = ("linear", "discrete", "floor", "ceiling", "cubicSpline")
EXTRAPOLATE = ("neither", "min", "max", "both")
MAX_AXES = 8  # a look-up costs 2**axes
_SHEAR = 1e-6
_BLOCK = 8192  # samples looked up at a time: what they need stays small whatever the record


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
        One of `EXTRAPOLATE`: on which sides the table goes on with the slope of its end; elsewhere
        its end value holds.
    low, high : float
        Limits of the input before it meets the table.
    """

    points: np.ndarray
    interpolate: str = "linear"
    extrapolate: str = "neither"
    low: float = -np.inf
    high: float = np.inf

    @property
    def open_low(self) -> bool:
        """Whether the table goes on below its first breakpoint."""
        return self.extrapolate in ("min", "both")

    @property
    def open_high(self) -> bool:
        """Whether the table goes on above its last breakpoint."""
        return self.extrapolate in ("max", "both")

    def weights(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return node indices and weights (samples, share) of inputs (samples,); NaN inputs have
        NaN weights.
        """
        x = np.clip(x, self.low, self.high)
        if len(self.points) == 1:
            return np.zeros((len(x), 1), np.intp), np.where(np.isnan(x), np.nan, 1.0)[:, None]
        if self.interpolate == "cubicSpline":
            return self._spline(x)
        if self.interpolate == "linear":
            return self._linear(x)
        node = self._nearest(x)
        return node[:, None], np.where(np.isnan(x), np.nan, 1.0)[:, None]

    def _linear(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        points = self.points
        low = np.clip(np.searchsorted(points, x, side="right") - 1, 0, len(points) - 2)
        fraction = (x - points[low]) / (points[low + 1] - points[low])
        fraction = np.clip(
            fraction, -np.inf if self.open_low else 0.0, np.inf if self.open_high else 1.0
        )
        return np.stack([low, low + 1], axis=1), np.stack([1.0 - fraction, fraction], axis=1)

    def _nearest(self, x: np.ndarray) -> np.ndarray:
        points = self.points
        if self.interpolate == "floor":
            node = np.searchsorted(points, x, side="right") - 1
        elif self.interpolate == "ceiling":
            node = np.searchsorted(points, x, side="left")
        else:
            node = np.searchsorted((points[1:] + points[:-1]) / 2.0, x, side="right")
        return np.clip(node, 0, len(points) - 1)

    def _spline(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Natural at a held end, clamped to the slope of the last two points at an open one, as the
        reference manual suggests.
        """

        points, unit = self.points, np.eye(len(self.points))
        slopes = (
            (unit[1] - unit[0]) / (points[1] - points[0]),
            (unit[-1] - unit[-2]) / (points[-1] - points[-2]),
        )
        flat = np.zeros(len(points))
        ends = [
            (1, slope) if is_open else (2, flat)
            for slope, is_open in zip(slopes, (self.open_low, self.open_high), strict=True)
        ]
        inside = np.clip(x, points[0], points[-1])
        weights = CubicSpline(points, unit, bc_type=(ends[0], ends[1]))(inside)
        for slope, is_open, beyond in zip(
            slopes, (self.open_low, self.open_high), (x < points[0], x > points[-1]), strict=True
        ):
            if is_open:
                weights = weights + np.outer(np.where(beyond, x - inside, 0.0), slope)
        return np.broadcast_to(np.arange(len(points)), weights.shape), weights


@dataclass(frozen=True, eq=False)
class Gridded:
    """Values over the product of breakpoint sets; ``values`` (breakpoints of axis 1, of axis 2,
    ...).
    """

    values: np.ndarray

    def look_up(self, axes: Sequence[FunctionAxis], inputs: Sequence[np.ndarray]) -> np.ndarray:
        """Return the table at inputs (samples,), one per axis."""
        starts = range(0, len(inputs[0]), _BLOCK)
        return np.concatenate(
            [
                np.zeros(0),
                *(
                    self._block(axes, [x[start : start + _BLOCK] for x in inputs])
                    for start in starts
                ),
            ]
        )

    def _block(self, axes: Sequence[FunctionAxis], inputs: Sequence[np.ndarray]) -> np.ndarray:
        at, share = np.zeros((len(inputs[0]), 1), np.intp), np.ones((len(inputs[0]), 1))
        for axis, x in zip(axes, inputs, strict=True):
            node, weight = axis.weights(x)
            at = ((at * len(axis.points))[:, :, None] + node[:, None, :]).reshape(len(x), -1)
            share = (share[:, :, None] * weight[:, None, :]).reshape(len(x), -1)
        return (share * self.values.ravel()[at]).sum(axis=1)


@dataclass(frozen=True, eq=False)
class Scattered:
    """Points of an ungridded table: ``points`` (point, axis) with ``values`` (point,), joined by
    Delaunay's triangulation.

    Four points of a rectangle lie on one circle, and two triangulations are right.  The one whose
    diagonal runs where both inputs rise is taken, by a metric that is sheared a little; the check
    case of the University of Toronto's example demands it.
    """

    points: np.ndarray
    values: np.ndarray

    @cached_property
    def _shear(self) -> np.ndarray:
        count = self.points.shape[1]
        return np.linalg.cholesky((1.0 + _SHEAR) * np.eye(count) - _SHEAR)

    @cached_property
    def _surface(self):

        return LinearNDInterpolator(self.points @ self._shear, self.values)

    def look_up(self, axes: Sequence[FunctionAxis], inputs: Sequence[np.ndarray]) -> np.ndarray:
        """Return the table at inputs (samples,), one per axis; inputs beyond the box of the points
        are held at its side.

        Raises
        ------
        OutOfRange
            An input in the box that no triangle of points surrounds.
        """
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        limited = [np.clip(x, axis.low, axis.high) for axis, x in zip(axes, inputs, strict=True)]
        x = np.clip(np.stack(limited, axis=1), low, high)
        if self.points.shape[1] == 1:
            order = np.argsort(self.points[:, 0])
            return np.interp(x[:, 0], self.points[order, 0], self.values[order])
        found = self._surface(x @ self._shear)
        bare = np.isnan(found) & ~np.isnan(x).any(axis=1)
        if bare.any():
            place = ", ".join(f"{value:.6g}" for value in x[bare][0])
            raise OutOfRange(
                f"({place}) lies between no points of an ungridded table; ask inside the "
                f"area its points cover",
                bare,
            )
        return found
