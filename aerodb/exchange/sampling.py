"""Sampling of a function on one table, with a bound on the difference."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

import numpy as np
import xarray as xr

from flightmech.terms import evaluate_term, make_term

MOST_NODES = 100_000
_STATES = 5000  # states at which a table is compared with its function
# Shortest interval, relative to the range of its axis. In a shorter one the function jumps.
_SHORTEST = 1e-9

Function = Callable[[Mapping[str, np.ndarray]], np.ndarray]
"""Values at states by variable, all arrays of one length. [SI]"""


class SamplingError(Exception):
    """A function that no table follows within the bound; the text states why, and what to do."""


def tabulate_function(
    function: Function, grid: Mapping[str, np.ndarray], bound: float, fixed: Collection[str] = ()
) -> xr.DataArray:
    """Return a function on a grid whose intervals are halved until it is linear in each of them.

    Parameters
    ----------
    function : callable
        The function.
    grid : mapping of str to array
        First breakpoints by axis; all of them stay breakpoints.
    bound : float
        Largest difference between the table and the function.  Each axis has half of its share.
    fixed : collection of str
        Axes that get no further breakpoints.

    Returns
    -------
    DataArray
        Values at the nodes of the refined grid.

    Raises
    ------
    SamplingError
        The bound needs more than `MOST_NODES` nodes, or the function jumps.
    """
    # Half of the bound is a margin for the interaction of the axes.
    tolerance, points = 0.5 * bound / len(grid), dict(grid)
    while True:
        table = on_grid(function, points)
        additional = {}
        for axis, x in points.items():
            # Fixed axes are evaluated as well, because the function may refuse a state.
            is_curved = _find_bends(function, table, axis, tolerance=tolerance)
            if axis in fixed:
                is_curved = np.zeros_like(is_curved)
            additional[axis] = 0.5 * (x[1:] + x[:-1])[is_curved]
            is_short = np.diff(x)[is_curved] < _SHORTEST * np.ptp(x)
            if is_short.any():
                raise SamplingError(
                    f"it jumps near {axis} = {additional[axis][is_short][0]:.6g}; a table cannot "
                    f"follow it, leave it out"
                )
        if not any(map(len, additional.values())):
            return table
        points = {axis: np.union1d(x, additional[axis]) for axis, x in points.items()}
        # The product is a float because that of many axes may exceed an integer.
        if np.prod([float(len(x)) for x in points.values()]) > MOST_NODES:
            raise SamplingError(
                f"it needs more than {MOST_NODES} nodes for {bound:.2g}; give a wider bound "
                f"or a narrower range"
            )


def _find_bends(function: Function, table: xr.DataArray, axis: str, tolerance: float) -> np.ndarray:
    """Return for each interval of an axis whether the function is not linear in it."""
    points = {str(d): table[d].values for d in table.dims}
    x = points[axis]
    middle = 0.5 * (x[1:] + x[:-1])
    values = on_grid(function, {**points, axis: middle})
    # The chord is the value of the table in the middle of each interval.
    upper = table.isel({axis: slice(1, None)}).values
    lower = table.isel({axis: slice(None, -1)}).values
    difference = np.abs(values.values - 0.5 * (upper + lower))
    other_axes = tuple(i for i, d in enumerate(values.dims) if d != axis)
    return difference.max(other_axes) > tolerance


def on_grid(function: Function, grid: Mapping[str, np.ndarray]) -> xr.DataArray:
    """Return a function at the nodes of a grid."""
    mesh = np.meshgrid(*grid.values(), indexing="ij")
    shape = tuple(len(points) for points in grid.values())
    states = {name: axis.ravel() for name, axis in zip(grid, mesh, strict=True)}
    # A function of no variable gives one value for all nodes.
    values = np.broadcast_to(function(states), (int(np.prod(shape)),))
    return xr.DataArray(values.reshape(shape), dict(grid), tuple(grid))


def largest_difference(function: Function, table: xr.DataArray) -> float:
    """Return the largest difference of a function and its table at 5000 states over the table."""
    random = np.random.default_rng(0)
    points = {str(d): table[d].values for d in table.dims}
    states = {}
    for name, x in points.items():
        states[name] = random.uniform(x[0], x[-1], _STATES)
    leaf = make_term(table.values, points)
    return float(np.abs(evaluate_term(leaf, states) - function(states)).max())
