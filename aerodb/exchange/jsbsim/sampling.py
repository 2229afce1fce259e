"""Sampling of products of a JSBSim file that are not products of tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import xarray as xr

from aerodb.exchange.jsbsim.products import NotAProduct, OpaqueFactor
from aerodb.exchange.sampling import SamplingError, largest_difference, tabulate_function
from aerodb.exchange.spelling import spell
from flightmech.terms import MAX_AXES, evaluate_term, make_term

_FIRST = 5  # initial breakpoints of an axis that no table has


def sample_product(
    opaque: Sequence[OpaqueFactor],
    tables: Sequence[xr.DataArray],
    bound: float | None,
    box: Mapping[str, tuple[float, float]],
) -> tuple[xr.DataArray, str]:
    """Return a product of functions and tables as one table, and a remark on its accuracy.

    Parameters
    ----------
    opaque, tables : sequences
        The factors.
    bound : float, optional
        Largest difference between the product and the table inside the box.  None refuses the
        product.
    box : mapping of str to (low, high)
        Range of variables.  The default is the range of the tables that have the axis. [SI]

    Raises
    ------
    NotAProduct
        The bound or the range of a variable is missing, the table has too many axes or nodes, or
        the product is not finite.
    """
    label, variables = _describe_product(opaque, tables)
    if bound is None:
        raise NotAProduct(
            f"{label} is not a product of tables without common axes; give "
            f"{spell('sample =', '--sample with the')} largest difference to put it onto one table"
        )
    if len(variables) > MAX_AXES:
        raise NotAProduct(
            f"{label} depends on {', '.join(variables)}; a table has at most {MAX_AXES} axes"
        )
    evaluate = _product_function(opaque, tables, label)
    starts = {name: _initial_points(name, tables, box) for name in variables}
    try:
        sampled = tabulate_function(evaluate, starts, bound)
    except SamplingError as error:
        raise NotAProduct(f"{label}: {error}") from None
    # The refinement looks at one axis after the other, so the total difference is measured.
    worst = largest_difference(evaluate, sampled)
    if worst > bound:
        raise NotAProduct(
            f"{label} on {sampled.size} nodes differs by {worst:.2g}, more than {bound:.2g}; "
            f"give a wider bound or a narrower range with {spell('box', '--grid')}"
        )
    remark = f"{label} sampled on {sampled.size} nodes: largest difference seen {worst:.2g}"
    return sampled, remark


def _describe_product(
    opaque: Sequence[OpaqueFactor], tables: Sequence[xr.DataArray]
) -> tuple[str, list[str]]:
    """Return a product in words, and the variables of all its factors."""
    labels = [factor.what for factor in opaque]
    variables: set[str] = set()
    for table in tables:
        labels.append(f"table({', '.join(map(str, table.dims))})")
        variables.update(map(str, table.dims))
    for factor in opaque:
        variables |= factor.variables
    return " x ".join(labels), sorted(variables)


def _product_function(
    opaque: Sequence[OpaqueFactor], tables: Sequence[xr.DataArray], label: str
) -> Callable[[Mapping[str, np.ndarray]], np.ndarray]:
    """Return the function of states that multiplies all factors."""
    leaves = []
    for table in tables:
        leaves.append(make_term(table.values, {str(d): table[d].values for d in table.dims}))

    def evaluate(states: Mapping[str, np.ndarray]) -> np.ndarray:
        value = np.ones(())
        for leaf in leaves:
            value = value * evaluate_term(leaf, states, "clamp")
        for factor in opaque:
            value = value * factor.value(states)
        if not np.isfinite(value).all():
            raise NotAProduct(
                f"{label} is not finite inside its range; give "
                + spell("box = {variable: (low, high)}", "--grid VARIABLE='LOW HIGH UNIT'")
                + " to narrow it"
            )
        return value

    return evaluate


def _initial_points(
    name: str, tables: Sequence[xr.DataArray], box: Mapping[str, tuple[float, float]]
) -> np.ndarray:
    """Return the breakpoints of all tables over an axis inside its range."""
    axes = [table[name].values for table in tables if name in table.dims]
    points = np.unique(np.concatenate(axes or [np.array([])]))
    if name in box:
        low, high = box[name]
        points = np.union1d(points[(points > low) & (points < high)], [low, high])
    if len(points) < 2:
        raise NotAProduct(
            f"no table states how far {name} goes; give "
            + spell(f"box = {{{name!r}: (low, high)}}", f"--grid {name}='LOW HIGH UNIT'")
        )
    if len(points) == 2:
        return np.linspace(points[0], points[-1], _FIRST)
    return points
