"""Functions that are no products of tables, put onto one table with a bound on the difference."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import xarray as xr

from flightmech.terms import MAX_AXES, evaluate, make

from .products import OpaqueFactor, Unfit

_MOST_NODES = 100_000
_FIRST = 5  # breakpoints of an axis that no table has
_CHECKS = 5000

Function = Callable[[Mapping[str, np.ndarray]], np.ndarray]


def sampled(
    opaque: Sequence[OpaqueFactor], tables: Sequence[xr.DataArray], bound: float | None, box: Mapping[str, tuple[float, float]]
) -> tuple[xr.DataArray, str]:
    """Return a product of functions and tables as one table, and a text that states how well.

    Parameters
    ----------
    opaque, tables : sequences
        The factors.
    bound : float, optional
        Largest difference between the product and the table inside the box; None: refuse.
    box : mapping of str to (low, high)
        Range of variables; without an entry, the range of the tables that have the axis. [SI]

    Raises
    ------
    Unfit
        With what to do: no bound, no range of a variable, too many axes or nodes, or not finite.
    """
    what = " x ".join([*(one.what for one in opaque), *(f"table({', '.join(map(str, table.dims))})" for table in tables)])
    if bound is None:
        raise Unfit(f"{what} is no product of tables without common axes; give sample = largest difference to put it onto one table")
    variables = sorted({str(d) for table in tables for d in table.dims}.union(*(one.variables for one in opaque)))
    if len(variables) > MAX_AXES:
        raise Unfit(f"{what} depends on {', '.join(variables)}; a table has at most {MAX_AXES} axes")
    leaves = [make(table.values, {str(d): table[d].values for d in table.dims}) for table in tables]

    def function(at: Mapping[str, np.ndarray]) -> np.ndarray:
        found = np.ones(())
        for leaf in leaves:
            found = found * evaluate(leaf, at, "clamp")
        for one in opaque:
            found = found * one.value(at)
        if not np.isfinite(found).all():
            raise Unfit(f"{what} is not finite inside its box; give box = {{variable: (low, high)}} to narrow it")
        return found

    grid = {name: _start(name, tables, box) for name in variables}
    grid = _refined(function, grid, bound, what)
    table = _on(function, grid)
    worst = _checked(function, table)
    if worst > bound:
        raise Unfit(f"{what} on {table.size} nodes differs by {worst:.2g}, more than {bound:.2g}; give a wider bound or a narrower box")
    return table, f"{what} sampled on {table.size} nodes: largest difference seen {worst:.2g}"


def _start(name: str, tables: Sequence[xr.DataArray], box: Mapping[str, tuple[float, float]]) -> np.ndarray:
    """Return the breakpoints of all tables over an axis inside its range."""
    points = np.unique(np.concatenate([table[name].values for table in tables if name in table.dims] or [np.array([])]))
    if name in box:
        low, high = box[name]
        points = np.union1d(points[(points > low) & (points < high)], [low, high])
    if len(points) < 2:
        raise Unfit(f"no table states how far {name} goes; give box = {{{name!r}: (low, high)}}")
    return points if len(points) > 2 else np.linspace(points[0], points[-1], _FIRST)


def _refined(function: Function, grid: dict[str, np.ndarray], bound: float, what: str) -> dict[str, np.ndarray]:
    """Return a grid whose intervals are halved until the function is straight in each, axis by axis."""
    share = 0.5 * bound / len(grid)
    while True:
        nodes = _on(function, grid)
        split = {}
        for axis, points in grid.items():
            middle = 0.5 * (points[1:] + points[:-1])
            seen = _on(function, {**grid, axis: middle})
            chord = 0.5 * (nodes.isel({axis: slice(1, None)}).values + nodes.isel({axis: slice(None, -1)}).values)
            off = np.abs(seen.values - chord).max(tuple(i for i, d in enumerate(seen.dims) if d != axis))
            split[axis] = middle[off > share]
        if not any(len(points) for points in split.values()):
            return grid
        grid = {axis: np.union1d(points, split[axis]) for axis, points in grid.items()}
        count = int(np.prod([len(points) for points in grid.values()]))
        if count > _MOST_NODES:
            raise Unfit(f"{what} needs more than {_MOST_NODES} nodes for {bound:.2g}; give a wider bound or a narrower box")


def _on(function: Function, grid: Mapping[str, np.ndarray]) -> xr.DataArray:
    mesh = np.meshgrid(*grid.values(), indexing="ij")
    shape = tuple(len(points) for points in grid.values())
    values = np.broadcast_to(function({name: axis.ravel() for name, axis in zip(grid, mesh)}), (int(np.prod(shape)),))
    return xr.DataArray(values.reshape(shape), dict(grid), tuple(grid))


def _checked(function: Function, table: xr.DataArray) -> float:
    """Return the largest difference at points spread over the box."""
    draw = np.random.default_rng(0)
    at = {str(d): draw.uniform(table[d].values[0], table[d].values[-1], _CHECKS) for d in table.dims}
    leaf = make(table.values, {str(d): table[d].values for d in table.dims})
    return float(np.abs(evaluate(leaf, at) - function(at)).max())
