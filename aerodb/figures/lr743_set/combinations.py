"""Sums and differences of a coefficient at several conditions, with their standard errors: slopes
and increments of a database.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from aerodb.comparison.conditions import (
    coefficient_points,
    leaf_breakpoints,
    merge_leaf_breakpoints,
    neutral_value,
)
from aerodb.figures.lr743_set.chart import NotDrawn
from aerodb.store.evaluation import evaluate
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
        There is none.
    """
    found = [leaf for name, leaf in terms(db).items() if name.split("/")[0] == coefficient]
    if not found:
        raise NotDrawn(f"the database has no term of {coefficient}")
    return found


def points_of(db: xr.DataTree, coefficient: str, axis: str, among: str = "") -> np.ndarray:
    """Return the breakpoints of an axis over all terms of a coefficient, or over those that depend
    on the variable `among`. [SI]

    Raises
    ------
    NotDrawn
        No term has the axis.
    """
    leaves = [
        leaf
        for leaf in coefficient_leaves(db, coefficient)
        if not among or among in _terms.list_model_variables(leaf)
    ]
    points = merge_leaf_breakpoints(leaves)
    if axis not in points:
        raise NotDrawn(f"no term of {coefficient} is a table over {axis}")
    return points[axis]


def span_of(db: xr.DataTree, coefficient: str, axis: str) -> tuple[float, float]:
    """Return the range of an axis that all tables of a coefficient share. [SI]"""
    ends = [
        (points[0], points[-1])
        for leaf in coefficient_leaves(db, coefficient)
        for name, points in leaf_breakpoints(leaf).items()
        if name == axis
    ]
    if not ends:
        raise NotDrawn(f"no term of {coefficient} is a table over {axis}")
    return float(max(low for low, _ in ends)), float(min(high for _, high in ends))


def remove_moving_devices(db: xr.DataTree, coefficient: str) -> dict[str, float]:
    """Return the variables of a coefficient at rest, in free air and at the lowest height;
    coefficients that it depends on are left out.
    """
    points = coefficient_points(coefficient_leaves(db, coefficient), [])
    return {
        name: neutral_value(name, values)
        for name, values in points.items()
        if name not in COEFFICIENTS
    }


def combine_coefficients(
    db: xr.DataTree, coefficient: str, *parts: tuple[float, Condition]
) -> tuple[np.ndarray, np.ndarray]:
    """Return sum_i w_i C(x_i) of a coefficient C with its standard error.

    Parameters
    ----------
    db : DataTree
    coefficient : str
    *parts : (w, conditions)
        Weights, and conditions that differ from rest, each () or (points,). [SI]

    Returns
    -------
    value, stderr : array (points,)
        The map from the nodes to the sum is linear, sum_i w_i B_i, so that its standard error is
        that of any other one (`aerodb.update.standard_errors`).
    """
    leaves = coefficient_leaves(db, coefficient)
    rest = remove_moving_devices(db, coefficient)
    count = np.broadcast_shapes(
        *(np.shape(value) for _, given in parts for value in given.values()), (1,)
    )
    whole = [(weight, _complete(db, leaves, {**rest, **given}, count)) for weight, given in parts]
    maps: list[Any] = []
    for leaf in leaves:
        maps.append(
            sum(
                weight * repeat_rows(_terms.basis(leaf, conditions, "clamp"), count[0])
                for weight, conditions in whole
            )
        )
    value = np.sum([B @ leaf["value"].values.ravel() for B, leaf in zip(maps, leaves)], axis=0)
    return value, spread_of_sum(list(zip(maps, leaves)))


def _complete(
    db: xr.DataTree, leaves: list[xr.Dataset], given: Condition, count: tuple[int, ...]
) -> dict[str, np.ndarray]:
    """Return conditions (points,) with the coefficients on which the terms depend."""
    needed = {name for leaf in leaves for name in _terms.list_model_variables(leaf)}
    found = {
        name: np.broadcast_to(np.asarray(value, float), count) for name, value in given.items()
    }
    summed = [name for name in needed if name in COEFFICIENTS and name not in found]
    return found | {
        name: np.broadcast_to(
            evaluate(db, name, "clamp", **{**remove_moving_devices(db, name), **found}), count
        )
        for name in summed
    }
