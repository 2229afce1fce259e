"""Numbers of each source of a term at the nodes of a common grid, with their standard errors.

At every node a source has a rank: 0 where it computed a number, or interpolates between computed
ones; 1 where the number is a judgement of its own (a held value, a deflection beyond that of a
linear theory); 2 beyond its table.  Only the sources of the lowest rank speak at a node.

The standard error of a source at a node that is not its own contains the error of interpolation,
t (1 - t) h^2 / 2 max|f''|, with t the place in an interval of width h, and f'' the largest second
difference of any source there.  Beyond its Mach numbers a source speaks in the subsonic regime,
with the Prandtl-Glauert change between the two Mach numbers as an error.

Errors that are proportional to a value refer to the common value of all sources, and not to that of
each.  With its own value the smaller of two sources would count as the more certain one, and every
blend would be too small [DAgostini1994]_.

References
----------
.. [DAgostini1994] G. D'Agostini, On the use of the covariance matrix to fit correlated data, Nucl.
   Instr. Meth. A 346, 1994.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from aerodb.edit.joined_sources.prior_sources import LINEAR_DEFLECTION, SourceTable
from aerodb.prior.prior_errors import STMACH
from aerodb.store.grids import (
    JUDGEMENT,
    is_within,
    known_source,
    merge_breakpoints,
    regrid_leaf,
    union_axes,
    value_breakpoints,
    with_table,
)
from aerodb.update.correlation import fit_error_kinds
from flightmech import terms as _terms
from flightmech.errors import SchemaError
from flightmech.short_text import ShortText

# Factor on the standard error of a value that is held beyond its table, as for an extended node.
HELD_ERROR = 2.0


@dataclass(frozen=True)
class SourceNodes(ShortText):
    """Numbers of one source at all nodes of the common grid.

    Attributes
    ----------
    table : SourceTable
    value, stderr : array (nodes)
        In the shape of the grid; the standard errors are those of the source's method.
    own_error : array (nodes)
        Standard error of each node by itself: interpolation.
    rank : array of int (nodes)
        0 computed, 1 judged, 2 beyond the table.
    source : array of int (nodes)
        Code of `flightmech.terms.SOURCES`.
    """

    table: SourceTable
    value: np.ndarray
    stderr: np.ndarray
    own_error: np.ndarray
    rank: np.ndarray
    source: np.ndarray

    @property
    def variance(self) -> np.ndarray:
        """Variance of the nodes."""
        return self.stderr**2 + self.own_error**2


def spread_on_grid(
    tables: Sequence[SourceTable], cover: Mapping[str, tuple[float, float]]
) -> tuple[dict[str, np.ndarray], list[SourceNodes]]:
    """Return the breakpoints of the common grid, and the numbers of every source on it.

    Parameters
    ----------
    tables : sequence of SourceTable
    cover : mapping of str to (float, float)
        Range that an axis of the grid has at least. [SI]

    Raises
    ------
    SchemaError
        The tables together have too many axes.
    """
    points = cover_ranges(union_axes(*(table.leaf for table in tables)), cover)
    if len(points) > _terms.MAX_AXES:
        raise SchemaError(
            "blend",
            [f"the axes {' '.join(points)} of all sources are more than {_terms.MAX_AXES}"],
        )
    bends = _largest_bends(tables, points)
    return points, [_spread_table(table, points, bends) for table in tables]


def cover_ranges(
    points: Mapping[str, np.ndarray], cover: Mapping[str, tuple[float, float]]
) -> dict[str, np.ndarray]:
    """Return breakpoints with the ends of ranges that lie beyond them."""
    covered = dict(points)
    for axis in cover.keys() & points.keys():
        ends = np.array(cover[axis])
        covered[axis] = merge_breakpoints(points[axis], ends[~is_within(points[axis], ends)])
    return covered


def speaking(spread: Sequence[SourceNodes]) -> np.ndarray:
    """Return which source speaks at which node, array of bool (sources, nodes)."""
    ranks = np.stack([nodes.rank for nodes in spread])
    return ranks == ranks.min(axis=0)


def _spread_table(
    table: SourceTable, points: Mapping[str, np.ndarray], bends: Mapping[str, np.ndarray]
) -> SourceNodes:
    """Return the numbers of one source at the nodes of a grid."""
    leaf = regrid_leaf(table.leaf, points)
    shape = leaf["value"].shape
    value, stderr = leaf["value"].values, leaf["stderr"].values
    rank = np.where(known_source(leaf) == JUDGEMENT, 1, 0)
    own_variance = np.zeros(shape)
    for axis, axis_points in value_breakpoints(table.leaf).items():
        along = _along(axis, points)
        inside = is_within(axis_points, points[axis])
        if axis == "mach":
            error, speaks = _compressibility_error(axis_points, points[axis])
            stderr = np.hypot(stderr, np.abs(value) * error.reshape(along))
            # The nodes of the end of the table speak there, as far as they are computed.
            rank = np.where((speaks & ~inside).reshape(along), _held_rank(leaf, axis), rank)
            inside = inside | speaks
        rank = np.where(inside.reshape(along), rank, 2)
        missed = _interpolation_error(axis_points, points[axis]).reshape(along) * bends[axis]
        own_variance = own_variance + missed**2
    if table.linear:
        is_far = np.abs(points[table.linear]) > LINEAR_DEFLECTION
        rank = np.where(is_far.reshape(_along(table.linear, points)), 2, rank)
    stderr = np.where(rank == 2, HELD_ERROR * stderr, stderr)
    source = np.where(rank == 0, known_source(leaf), JUDGEMENT)
    # A node that is zero by definition is exact.
    is_exact = (stderr == 0.0) & (value == 0.0)
    own_error = np.where(is_exact, 0.0, np.sqrt(own_variance))
    return SourceNodes(table, value, stderr, own_error=own_error, rank=rank, source=source)


def _along(axis: str, points: Mapping[str, np.ndarray]) -> list[int]:
    """Return the shape that spreads numbers along one axis over the grid."""
    return [-1 if name == axis else 1 for name in points]


def _held_rank(leaf: xr.Dataset, axis: str) -> np.ndarray:
    """Return rank 0 where any node of the same other axes is computed, else 1."""
    codes = known_source(leaf)
    dimension = leaf["value"].dims.index(axis)
    computed = (codes != JUDGEMENT).any(axis=dimension, keepdims=True)
    return np.broadcast_to(np.where(computed, 0, 1), codes.shape)


def _compressibility_error(own: np.ndarray, machs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the relative error at Mach numbers beyond a table, and where it speaks there.

    The Prandtl-Glauert factor 1 / sqrt(1 - M^2) changes from the nearest Mach number of the table.
    """
    nearest = np.clip(machs, own[0], own[-1])
    speaks = (machs <= STMACH) & (nearest <= STMACH)
    held, wanted = np.where(speaks, nearest, 0.0), np.where(speaks, machs, 0.0)
    change = np.abs(np.sqrt((1.0 - held**2) / (1.0 - wanted**2)) - 1.0)
    return np.where(speaks, change, 0.0), speaks


def _interpolation_error(own: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return t (1 - t) h^2 / 2 at breakpoints between those of a table, zero at its own."""
    if len(own) < 2:
        return np.zeros(len(wanted))
    interval = np.clip(np.searchsorted(own, wanted) - 1, 0, len(own) - 2)
    width = own[interval + 1] - own[interval]
    t = np.clip((wanted - own[interval]) / width, 0.0, 1.0)
    # Differences by the rounding of degrees do not count.
    share = t * (1.0 - t)
    return np.where(share > 1e-6, 0.5 * share * width**2, 0.0)


def _largest_bends(
    tables: Sequence[SourceTable], points: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Return the largest second derivative of any source along every axis, on the grid."""
    shape = tuple(len(axis_points) for axis_points in points.values())
    bends = {}
    for axis in points:
        largest = np.zeros(shape)
        for table in tables:
            leaf = table.leaf
            if leaf.sizes.get(axis, 0) < 3 or axis not in leaf["value"].dims:
                continue
            curved = _bend(leaf, axis)
            dense = regrid_leaf(with_table(leaf, value_breakpoints(leaf), value=curved), points)
            largest = np.maximum(largest, dense["value"].values)
        bends[axis] = largest
    return bends


def _bend(leaf: xr.Dataset, axis: str) -> np.ndarray:
    """Return the size of the second derivative at each node; that of the neighbour at the ends."""
    dimension = leaf["value"].dims.index(axis)
    x = leaf[axis].values.astype(float)
    y = np.moveaxis(leaf["value"].values, dimension, -1)
    slope = np.diff(y) / np.diff(x)
    second = np.abs(2.0 * np.diff(slope) / (x[2:] - x[:-2]))
    second = np.concatenate([second[..., :1], second, second[..., -1:]], axis=-1)
    return np.moveaxis(second, -1, dimension)


def with_common_scale(spread: Sequence[SourceNodes], common: np.ndarray) -> list[SourceNodes]:
    """Return sources whose errors in proportion to a value refer to a common value.

    Parameters
    ----------
    spread : sequence of SourceNodes
        From `spread_on_grid`.
    common : array (nodes)
        In the shape of the grid.
    """
    scaled = []
    for nodes in spread:
        r2, a2 = fit_error_kinds(nodes.value.ravel(), nodes.stderr.ravel())
        own = r2 * nodes.value**2 + a2
        ratio = np.divide(r2 * common**2 + a2, own, out=np.ones_like(own), where=own > 0.0)
        scaled.append(replace(nodes, stderr=nodes.stderr * np.sqrt(ratio)))
    return scaled


def mean_of_sources(spread: Sequence[SourceNodes]) -> np.ndarray:
    """Return the mean of the speaking sources at every node, weighted by 1/s^2.

    The weights are those of errors that refer to the plain mean.  Where sources are silent, the
    others are first multiplied by the ratio of the mean to their values where most speak.  Without
    it the mean would have a step there, and an error in proportion to it the wrong size.
    """
    speaks = speaking(spread)
    values = np.stack([nodes.value for nodes in spread])
    plain = (values * speaks).sum(axis=0) / speaks.sum(axis=0)
    scaled = with_common_scale(spread, _carry_ratio(plain, values, speaks=speaks, weights=speaks))
    variance = np.stack([nodes.variance for nodes in scaled])
    weights = weights_of(variance, speaks)
    mean = (weights * values).sum(axis=0)
    return _carry_ratio(mean, values, speaks=speaks, weights=weights)


def _carry_ratio(
    mean: np.ndarray, values: np.ndarray, *, speaks: np.ndarray, weights: np.ndarray
) -> np.ndarray:
    """Return a mean that has, where sources are silent, the level of the nodes where most speak.

    With c_k = sum(m v_k)/sum(v_k^2) over the nodes where most speak, not negative, the mean of the
    other nodes is sum(w_k c_k v_k)/sum(w_k).
    """
    count = speaks.sum(axis=0)
    shared = count == count.max()
    total, weight = np.zeros_like(mean), np.zeros_like(mean)
    for own, speaks_here, own_weight in zip(values, speaks, weights):
        base = shared & speaks_here
        square = float((own[base] ** 2).sum())
        ratio = max(float(mean[base] @ own[base]) / square, 0.0) if square > 0.0 else 1.0
        total = total + own_weight * speaks_here * ratio * own
        weight = weight + own_weight * speaks_here
    return np.where(shared, mean, total / weight)


def weights_of(variance: np.ndarray, speaks: np.ndarray) -> np.ndarray:
    """Return the weights of the sources at every node, (sources, nodes), in proportion to 1/s^2.

    A source that is exact has the whole weight, shared with others that are exact.
    """
    is_exact = (variance == 0.0) & speaks
    inverse = np.divide(1.0, variance, out=np.zeros_like(variance), where=variance > 0.0)
    weights = np.where(is_exact.any(axis=0), is_exact, inverse * speaks)
    return weights / weights.sum(axis=0)
