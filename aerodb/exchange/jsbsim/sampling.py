"""Products of JSBSim functions and tables that share variables, as one table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from flightmech.terms import MAX_AXES, evaluate, make

from ..sampling import Unsampled, difference, tabulated
from .products import OpaqueFactor, Unfit

_FIRST = 5  # breakpoints of an axis that no table has


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

    try:
        table = tabulated(function, {name: _start(name, tables, box) for name in variables}, bound)
    except Unsampled as error:
        raise Unfit(f"{what}: {error}") from None
    worst = difference(function, table)
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
