"""Exact algebra of piecewise-linear functions of one variable: sums, compositions, restrictions.

A function is given by its nodes and its slopes beyond them.  The values may be arrays: then there
is one function per entry, with common nodes.  A table along one of its axes is such a function.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# Nodes and slopes are equal if they differ by less than this share of their size. The difference
# comes from conversions of units.
_SAME = 1e-12
_LEAST_SLACK = 1e-300  # avoids a tolerance of zero at the origin


@dataclass(frozen=True, eq=False)
class PiecewiseLinear:
    """A piecewise-linear function.

    Parameters
    ----------
    points : array (node,)
        Nodes, rising.
    values : array (node, ...)
        Values at the nodes.
    left_slope, right_slope : array (...)
        Slopes below the first and above the last node.
    """

    points: np.ndarray
    values: np.ndarray
    left_slope: np.ndarray
    right_slope: np.ndarray

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Return the values (x, ...) at x (x,)."""
        points, values = self.points, self.values
        shape = (-1,) + (1,) * (values.ndim - 1)
        if len(points) == 1:
            inside = np.broadcast_to(values, (len(x), *values.shape[1:]))
        else:
            # `low` is the node below x; outside the nodes the fraction is limited to 0 or 1.
            low = np.clip(np.searchsorted(points, x, side="right") - 1, 0, len(points) - 2)
            share = (x - points[low]) / (points[low + 1] - points[low])
            fraction = np.clip(share, 0.0, 1.0).reshape(shape)
            inside = (1.0 - fraction) * values[low] + fraction * values[low + 1]
        # Distances beyond the end nodes times the end slopes.
        below = np.minimum(x - points[0], 0.0).reshape(shape)
        above = np.maximum(x - points[-1], 0.0).reshape(shape)
        return inside + below * self.left_slope + above * self.right_slope

    @property
    def is_line(self) -> bool:
        """Whether the function has no bend."""
        slopes = _piece_slopes(self)
        return bool(_are_equal(slopes, np.broadcast_to(slopes[0], slopes.shape)))

    def times(self, factor: float) -> PiecewiseLinear:
        """Return the function multiplied by a number."""
        return PiecewiseLinear(
            self.points, factor * self.values, factor * self.left_slope, factor * self.right_slope
        )


def make_line(slope: float, offset: float = 0.0) -> PiecewiseLinear:
    """Return slope * x + offset."""
    return PiecewiseLinear(np.zeros(1), np.array([offset]), np.asarray(slope), np.asarray(slope))


def from_nodes(
    points: list[float], values: list[float], left_slope: float, right_slope: float
) -> PiecewiseLinear:
    """Return a function by its nodes and end slopes."""
    return PiecewiseLinear(
        np.array(points, float),
        np.array(values, float),
        np.asarray(left_slope, float),
        np.asarray(right_slope, float),
    )


ABS = from_nodes([0.0], [0.0], -1.0, 1.0)
POSITIVE = from_nodes([0.0], [0.0], 0.0, 1.0)


def make_limiter(low: float, high: float) -> PiecewiseLinear:
    """Return the limiter to low ... high; either may be infinite."""
    if np.isfinite(low) and np.isfinite(high):
        nodes = [low, high] if low < high else [low]
        return from_nodes(nodes, nodes, 0.0, 0.0)
    if np.isfinite(low):
        return from_nodes([low], [low], 0.0, 1.0)
    if np.isfinite(high):
        return from_nodes([high], [high], 1.0, 0.0)
    return make_line(1.0)


def add_functions(f: PiecewiseLinear, g: PiecewiseLinear) -> PiecewiseLinear:
    """Return f + g."""
    # The node of a line is not a bend, so the sum does not need it.
    if f.is_line:
        points = g.points
    elif g.is_line:
        points = f.points
    else:
        points = merge_points(f.points, g.points)
    left_slope = _add_slopes(f.left_slope, g.left_slope)
    right_slope = _add_slopes(f.right_slope, g.right_slope)
    return PiecewiseLinear(points, f(points) + g(points), left_slope, right_slope)


def compose_functions(outer: PiecewiseLinear, inner: PiecewiseLinear) -> PiecewiseLinear:
    """Return outer(inner(x)); the inner function is a single one."""
    preimages, nodes = find_preimages(outer.points, inner)
    points = merge_points(preimages, inner.points)
    values = outer(inner(points))
    # The breakpoints of a table keep its values without any rounding.
    for preimage, node in zip(preimages, nodes, strict=True):
        values[np.argmin(np.abs(points - preimage))] = outer.values[node]
    # Chain rule. Far below the nodes a rising inner function reaches the lower end of the outer
    # function, a falling one its upper end.
    left_slope = 0.0 * outer.left_slope
    if inner.left_slope != 0.0:
        left_slope = (
            np.where(inner.left_slope > 0.0, outer.left_slope, outer.right_slope) * inner.left_slope
        )
    right_slope = 0.0 * outer.right_slope
    if inner.right_slope != 0.0:
        right_slope = (
            np.where(inner.right_slope > 0.0, outer.right_slope, outer.left_slope)
            * inner.right_slope
        )
    return _remove_straight_nodes(
        PiecewiseLinear(points, values, left_slope, right_slope), preimages
    )


def restrict_function(f: PiecewiseLinear, limit: float, below: bool) -> PiecewiseLinear | None:
    """Return f on one side of a limit and zero on the other, or None if f jumps there."""
    points = merge_points(f.points, np.array([limit]))
    values = f(points)
    node = int(np.argmin(np.abs(points - limit)))
    size = max(1.0, float(np.abs(values).max(initial=0.0)))
    if np.abs(values[node]).max(initial=0.0) > _SAME * size:
        return None
    values[node] = 0.0
    if below:
        values[node + 1 :] = 0.0
        return PiecewiseLinear(
            points[: node + 1], values[: node + 1], f.left_slope, 0.0 * f.right_slope
        )
    return PiecewiseLinear(points[node:], values[node:], 0.0 * f.left_slope, f.right_slope)


def as_axis(f: PiecewiseLinear) -> tuple[np.ndarray, np.ndarray, bool, bool]:
    """Return a function as a table axis: points, values, and whether it is open below and above.

    An open table continues with the slope of its last interval.  If an end slope of the function
    differs from it, an additional node is added.
    """
    points, values = f.points, f.values
    step = float(points[-1] - points[0]) or 1.0
    slopes = _piece_slopes(f)
    open_low, open_high = bool(np.any(f.left_slope != 0.0)), bool(np.any(f.right_slope != 0.0))
    is_single = len(f.points) == 1
    # A node before the first one, on the line of the end slope, gives the last interval that slope.
    if open_low and (is_single or not _are_equal(slopes[0], slopes[1])):
        points = np.concatenate([[points[0] - step], points])
        values = np.concatenate([values[:1] - step * f.left_slope, values])
    if open_high and (is_single or not _are_equal(slopes[-1], slopes[-2])):
        points = np.concatenate([points, [points[-1] + step]])
        values = np.concatenate([values, values[-1:] + step * f.right_slope])
    return points, values, open_low, open_high


def _piece_slopes(f: PiecewiseLinear) -> np.ndarray:
    """Return the slopes (node + 1, ...) of all pieces, with the two beyond the nodes."""
    steps = np.diff(f.points).reshape((-1,) + (1,) * (f.values.ndim - 1))
    inside = np.diff(f.values, axis=0) / steps
    shape = f.values.shape[1:]
    first = np.broadcast_to(f.left_slope, shape)[None]
    last = np.broadcast_to(f.right_slope, shape)[None]
    return np.concatenate([first, inside, last])


def _add_slopes(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the sum of two slopes; zero if they cancel except for rounding."""
    return np.where(np.abs(a + b) <= _SAME * (np.abs(a) + np.abs(b)), 0.0, a + b)


def _are_equal(a: np.ndarray, b: np.ndarray) -> bool:
    scale = max(float(np.abs(a).max(initial=0.0)), float(np.abs(b).max(initial=0.0)))
    return bool((np.abs(a - b) <= _SAME * scale).all())


def merge_points(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the points of both, rising; a point of b that nearly equals one of a is dropped."""
    spread, size = np.ptp(np.concatenate([a, b])), float(np.abs(b).max(initial=0.0))
    tolerance = _SAME * max(spread, size, np.finfo(float).tiny)
    additional = [point for point in b if not len(a) or np.abs(a - point).min() > tolerance]
    return np.sort(np.concatenate([a, additional]))


def find_preimages(targets: np.ndarray, inner: PiecewiseLinear) -> tuple[np.ndarray, list[int]]:
    """Return the points at which a function has a target value, and the index of the target.

    Parameters
    ----------
    targets : array (target,)
        Values of the function.
    inner : PiecewiseLinear
        The function.

    Returns
    -------
    points : array (point,)
        Points x with inner(x) = target, rising.
    indices : list of int
        Index of the target at each point.
    """
    edges = np.concatenate([[-np.inf], inner.points, [np.inf]])
    slopes = _piece_slopes(inner)
    # A pure conversion of units has one node at zero. It takes one rounding only.
    is_conversion = len(inner.points) == 1 and inner.points[0] == 0.0
    index_of: dict[float, int] = {}
    for i, slope in enumerate(slopes):
        if abs(slope) <= _SAME * np.abs(slopes).max():
            continue
        # Piece i lies between the edges i and i + 1. It passes through the node `anchor`.
        anchor = min(max(i - 1, 0), len(inner.points) - 1)
        for index, target in enumerate(targets):
            if is_conversion:
                x = float((target - inner.values[0]) / slope)
            else:
                x = float(inner.points[anchor] + (target - inner.values[anchor]) / slope)
            slack = _SAME * max(abs(x), _LEAST_SLACK)
            is_in_piece = edges[i] - slack <= x <= edges[i + 1] + slack
            if is_in_piece and not any(abs(x - point) <= slack for point in index_of):
                index_of[x] = index
    points = sorted(index_of)
    return np.array(points), [index_of[x] for x in points]


def _remove_straight_nodes(f: PiecewiseLinear, needed: np.ndarray) -> PiecewiseLinear:
    """Remove the nodes at which the function has no bend, except the needed ones."""
    slopes = _piece_slopes(f)
    keep = []
    for i, point in enumerate(f.points):
        has_bend = not _are_equal(slopes[i], slopes[i + 1])
        keep.append(has_bend or bool(np.isin(point, needed)))
    if not any(keep):
        keep[0] = True
    return PiecewiseLinear(f.points[keep], f.values[keep], f.left_slope, f.right_slope)
