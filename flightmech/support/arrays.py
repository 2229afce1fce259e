"""Multilinear interpolation in tables, statistics, runs and extremes of arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from flightmech.errors import OutOfRange
from flightmech.names import is_quantity, lookup

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike

# index of the breakpoint below each sample, and the fraction of the interval above it [0 ... 1]
Place = tuple[np.ndarray, np.ndarray]
# samples per block, so that the work arrays stay in the cache of the processor
_BLOCK = 8192


def locate_breakpoints(points: np.ndarray, x: np.ndarray, rule: str) -> Place:
    """Return the index of the breakpoint below each sample, and the fraction of the interval.

    Parameters
    ----------
    points : array, shape (breakpoints,)
        Increasing breakpoints.
    x : array, shape (samples,)
    rule : str
        ``"hold"`` limits the fraction to 0 ... 1. Any other rule extrapolates.
    """
    if len(points) == 1:
        return np.zeros(x.shape, np.intp), np.zeros(x.shape)
    low = (points.searchsorted(x, side="right") - 1).clip(0, len(points) - 2)
    fraction = (x - points.take(low)) / np.diff(points).take(low)
    if rule == "hold":
        fraction = fraction.clip(0.0, 1.0)
    return low, fraction


def interpolate_multilinear(nodes: np.ndarray, places: Sequence[Place]) -> np.ndarray:
    """Interpolate a table at samples.

    Parameters
    ----------
    nodes : array, one dimension per axis
    places : sequence of (array, array), one per axis
        Results of `locate_breakpoints`, shape (samples,).

    Returns
    -------
    array, shape (samples,)
    """
    # Along the last axis the table is held as value and difference of each interval, so that the
    # innermost interpolation reads two numbers of the same flat index.
    starts, differences = nodes[..., :-1].ravel(), np.diff(nodes).ravel()
    sizes = (*nodes.shape[:-1], nodes.shape[-1] - 1)
    # distance in the flat arrays between neighbours along each axis
    steps = [math.prod(sizes[i + 1 :]) for i in range(len(sizes))]
    values = np.empty(len(places[0][0]))

    def interpolate_from(axis: int, offset: int) -> np.ndarray:
        """Interpolate along `axis` and all later axes, `offset` from the lower corner."""
        if axis == len(places) - 1:
            value = differences[offset:].take(corner)
            value *= fractions[axis]
            value += starts[offset:].take(corner)
            return value
        below = interpolate_from(axis + 1, offset)
        above = interpolate_from(axis + 1, offset + steps[axis])
        # below + (above - below) * fraction, in place
        above -= below
        above *= fractions[axis]
        below += above
        return below

    for start in range(0, len(values), _BLOCK):
        block = slice(start, start + _BLOCK)
        fractions = [fraction[block] for _, fraction in places]
        # flat index of the lower corner of the cell of each sample
        corner = places[-1][0][block].copy()
        for (low, _), step in zip(places[:-1], steps):
            corner += low[block] * step
        values[block] = interpolate_from(0, 0)
    return values


def is_inside_axis(points: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return which samples lie between the ends of an axis."""
    return (x >= points[0]) & (x <= points[-1])


def _meant_degrees(axis: str, points: np.ndarray, value: float) -> str:
    """Return the question whether degrees are meant; empty if they are outside the axis, too."""
    if not is_quantity(axis) or lookup(axis).units != "rad":
        return ""
    if not is_inside_axis(points, np.radians(value)):
        return ""
    return f"; angles are in rad: if {value:g} deg is meant, give '{value:g} deg'"


def demand_inside(axis: str, points: np.ndarray, x: np.ndarray) -> None:
    """Raise `OutOfRange` with the worst sample if samples lie outside the ends of an axis."""
    mask = ~is_inside_axis(points, x)
    if mask.any():
        outside = x[mask]
        distance = np.abs(outside - np.clip(outside, points[0], points[-1]))
        worst = outside[np.argmax(distance)]
        raise OutOfRange(
            f"{axis} = {worst:.6g} lies outside {points[0]:.6g} ... {points[-1]:.6g} in "
            f"{int(mask.sum())} of {len(x)} samples, "
            f"first at sample {int(np.argmax(mask))}; extend the table or pass outside='clamp'"
            f"{_meant_degrees(axis, points, worst)}",
            mask,
        )


def rms(x: ArrayLike) -> float:
    """Return the root mean square in the unit of `x`.

    The result is NaN if `x` is empty or contains a NaN.

    Examples
    --------
    >>> rms([3.0, -3.0])
    3.0
    """
    squares = np.square(x)
    if not squares.size:
        return math.nan
    # the same sum as numpy.mean, without its checks, which dominate for short arrays
    return float(np.sqrt(np.add.reduce(squares, axis=None) / squares.size))


def integrate_trapezoids(time: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the integral of samples (time,) from the first one on, by the trapezoidal rule.

    Examples
    --------
    >>> integrate_trapezoids(np.array([0.0, 1.0, 3.0]), np.array([0.0, 2.0, 2.0]))
    array([0., 1., 5.])
    """
    return np.concatenate([[0.0], np.cumsum(0.5 * (x[1:] + x[:-1]) * np.diff(time))])


def median(x: np.ndarray) -> float:
    """Return the median of `x`, shape (n,), n > 0, without NaN, in the unit of `x`.

    The result equals that of `numpy.median`, which would import `numpy.ma`.

    Examples
    --------
    >>> median(np.array([3.0, 1.0, 2.0, 10.0]))
    2.5
    """
    # the two middle samples, which are the same one if their number is odd
    low, high = (len(x) - 1) // 2, len(x) // 2
    parted = np.partition(x, (low, high))
    return float((parted[low] + parted[high]) / 2.0)


def columns_with_count(data: Any) -> tuple[Mapping[Any, Any], int]:
    """Return the columns by name, and the number of samples.

    Parameters
    ----------
    data : xarray.Dataset or mapping of str to array
        No DataArray is formed of the columns of a Dataset.
    """
    if hasattr(data, "variables"):
        # the dimension of common errors can be longer than a short time axis
        sizes = [size for name, size in data.sizes.items() if name != "error"]
        return data.variables, max(sizes, default=1)
    return data, max(map(np.size, data.values()), default=1)


def true_runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """Return start and end (exclusive) of every run of true samples."""
    # with false samples at both ends each run has a rising and a falling edge
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def true_spans(time: np.ndarray, mask: np.ndarray) -> list[tuple[float, float]]:
    """Return the times of the first and the last sample of every run of true samples. [s]"""
    return [(float(time[start]), float(time[stop - 1])) for start, stop in true_runs(mask)]


def picked_runs(mask: np.ndarray) -> list[slice]:
    """Return the runs of true samples as slices of ``x[mask]``, the true samples alone.

    Examples
    --------
    >>> picked_runs(np.array([True, True, False, True]))
    [slice(0, 2, None), slice(2, 3, None)]
    """
    lengths = [stop - start for start, stop in true_runs(mask)]
    return [slice(start, stop) for start, stop in pairwise(accumulate(lengths, initial=0))]


def thin_to_extremes(y: np.ndarray, buckets: int = 420) -> np.ndarray:
    """Return the indices of the smallest and the largest value in each of `buckets` equal parts.

    A short line keeps all samples. A part without a finite value keeps one sample, so that a gap of
    the line remains.
    """
    if len(y) <= 2 * buckets:
        return np.arange(len(y))
    edges = np.linspace(0, len(y), buckets + 1).astype(int)
    picked: list[int] = []
    for start, end in pairwise(edges.tolist()):
        part = y[start:end]
        if np.isfinite(part).any():
            picked += sorted({start + int(np.nanargmin(part)), start + int(np.nanargmax(part))})
        else:
            picked.append(start)
    return np.array(picked)
