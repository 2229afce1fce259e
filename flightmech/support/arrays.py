"""Multilinear interpolation in tables: where samples lie between breakpoints, and what the nodes
give there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from flightmech.errors import OutOfRange

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike

Place = tuple[
    np.ndarray, np.ndarray
]  # the breakpoint below each sample, and how far on the way to the next one it lies
_BLOCK = 8192  # samples interpolated at a time: what they need stays in the cache of the processor


def locate_breakpoints(points: np.ndarray, x: np.ndarray, rule: str) -> Place:
    """Return the breakpoint below each sample and how far on the way to the next one it lies."""
    if len(points) == 1:
        return np.zeros(x.shape, np.intp), np.zeros(x.shape)
    low = (points.searchsorted(x, side="right") - 1).clip(0, len(points) - 2)
    fraction = (x - points.take(low)) / np.diff(points).take(low)
    return low, fraction.clip(0.0, 1.0) if rule == "hold" else fraction


def interpolate_multilinear(nodes: np.ndarray, places: Sequence[Place]) -> np.ndarray:
    """Return a table (axes...) at places along each axis, (samples,)."""
    starts, rises = nodes[..., :-1].ravel(), np.diff(nodes).ravel()
    sizes = (*nodes.shape[:-1], nodes.shape[-1] - 1)
    steps = [math.prod(sizes[i + 1 :]) for i in range(len(sizes))]
    found = np.empty(len(places[0][0]))

    def along(i: int, offset: int) -> np.ndarray:
        if i == len(places) - 1:
            value = rises[offset:].take(cell)
            value *= fractions[i]
            value += starts[offset:].take(cell)
            return value
        below, above = along(i + 1, offset), along(i + 1, offset + steps[i])
        above -= below
        above *= fractions[i]
        below += above
        return below

    for start in range(0, len(found), _BLOCK):
        block = slice(start, start + _BLOCK)
        fractions = [fraction[block] for _, fraction in places]
        cell = places[-1][0][block].copy()
        for (low, _), step in zip(places[:-1], steps):
            cell += low[block] * step
        found[block] = along(0, 0)
    return found


def is_inside_axis(points: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return which samples lie between the ends of an axis."""
    return (x >= points[0]) & (x <= points[-1])


def demand_inside(axis: str, points: np.ndarray, x: np.ndarray) -> None:
    """Raise `OutOfRange` with the worst sample when some lie beyond the ends of an axis."""
    mask = ~is_inside_axis(points, x)
    if mask.any():
        worst = x[mask][np.argmax(np.abs(x[mask] - np.clip(x[mask], points[0], points[-1])))]
        raise OutOfRange(
            f"{axis} = {worst:.6g} lies outside {points[0]:.6g} ... {points[-1]:.6g} in "
            f"{int(mask.sum())} of {len(x)} samples, "
            f"first at sample {int(np.argmax(mask))}; extend the table or pass outside='clamp'",
            mask,
        )


def rms(x: ArrayLike) -> float:
    """Return the root of the mean square, in the unit of `x`; NaN where there are no samples or one
    is NaN.

    Examples
    --------
    >>> rms([3.0, -3.0])
    3.0
    """
    squares = np.square(x)
    # the sum of `numpy.mean`, without what it asks first: that takes longer than the work where
    # there are a thousand numbers
    return (
        float(np.sqrt(np.add.reduce(squares, axis=None) / squares.size))
        if squares.size
        else math.nan
    )


def median(x: np.ndarray) -> float:
    """Return the median of one number or more (n,), none of them NaN, in their unit, as
    `numpy.median` does.

    That one imports `numpy.ma`, which takes a tenth of the time of a command that only shows a
    recording.

    Examples
    --------
    >>> median(np.array([3.0, 1.0, 2.0, 10.0]))
    2.5
    """
    low, high = (len(x) - 1) // 2, len(x) // 2
    parted = np.partition(x, (low, high))
    return float((parted[low] + parted[high]) / 2.0)


def columns_with_count(data: Any) -> tuple[Mapping[Any, Any], int]:
    """Return columns by name, and the number of samples, of a Dataset, without forming a DataArray
    of each, or of a mapping of arrays.
    """
    if hasattr(data, "variables"):
        samples = (
            size for name, size in data.sizes.items() if name != "error"
        )  # a few samples may have more common errors
        return data.variables, max(samples, default=1)
    return data, max(map(np.size, data.values()), default=1)
