"""Regions of the terms of a database, from the source and the standard error of their nodes.

A node counts as flown if its source is flight, its standard error is a number and the flights were
not declined for its term.  A fixed zero next to such a node counts as well: an increment is zero by
definition where its control is at rest.

At a state, a term is flown if more than half the weight of its nodes is.  It is between flown
points inside the convex hull of the flown nodes, each with its half of the cell.  It is
extrapolated beyond the end of an axis, and a-priori everywhere else.  Three ends are none: heights
above the last one are free air, the air below the first Mach number counts as incompressible, and
an axis with one breakpoint states no dependence.

A term that contributes nothing must not decide.  Its effect is the larger of its absolute value and
its standard error, times its factors; a term counts from `LEAST_EFFECT` on.  State variables among
the regressors are axes of the region table; all others have their flown size.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from flightmech import terms as _terms
from flightmech.envelope.regions import (
    A_PRIORI,
    ANGLES,
    BETWEEN,
    EXTRAPOLATED,
    FLOWN,
    RegionTable,
    fill_table,
    inside_hull,
    unwrap_about,
    unwrap_from,
)
from flightmech.flown_states import CONFIGURATION, PLANE, SINGLE, FlownStates, flown_size

LEAST_EFFECT = {
    "CL": 0.02,
    "CZ": 0.02,
    "CD": 0.002,
    "CX": 0.002,
    "CY": 0.005,
    "Cl": 0.001,
    "Cm": 0.005,
    "Cn": 0.0005,
}
"""Effect from which on a term of a coefficient counts.

Our numbers, about a quarter of what the printed tolerances of trimmed flight allow.  At CL 0.4 a
lift of 0.02 is 0.05 g and a drag of 0.002 is 0.005 g.  With the derivatives of the T-37 the moments
are 0.3 deg of elevator, 0.4 deg of aileron and 0.8 deg of rudder.
"""
DECLINED = ("keep", "delete")
"""Decisions on a term that the flights did not improve (`aerodb.update.term_decisions`)."""
_FLIGHT = _terms.SOURCES.index("flight")
_STATES = (*PLANE, *CONFIGURATION, *SINGLE)
_SLIGHT = 0.01  # of the range of an axis beyond its end: a state there is at the end
_DETENT = 0.05  # share of the way to the next breakpoint that belongs to a setting
_MOST_AXES = 5
_STEPS = 2.0 ** np.arange(6)  # of a regressor, in units of the value from which on it counts
# Largest size of a regressor that is an axis. [SI]
_SPAN = {"alpha": np.pi, "beta": np.pi, "delta_f": 1.2, "mach": 1.0}
_USUAL_SPAN = 1.0


def flown_nodes(leaf: xr.Dataset) -> np.ndarray:
    """Return which nodes of a term count as flown, in the shape of the table."""
    shape = leaf["value"].shape
    if not {"source", "stderr"} <= set(leaf) or leaf.attrs.get("decision") in DECLINED:
        return np.zeros(shape, bool)
    stderr = leaf["stderr"].values.astype(float)
    is_flown = (leaf["source"].values == _FLIGHT) & np.isfinite(stderr)
    is_zero = (leaf["value"].values == 0.0) & (stderr == 0.0)
    adjacent = np.zeros(shape, bool)
    for k in range(len(shape)):
        # neighbours of flown nodes along this axis, on both sides
        moved, marks = np.moveaxis(is_flown, k, 0), np.moveaxis(adjacent, k, 0)
        marks[1:] |= moved[:-1]
        marks[:-1] |= moved[1:]
    return is_flown | (is_zero & adjacent)


def term_region_table(
    name: str, leaf: xr.Dataset, states: FlownStates | None
) -> RegionTable | None:
    """Return the regions of a term; None if it has no state variable and is flown.

    Parameters
    ----------
    name : str
        Such as ``"CL/basic"``.
    leaf : Dataset
        The term.
    states : FlownStates or None
        For the sizes of the regressors.
    """
    least = LEAST_EFFECT[name.partition("/")[0]]
    points = _breakpoints(leaf)
    axes = {axis: _table_edges(axis, own) for axis, own in points.items() if len(own) > 1}
    for regressor in dict.fromkeys(_terms.list_regressors(leaf)):
        if regressor in _STATES and regressor not in points and len(axes) < _MOST_AXES:
            edges = _regressor_edges(regressor, leaf, least, states)
            # None: the term never counts, whatever the size of the regressor
            if edges is None:
                return None
            axes[regressor] = edges
    term = _TermRegions(leaf, points, least, states)
    table = fill_table(tuple(axes), tuple(axes.values()), term.region_of)
    if not table.regions.any():
        return None
    return table


class _TermRegions:
    """The rule of this module for one term."""

    def __init__(
        self,
        leaf: xr.Dataset,
        points: Mapping[str, np.ndarray],
        least: float,
        states: FlownStates | None,
    ):
        self.leaf, self.points, self.least, self.states = leaf, points, least, states
        self.flown = flown_nodes(leaf)
        # with K1 and K2, without regressors and power
        names = [name for name in _terms.TABLES if name in leaf]
        self.table = _terms.without_multipliers(leaf[names])
        stderr = np.zeros(leaf["value"].shape)
        if "stderr" in leaf:
            stderr = np.nan_to_num(leaf["stderr"].values.astype(float), nan=0.0)
        self.stderr = stderr

    def region_of(self, states: dict[str, np.ndarray]) -> np.ndarray:
        """Return the region at states, each variable (point,)."""
        count = len(next(iter(states.values()), np.zeros(1)))
        full = dict(states)
        for axis, own in self.points.items():
            if axis not in full:
                full[axis] = np.full(count, own[0])
        signed = _terms.basis(self.table, full, "clamp")
        if signed.shape[0] != count:
            # a constant has one row, whatever the states are
            signed = signed[np.zeros(count, int)]
        weights = abs(signed)
        value = np.abs(signed @ self.leaf["value"].values.ravel())
        effect = np.maximum(value, weights @ self.stderr.ravel()) * self._factor(full)
        # half the weight, whatever the factors K1 and K2 are
        half = 0.5 * (weights @ np.ones(self.flown.size))
        is_flown = weights @ self.flown.ravel().astype(float) > half
        regions = np.where(self._is_between(full, count), BETWEEN, A_PRIORI)
        regions = np.where(is_flown, FLOWN, regions)
        regions = np.where(self._is_beyond(full, count), EXTRAPOLATED, regions)
        return np.where(effect >= self.least, regions, FLOWN)

    def _factor(self, full: dict[str, np.ndarray]) -> Any:
        """Return the absolute value of regressors and power.

        Variables without an axis have the size that they had in flight.
        """
        product: Any = 1.0
        for name in _terms.list_regressors(self.leaf):
            product = product * np.abs(full.get(name, flown_size(self.states, name)))
        power = _terms.power_factor(self.leaf)
        if power is None:
            return product
        return product * power.at(full.get(power.variable, flown_size(self.states, power.variable)))

    def _is_between(self, full: dict[str, np.ndarray], count: int) -> np.ndarray:
        """Return which states lie in the hull of the flown nodes, along the axes of the table."""
        dims = [axis for axis in map(str, self.leaf["value"].dims) if len(self.points[axis]) > 1]
        if not dims or not self.flown.any():
            return np.full(count, bool(self.flown.any()))
        nodes = np.nonzero(self.flown.reshape([len(self.points[axis]) for axis in dims]))
        low, high, columns = [], [], []
        for axis, node in zip(dims, nodes, strict=True):
            own, x = self.points[axis], full[axis]
            half = 0.5 * np.diff(own)
            below, above = np.append(half[0], half), np.append(half, half[-1])
            centre = own[node]
            if axis in ANGLES:
                # cut where no flight was, so that a hull does not close around the far side
                cut = unwrap_about(centre)
                centre, x = unwrap_from(cut, centre), unwrap_from(cut, x)
            low.append(centre - below[node])
            high.append(centre + above[node])
            columns.append(x)
        return inside_hull(np.stack(low, 1), np.stack(high, 1), np.stack(columns, 1))

    def _is_beyond(self, full: dict[str, np.ndarray], count: int) -> np.ndarray:
        """Return which states are beyond the end of a table of the term."""
        beyond = np.zeros(count, bool)
        for axis, own in self.points.items():
            if len(own) == 1:
                continue
            slack = _SLIGHT * (own[-1] - own[0])
            if axis != "h_agl":
                beyond |= full[axis] > own[-1] + slack
            if axis != "mach":
                beyond |= full[axis] < own[0] - slack
        return beyond


def _breakpoints(leaf: xr.Dataset) -> dict[str, np.ndarray]:
    """Return the breakpoints of all tables of a term, by axis."""
    points = {}
    for table in _terms.TABLES:
        if table in leaf:
            for axis in map(str, leaf[table].dims):
                points[axis] = leaf[axis].values.astype(float)
    return points


def _table_edges(axis: str, points: np.ndarray) -> np.ndarray:
    """Return the edges of the cells of a table axis: its ends, and halfway between breakpoints.

    A configuration is flown at its detents, where breakpoints are, so that each has a small cell.
    """
    slack = _SLIGHT * (points[-1] - points[0])
    shares = [_DETENT, 0.5, 1.0 - _DETENT] if axis in CONFIGURATION else [0.5]
    inner = [points[:-1] + share * np.diff(points) for share in shares]
    return np.sort(np.concatenate([[points[0] - slack], *inner, [points[-1] + slack]]))


def _regressor_edges(
    regressor: str, leaf: xr.Dataset, least: float, states: FlownStates | None
) -> np.ndarray | None:
    """Return the edges of a regressor: where the largest node of its term begins to count."""
    size = np.abs(leaf["value"].values.astype(float)).max()
    if "stderr" in leaf:
        size = max(size, float(np.nan_to_num(leaf["stderr"].values.astype(float)).max()))
    for other in _terms.list_regressors(leaf):
        if other != regressor:
            size *= _SPAN.get(other, _USUAL_SPAN) if other in _STATES else flown_size(states, other)
    most = _SPAN.get(regressor, _USUAL_SPAN)
    if size * most < least:
        return None
    positive = least / size * _STEPS
    positive = positive[positive < most]
    return np.concatenate([-positive[::-1], positive])
