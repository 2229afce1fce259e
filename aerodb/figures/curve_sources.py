"""Curves of one term or one coefficient of several databases, with nodes and standard errors."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
import xarray as xr

from aerodb.comparison.conditions import (
    coefficient_points,
    leaf_breakpoints,
    merge_leaf_breakpoints,
)
from aerodb.store.grids import neutral_value
from aerodb.store.schema import terms
from aerodb.update.standard_errors import standard_errors
from flightmech import terms as _terms
from flightmech.errors import SchemaError, UnknownName

# Preferred variables of a family of curves: first the causes of a term, then the flow.
FAMILY_ORDER = (
    "h_agl",
    "delta_f",
    "delta_e",
    "delta_a",
    "delta_r",
    "delta_s",
    "delta_d",
    "gear",
    "speedbrake",
    "mach",
    "h",
    "alpha",
)
# Points per interval of the breakpoints. Between them standard errors are curved.
_FINE = 4


@dataclass(frozen=True)
class DatabaseCurve:
    """One curve of one database.

    Attributes
    ----------
    x : array (point,)
        Abscissae. [SI]
    y, stderr : array (point,)
        Values and standard errors.  A standard error is zero if none is stated.
    node_x, node_y : array (node,)
        Breakpoints of the table on the curve, and their values.
    node_source : array (node,)
        Their sources: 0 datcom, 1 flight, 2 judgement, -1 not stated.
    """

    x: np.ndarray
    y: np.ndarray
    stderr: np.ndarray
    node_x: np.ndarray = field(default_factory=lambda: np.zeros(0))
    node_y: np.ndarray = field(default_factory=lambda: np.zeros(0))
    node_source: np.ndarray = field(default_factory=lambda: np.zeros(0, int))


def refine_breakpoints(points: np.ndarray) -> np.ndarray:
    """Return breakpoints with points between them, where standard errors are curved."""
    if len(points) == 1:
        return points
    intervals = [np.linspace(low, high, _FINE, endpoint=False) for low, high in pairwise(points)]
    return np.concatenate([*intervals, points[-1:]])


class TermSource:
    """Curves of one term."""

    order = FAMILY_ORDER

    def __init__(self, databases: Mapping[str, xr.DataTree], name: str):
        self.name = name
        self.leaves: dict[str, xr.Dataset] = {}
        all_names: set[str] = set()
        for label, db in databases.items():
            leaves = terms(db)
            all_names |= set(leaves)
            if name in leaves:
                self.leaves[label] = leaves[name]
        if not self.leaves:
            raise UnknownName(name, all_names, "term")
        self.labels = list(self.leaves)
        self.points = merge_leaf_breakpoints(self.leaves.values())
        if not self.points:
            raise SchemaError(
                name,
                [
                    "has no axis and therefore no curve; `aeromatch db show --term` prints "
                    "the number"
                ],
            )
        first = next(iter(self.leaves.values()))
        self.regressors = _terms.list_regressors(first)
        self.power = _terms.power_factor(first)
        self._demand_same_multipliers()

    def _demand_same_multipliers(self) -> None:
        """Raise if the tables of the databases are multiplied by different variables."""
        multipliers = {}
        for label, leaf in self.leaves.items():
            multipliers[label] = " ".join(_terms.list_multipliers(leaf)) or "none"
        if len(set(multipliers.values())) > 1:
            listed = ", ".join(f"{label} has {names}" for label, names in multipliers.items())
            raise SchemaError(
                self.name,
                [
                    f"regressors differ: {listed}; compare the coefficient "
                    f"{self.name.split('/')[0]} instead"
                ],
            )

    def is_axis(self, axis: str) -> bool:
        """Return whether a table has the axis, which is the case for all variables of a term."""
        return True

    def fixed_value(self, axis: str) -> float:
        """Return the default of a variable that is fixed in the figure. [SI]"""
        points = self.points[axis]
        if axis == "mach":
            return _middle(points)
        # The breakpoint at which the table of the last database is largest in the mean square.
        for leaf in reversed(self.leaves.values()):
            if axis in leaf_breakpoints(leaf):
                break
        tables = [leaf[key] for key in ("value", "K1", "K2") if key in leaf]
        table = next(item for item in tables if axis in item.dims)
        size = (table**2).mean([d for d in table.dims if d != axis])
        return float(table[axis].values[int(np.argmax(size.values))])

    def curve(self, label: str, over: str, fixed: Mapping[str, float]) -> DatabaseCurve | None:
        """Return the curve of a database, or None if a fixed variable is outside its table."""
        leaf = _terms.without_multipliers(self.leaves[label])
        breakpoints = leaf_breakpoints(leaf)
        for axis, value in fixed.items():
            if axis in breakpoints:
                points = breakpoints[axis]
                if not points[0] <= value <= points[-1]:
                    return None
        # Without the axis the term is constant, and two points are enough.
        x = refine_breakpoints(breakpoints.get(over, self.points[over][[0, -1]]))
        y, stderr = _evaluate_leaf(leaf, {**fixed, over: x}, len(x))
        return DatabaseCurve(x, y, stderr, *_nodes_on_curve(leaf, over, fixed))


class CoefficientSource:
    """Curves of a whole coefficient, in the range that all databases cover."""

    regressors: tuple[str, ...] = ()
    power: _terms.PowerFactor | None = None
    order = ("mach", *FAMILY_ORDER)

    def __init__(self, databases: Mapping[str, xr.DataTree], name: str):
        self.name = name
        self.leaves: dict[str, list[xr.Dataset]] = {}
        all_names: set[str] = set()
        for label, db in databases.items():
            leaves = []
            for term, leaf in terms(db).items():
                coefficient = term.split("/")[0]
                all_names.add(coefficient)
                if coefficient == name:
                    leaves.append(leaf)
            if leaves:
                self.leaves[label] = leaves
        if not self.leaves:
            raise UnknownName(name, all_names, "coefficient")
        self.labels = list(self.leaves)
        sides = list(self.leaves.values())
        # `coefficient_points` compares two sides, so a single database has an empty other side.
        if len(sides) == 1:
            sides.append([])
        self.points = coefficient_points(*sides)
        disjoint = [axis for axis, points in self.points.items() if not len(points)]
        if disjoint:
            raise SchemaError(
                name,
                [
                    f"the databases have no common range of {', '.join(disjoint)}; show them one "
                    f"by one"
                ],
            )

    def is_axis(self, axis: str) -> bool:
        """Return whether a table has the axis; other variables are regressors only."""
        all_leaves = itertools.chain.from_iterable(self.leaves.values())
        return any(axis in leaf_breakpoints(leaf) for leaf in all_leaves)

    def fixed_value(self, axis: str) -> float:
        """Return the default of a variable that is fixed in the figure. [SI]"""
        points = self.points[axis]
        return _middle(points) if axis == "mach" else neutral_value(axis, points)

    def curve(self, label: str, over: str, fixed: Mapping[str, float]) -> DatabaseCurve:
        """Return the curve of a database; the standard errors of terms are independent."""
        x = refine_breakpoints(self.points[over])
        conditions = {**fixed, over: x}
        parts = [_evaluate_leaf(leaf, conditions, len(x)) for leaf in self.leaves[label]]
        # C = sum of its terms; the variances of independent terms add.
        y = np.sum([value for value, _ in parts], axis=0)
        variance = np.sum([stderr**2 for _, stderr in parts], axis=0)
        return DatabaseCurve(x, y, np.sqrt(variance))


def _middle(points: np.ndarray) -> float:
    return float(points[(len(points) - 1) // 2])


def _evaluate_leaf(
    leaf: xr.Dataset, conditions: Mapping[str, Any], count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return values and standard errors (count,) of a term."""
    # The values are linear in the nodes g: y = B g. The errors follow from B as well.
    B = _terms.basis(leaf, conditions, "clamp")
    y = np.broadcast_to(B @ leaf["value"].values.ravel(), (count,))
    return y, np.broadcast_to(standard_errors(B, leaf), (count,))


def _nodes_on_curve(
    leaf: xr.Dataset, over: str, fixed: Mapping[str, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return abscissae, values and sources of the nodes on a curve; empty between breakpoints."""
    table = leaf["value"]
    empty = np.zeros(0), np.zeros(0), np.zeros(0, int)
    if over not in table.dims:
        return empty
    indices = {}
    for axis in map(str, table.dims):
        if axis == over:
            continue
        is_on = np.isclose(table[axis].values, fixed[axis], rtol=1e-9, atol=1e-12)
        if not is_on.any():
            return empty
        indices[axis] = int(np.flatnonzero(is_on)[0])
    x = table[over].values
    y, _ = _evaluate_leaf(leaf, {**fixed, over: x}, len(x))
    source = np.full(len(x), -1)
    if "source" in leaf:
        source = leaf["source"].isel(indices).values.astype(int)
    return x, y, source
