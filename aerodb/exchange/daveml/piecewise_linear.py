"""Piecewise-linear functions of one variable, exactly: sums, compositions, parts.

A function is given by its nodes and its slopes beyond them.  The values may be arrays: then it is
one function per entry, with common nodes, as a table seen along one of its axes is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# nodes and slopes closer than this, in terms of their size, are one: units were converted in
# between
_SAME = 1e-12


@dataclass(frozen=True, eq=False)
class PiecewiseLinear:
    """A piecewise-linear function: ``points`` (node,) rising, ``values`` (node, ...), slopes
    ``left`` and ``right`` (...) beyond.
    """

    points: np.ndarray
    values: np.ndarray
    left: np.ndarray
    right: np.ndarray

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Return the values (x, ...) at x (x,)."""
        points, values = self.points, self.values
        shape = (-1,) + (1,) * (values.ndim - 1)
        if len(points) == 1:
            inside = np.broadcast_to(values, (len(x), *values.shape[1:]))
        else:
            low = np.clip(np.searchsorted(points, x, side="right") - 1, 0, len(points) - 2)
            fraction = np.clip(
                (x - points[low]) / (points[low + 1] - points[low]), 0.0, 1.0
            ).reshape(shape)
            inside = (1.0 - fraction) * values[low] + fraction * values[low + 1]
        below, above = (
            np.minimum(x - points[0], 0.0).reshape(shape),
            np.maximum(x - points[-1], 0.0).reshape(shape),
        )
        return inside + below * self.left + above * self.right

    @property
    def is_line(self) -> bool:
        """Whether the function has no bend."""
        slopes = _slopes(self)
        return bool(_same(slopes, np.broadcast_to(slopes[0], slopes.shape)))

    def times(self, factor: float) -> PiecewiseLinear:
        """Return the function multiplied by a number."""
        return PiecewiseLinear(
            self.points, factor * self.values, factor * self.left, factor * self.right
        )


def make_line(slope: float, offset: float = 0.0) -> PiecewiseLinear:
    """Return slope * x + offset."""
    return PiecewiseLinear(np.zeros(1), np.array([offset]), np.asarray(slope), np.asarray(slope))


def from_nodes(
    points: list[float], values: list[float], left: float, right: float
) -> PiecewiseLinear:
    """Return a function by its nodes and end slopes."""
    return PiecewiseLinear(
        np.array(points, float),
        np.array(values, float),
        np.asarray(left, float),
        np.asarray(right, float),
    )


ABS = from_nodes([0.0], [0.0], -1.0, 1.0)
POSITIVE = from_nodes([0.0], [0.0], 0.0, 1.0)


def make_limiter(low: float, high: float) -> PiecewiseLinear:
    """Return the limiter to low ... high; either may be infinite."""
    if np.isfinite(low) and np.isfinite(high):
        return (
            from_nodes([low, high], [low, high], 0.0, 0.0)
            if low < high
            else from_nodes([low], [low], 0.0, 0.0)
        )
    if np.isfinite(low):
        return from_nodes([low], [low], 0.0, 1.0)
    return from_nodes([high], [high], 1.0, 0.0) if np.isfinite(high) else make_line(1.0)


def add_functions(f: PiecewiseLinear, g: PiecewiseLinear) -> PiecewiseLinear:
    """Return f + g."""
    points = g.points if f.is_line else f.points if g.is_line else merge_points(f.points, g.points)
    return PiecewiseLinear(
        points, f(points) + g(points), _total(f.left, g.left), _total(f.right, g.right)
    )


def compose_functions(outer: PiecewiseLinear, inner: PiecewiseLinear) -> PiecewiseLinear:
    """Return outer(inner(x)); the inner function is a single one."""
    places, nodes = find_preimages(outer.points, inner)
    points = merge_points(places, inner.points)
    values = outer(inner(points))
    for at, node in zip(
        places, nodes, strict=True
    ):  # the breakpoints of a table keep its values to the last digit
        values[np.argmin(np.abs(points - at))] = outer.values[node]
    left = (
        np.where(inner.left > 0.0, outer.left, outer.right) * inner.left
        if inner.left != 0.0
        else 0.0 * outer.left
    )
    right = (
        np.where(inner.right > 0.0, outer.right, outer.left) * inner.right
        if inner.right != 0.0
        else 0.0 * outer.right
    )
    return _without(PiecewiseLinear(points, values, left, right), places)


def restrict_function(f: PiecewiseLinear, at: float, below: bool) -> PiecewiseLinear | None:
    """Return f on one side of a place and zero on the other, or None when f jumps there."""
    points = merge_points(f.points, np.array([at]))
    values = f(points)
    here = int(np.argmin(np.abs(points - at)))
    if np.abs(values[here]).max(initial=0.0) > _SAME * max(
        1.0, float(np.abs(values).max(initial=0.0))
    ):
        return None
    values[here] = 0.0
    if below:
        values[here + 1 :] = 0.0
        return PiecewiseLinear(points[: here + 1], values[: here + 1], f.left, 0.0 * f.right)
    return PiecewiseLinear(points[here:], values[here:], 0.0 * f.left, f.right)


def as_axis(f: PiecewiseLinear) -> tuple[np.ndarray, np.ndarray, bool, bool]:
    """Return points, values, and whether the table goes on with its end slope below and above;
    nodes are added where it must.
    """
    points, values = f.points, f.values
    step = float(points[-1] - points[0]) or 1.0
    slopes = _slopes(f)
    if np.any(f.left != 0.0) and (len(points) == 1 or not _same(slopes[0], slopes[1])):
        points, values = (
            np.concatenate([[points[0] - step], points]),
            np.concatenate([values[:1] - step * f.left, values]),
        )
    if np.any(f.right != 0.0) and (len(f.points) == 1 or not _same(slopes[-1], slopes[-2])):
        points, values = (
            np.concatenate([points, [points[-1] + step]]),
            np.concatenate([values, values[-1:] + step * f.right]),
        )
    return points, values, bool(np.any(f.left != 0.0)), bool(np.any(f.right != 0.0))


def _slopes(f: PiecewiseLinear) -> np.ndarray:
    """Return the slopes (node + 1, ...) of all pieces, the two beyond the nodes included."""
    steps = np.diff(f.points).reshape((-1,) + (1,) * (f.values.ndim - 1))
    inside = np.diff(f.values, axis=0) / steps
    ends = [np.broadcast_to(end, f.values.shape[1:])[None] for end in (f.left, f.right)]
    return np.concatenate([ends[0], inside, ends[1]])


def _total(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the sum of two slopes; those that cancel but for rounding are zero."""
    return np.where(np.abs(a + b) <= _SAME * (np.abs(a) + np.abs(b)), 0.0, a + b)


def _same(a: np.ndarray, b: np.ndarray) -> bool:
    scale = max(float(np.abs(a).max(initial=0.0)), float(np.abs(b).max(initial=0.0)))
    return bool((np.abs(a - b) <= _SAME * scale).all())


def merge_points(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the points of both, rising; those of the first win over nearly equal ones of the
    second.
    """
    span = max(
        np.ptp(np.concatenate([a, b])), float(np.abs(b).max(initial=0.0)), np.finfo(float).tiny
    )
    new = [point for point in b if not len(a) or np.abs(a - point).min() > _SAME * span]
    return np.sort(np.concatenate([a, new]))


def find_preimages(targets: np.ndarray, inner: PiecewiseLinear) -> tuple[np.ndarray, list[int]]:
    """Return the places where the inner function meets the targets, and the number of the target at
    each.
    """
    edges = np.concatenate([[-np.inf], inner.points, [np.inf]])
    slopes = _slopes(inner)
    found: dict[float, int] = {}
    for i, slope in enumerate(slopes):
        if abs(slope) <= _SAME * np.abs(slopes).max():
            continue
        anchor = min(max(i - 1, 0), len(inner.points) - 1)
        for node, target in enumerate(targets):
            if (
                anchor == 0 and len(inner.points) == 1 and inner.points[0] == 0.0
            ):  # a straight conversion of units: one rounding
                x = float((target - inner.values[0]) / slope)
            else:
                x = float(inner.points[anchor] + (target - inner.values[anchor]) / slope)
            slack = _SAME * max(abs(x), 1e-300)
            if edges[i] - slack <= x <= edges[i + 1] + slack and not any(
                abs(x - other) <= slack for other in found
            ):
                found[x] = node
    return np.array(sorted(found)), [found[x] for x in sorted(found)]


def _without(f: PiecewiseLinear, needed: np.ndarray) -> PiecewiseLinear:
    """Drop the nodes at which the function goes straight on, except the needed ones."""
    slopes = _slopes(f)
    keep = [
        bool(np.isin(point, needed)) or not _same(slopes[i], slopes[i + 1])
        for i, point in enumerate(f.points)
    ]
    if not any(keep):
        keep[0] = True
    return PiecewiseLinear(f.points[keep], f.values[keep], f.left, f.right)
