"""Functions that are no products of tables, put onto one table with a bound on the difference."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

import numpy as np
import xarray as xr

from flightmech.terms import evaluate_term, make_term

MOST_NODES = 100_000
_CHECKS = 5000

Function = Callable[[Mapping[str, np.ndarray]], np.ndarray]
"""Values at states by variable, all arrays of one length. [SI]"""


_SHORTEST = 1e-9  # of the range of an axis: the function jumps in an interval as short as that


class SamplingError(Exception):
    """A function that no table within the bound follows; the text states why, and what to do."""


def tabulate_function(
    function: Function, grid: Mapping[str, np.ndarray], bound: float, fixed: Collection[str] = ()
) -> xr.DataArray:
    """Return a function on a grid whose intervals are halved until it is straight in each, axis by
    axis.

    Parameters
    ----------
    function : callable
        At the nodes of the grid and between.
    grid : mapping of str to array
        Breakpoints to begin with; all of them are kept.
    bound : float
        Largest difference allowed between the table and the function; each axis has half of its
        share of it.
    fixed : collection of str
        Axes that keep the breakpoints given.

    Raises
    ------
    Unsampled
        The bound needs more than `MOST_NODES` nodes, or the function jumps.
    """
    share, points = 0.5 * bound / len(grid), dict(grid)
    while True:
        nodes = on_grid(function, points)
        split = {}
        for axis, at in points.items():
            middle = 0.5 * (at[1:] + at[:-1])
            seen = on_grid(function, {**points, axis: middle})
            chord = 0.5 * (
                nodes.isel({axis: slice(1, None)}).values
                + nodes.isel({axis: slice(None, -1)}).values
            )
            off = np.abs(seen.values - chord).max(
                tuple(i for i, d in enumerate(seen.dims) if d != axis)
            )
            split[axis] = middle[off > share] if axis not in fixed else middle[:0]
            short = (
                np.diff(at)[off > share] < _SHORTEST * np.ptp(at)
                if axis not in fixed
                else np.zeros(0, bool)
            )
            if short.any():
                raise SamplingError(
                    f"it jumps near {axis} = {split[axis][short][0]:.6g}; a table cannot "
                    f"follow it, leave it out"
                )
        if not any(len(new) for new in split.values()):
            return nodes
        points = {axis: np.union1d(at, split[axis]) for axis, at in points.items()}
        if np.prod([float(len(at)) for at in points.values()]) > MOST_NODES:
            raise SamplingError(
                f"it needs more than {MOST_NODES} nodes for {bound:.2g}; give a wider bound "
                f"or a narrower range"
            )


def on_grid(function: Function, grid: Mapping[str, np.ndarray]) -> xr.DataArray:
    """Return a function at the nodes of a grid."""
    mesh = np.meshgrid(*grid.values(), indexing="ij")
    shape = tuple(len(points) for points in grid.values())
    values = np.broadcast_to(
        function({name: axis.ravel() for name, axis in zip(grid, mesh)}), (int(np.prod(shape)),)
    )
    return xr.DataArray(values.reshape(shape), dict(grid), tuple(grid))


def largest_difference(function: Function, table: xr.DataArray) -> float:
    """Return the largest difference between a function and its table at 5000 states spread over the
    table.
    """
    draw = np.random.default_rng(0)
    at = {
        str(d): draw.uniform(table[d].values[0], table[d].values[-1], _CHECKS) for d in table.dims
    }
    leaf = make_term(table.values, {str(d): table[d].values for d in table.dims})
    return float(np.abs(evaluate_term(leaf, at) - function(at)).max())
