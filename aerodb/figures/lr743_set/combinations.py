"""Slopes and increments of a database: weighted sums of a coefficient with standard errors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from aerodb.comparison.conditions import (
    coefficient_points,
    leaf_breakpoints,
    merge_leaf_breakpoints,
)
from aerodb.figures.lr743_set.chart import NotDrawn
from aerodb.store.evaluation import evaluate
from aerodb.store.grids import neutral_value
from aerodb.store.schema import terms
from aerodb.update.standard_errors import repeat_rows, spread_of_sum
from flightmech import terms as _terms
from flightmech.build_up import COEFFICIENTS

Condition = Mapping[str, Any]


def coefficient_leaves(db: xr.DataTree, coefficient: str) -> list[xr.Dataset]:
    """Return the terms of a coefficient.

    Raises
    ------
    NotDrawn
        The database has no term of the coefficient.
    """
    leaves = [leaf for name, leaf in terms(db).items() if name.split("/")[0] == coefficient]
    if not leaves:
        raise NotDrawn(f"the database has no term of {coefficient}")
    return leaves


def points_of(db: xr.DataTree, coefficient: str, axis: str, among: str = "") -> np.ndarray:
    """Return the breakpoints of an axis over the terms of a coefficient. [SI]

    With `among` only terms that depend on this variable count.

    Raises
    ------
    NotDrawn
        No term has the axis.
    """
    leaves = coefficient_leaves(db, coefficient)
    if among:
        leaves = [leaf for leaf in leaves if among in _terms.list_model_variables(leaf)]
    points = merge_leaf_breakpoints(leaves)
    if axis not in points:
        raise NotDrawn(f"no term of {coefficient} is a table over {axis}")
    return points[axis]


def span_of(db: xr.DataTree, coefficient: str, axis: str) -> tuple[float, float]:
    """Return the range of an axis that all tables of a coefficient have in common. [SI]"""
    # Lower and upper end of each table with the axis.
    ends = []
    for leaf in coefficient_leaves(db, coefficient):
        breakpoints = leaf_breakpoints(leaf)
        if axis in breakpoints:
            ends.append((breakpoints[axis][0], breakpoints[axis][-1]))
    if not ends:
        raise NotDrawn(f"no term of {coefficient} is a table over {axis}")
    return float(max(low for low, _ in ends)), float(min(high for _, high in ends))


def remove_moving_devices(db: xr.DataTree, coefficient: str) -> dict[str, float]:
    """Return the variables of a coefficient at rest, in free air and at the lowest height. [SI]

    Coefficients on which it depends are left out.
    """
    # `coefficient_points` compares two sides; here the other side is empty.
    points = coefficient_points(coefficient_leaves(db, coefficient), [])
    at_rest = {}
    for name, values in points.items():
        if name not in COEFFICIENTS:
            at_rest[name] = neutral_value(name, values)
    return at_rest


def combine_coefficients(
    db: xr.DataTree, coefficient: str, *parts: tuple[float, Condition]
) -> tuple[np.ndarray, np.ndarray]:
    """Return sum_i w_i C(x_i) of a coefficient C with its standard error.

    Parameters
    ----------
    db : DataTree
        The database.
    coefficient : str
        The coefficient.
    *parts : (w, conditions)
        Weights, and conditions that differ from rest, each () or (point,). [SI]

    Returns
    -------
    value, stderr : array (point,)
        The sum is linear in the nodes, with the map sum_i w_i B_i.  Its standard error follows from
        this map (`aerodb.update.standard_errors`).
    """
    leaves = coefficient_leaves(db, coefficient)
    at_rest = remove_moving_devices(db, coefficient)
    # All conditions have the same number of points.
    shapes: list[tuple[int, ...]] = [(1,)]
    for _, condition in parts:
        shapes += [np.shape(value) for value in condition.values()]
    shape = np.broadcast_shapes(*shapes)
    complete_parts = []
    for weight, condition in parts:
        conditions = _add_coefficients(db, leaves, {**at_rest, **condition}, shape=shape)
        complete_parts.append((weight, conditions))
    # One map per term: values at the points = map @ nodes.
    maps: list[Any] = []
    for leaf in leaves:
        rows = []
        for weight, conditions in complete_parts:
            B = _terms.basis(leaf, conditions, "clamp")
            rows.append(weight * repeat_rows(B, shape[0]))
        maps.append(sum(rows))
    pairs = list(zip(maps, leaves, strict=True))
    value = np.sum([B @ leaf["value"].values.ravel() for B, leaf in pairs], axis=0)
    return value, spread_of_sum(pairs)


def _add_coefficients(
    db: xr.DataTree, leaves: list[xr.Dataset], condition: Condition, shape: tuple[int, ...]
) -> dict[str, np.ndarray]:
    """Return conditions (point,) with the coefficients on which the terms depend."""
    arrays = {}
    for name, value in condition.items():
        arrays[name] = np.broadcast_to(np.asarray(value, float), shape)
    # A term may depend on a coefficient, such as CL. It is evaluated at the same conditions.
    needed = set().union(*(_terms.list_model_variables(leaf) for leaf in leaves))
    coefficients = {}
    for name in needed:
        if name in COEFFICIENTS and name not in arrays:
            conditions = {**remove_moving_devices(db, name), **arrays}
            coefficients[name] = np.broadcast_to(evaluate(db, name, "clamp", **conditions), shape)
    return arrays | coefficients
