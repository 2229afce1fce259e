"""Correlation of the a-priori errors of the nodes of one table.

Prior covariance of the nodes i, j of one term, with their a-priori standard errors s, values v and
distances d along the axes:

    P_ij = s_i s_j c_ij [level + (1 - level) exp(-1/2 sum (d/length)^2)]
    c_ij = (r^2 v_i v_j + a^2) / sqrt((r^2 v_i^2 + a^2)(r^2 v_j^2 + a^2))

c describes the kind of error of the standard errors.  A part r is proportional to the value (slope,
effectiveness: nodes of opposite sign move apart), and a part a is constant (all nodes move
together).  r and a are the values that explain s best.  The level part in the bracket is common to
the whole table.  A handbook method is wrong in the same sense over a table (LR-743 shows whole
curves that are displaced).  A correction found at some nodes therefore counts at nodes outside the
flown region.  The other part lets the shape change, over the correlation lengths.  By default each
part has half of the variance.

`aerodb.tabulate`, which has the flown conditions, uses a sum of five parts instead and learns their
weights (`prior_parts`), each with s_i s_j c_ij and its own factor:

    level   1
    reach   exp(-|D_i - D_j|)        D the distance from the flown region, in correlation lengths
    long    exp(-e^2/32)             e the distance between the nodes in correlation lengths
    medium  exp(-e^2/8)              the same
    short   exp(-d)                  d the same, summed over the axes

Inside the flown region `reach` is a level.  Outside it fades with the distance, and with it the
knowledge of the size of the correction: the flow may separate there.  `long` is a curve such as an
error of slope, `medium` a curve with one bend over the range of a table.  Both continue outside the
flown region what the fits show inside it, to the extent that their likelihood gives them weight,
and go back to the handbook over their lengths.  `short` is the correlation of a path with
independent increments and lets a correction have a kink.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy
import xarray as xr

from flightmech.units import DEGREE

# Correlation lengths of the correction along the axes; infinite on axes not named here. [SI]
LENGTHS = {
    "alpha": 5 * DEGREE,
    "beta": 5 * DEGREE,
    "mach": 0.25,
    "delta_f": 15 * DEGREE,
    "delta_e": 10 * DEGREE,
    "delta_a": 10 * DEGREE,
    "delta_r": 10 * DEGREE,
    "h_agl": 2.0,
}
LEVEL = 0.5  # share of the variance that is common to the whole table
# Parts of the a-priori covariance of `tabulate`: their weights before learning, and the standard
# errors of the logarithms of the weights.  `reach` has most of the declared variance and hardly
# changes: flights do not measure the error of a handbook elsewhere.  The level is added and may
# grow by much: handbooks are wrong as a whole (71 % of the nodes of the T-37 are within two
# declared errors).  With 0.5 for `reach`, CL/basic of the T-37 beyond the flown incidences has 83 %
# within two instead of 92 %.
SHARES = {"level": 0.5, "reach": 0.7, "long": 0.2, "medium": 0.1, "short": 0.1}
SPREADS = {"level": 2.0, "reach": 0.3, "long": 2.0, "medium": 1.5, "short": 1.5}
PARTS = tuple(SHARES)
# Correlation lengths of the distance D, and of the smooth curves of `long` and `medium`.  Curves of
# 4 alone follow an error that is a wave too slowly, curves of 2 alone lose an error of slope.
REACH, _LONG, _MEDIUM = 1.0, 4.0, 2.0
# Least weight of a sample that puts a node into the flown region.  A straight local model cannot
# detect a kink nearer to a node.
_WITHIN = 0.1


def prior_covariance(
    leaf: xr.Dataset, lengths: Mapping[str, float] | None = None, level: float = LEVEL
) -> np.ndarray:
    """Return the a-priori covariance of the nodes of a term, (nodes, nodes).

    The nodes have the order of ``value.ravel()``.

    Parameters
    ----------
    leaf : Dataset
        A term with ``stderr``.
    lengths : mapping, optional
        Correlation lengths by axis; default `LENGTHS`. [SI]
    level : float
        Share of the variance common to the whole table.
    """
    nodes = np.arange(leaf["value"].size)
    return covariance_between(leaf, nodes[:, None], nodes, lengths=lengths, level=level)


def prior_parts(
    leaf: xr.Dataset,
    sampled: np.ndarray,
    lengths: Mapping[str, float] | None = None,
    nodes: np.ndarray | None = None,
) -> np.ndarray:
    """Return the parts of the a-priori covariance of a term, (`PARTS`, nodes, nodes).

    Parameters
    ----------
    leaf : Dataset
        A term with ``stderr``.
    sampled : array (nodes,)
        Largest weight that interpolation gives to each node at a flight sample, in the order of
        ``value.ravel()``: 1 at a sample on the node, 0 without samples in the adjacent cells.
        Without any sample, `reach` is a level.
    lengths : mapping, optional
        As in `prior_covariance`.
    nodes : array of int, optional
        Positions of the nodes whose covariance is returned; the default is all nodes.
    """
    if lengths is None:
        lengths = LENGTHS
    if nodes is None:
        nodes = np.arange(leaf["value"].size)
    distance = flown_distance(leaf, sampled, lengths)
    pairs = nodes[:, None], nodes
    factors = node_correlation(leaf["value"], distance, i=pairs[0], j=pairs[1], lengths=lengths)
    return _error_products(leaf, *pairs) * np.stack(factors)


def node_correlation(
    value: xr.DataArray,
    distance: np.ndarray,
    i: np.ndarray,
    j: np.ndarray,
    lengths: Mapping[str, float],
    reach: float = REACH,
    long_fade: float = np.inf,
) -> list[np.ndarray]:
    """Return the correlations of pairs of nodes in each of the `PARTS`, without s_i s_j c_ij.

    Parameters
    ----------
    value : DataArray
        The table.
    distance : array (nodes,)
        Distance of every node from the flown region, in correlation lengths (`flown_distance`).
    i, j : array of int
        Positions of the nodes in ``value.ravel()``, broadcast against each other.
    lengths : mapping of str to float
        Correlation lengths by axis. [SI]
    reach : float
        Length over which `reach` fades outside the flown region, in correlation lengths.
    long_fade : float
        The same of `long`, which does not fade by default.
    """
    # Over the axes: sum of the distances d and of their squares e^2.
    sums, squares = np.zeros((2, *np.broadcast_shapes(i.shape, j.shape)))
    for x in _scaled_positions(value, lengths):
        separation = np.abs(x[i] - x[j])
        sums += separation
        squares += separation**2
    # In the order of `PARTS`: level, reach, long, medium, short.
    outside = np.abs(distance[i] - distance[j])
    return [
        np.ones_like(sums),
        np.exp(-outside / reach),
        np.exp(-squares / (2.0 * _LONG**2) - outside / long_fade),
        np.exp(-squares / (2.0 * _MEDIUM**2)),
        np.exp(-sums),
    ]


def flown_distance(
    leaf: xr.Dataset, sampled: np.ndarray, lengths: Mapping[str, float]
) -> np.ndarray:
    """Return the distance of every node from the flown region, (nodes,) in correlation lengths.

    `sampled` as in `prior_parts`.
    """
    near = np.flatnonzero(sampled > 0)
    distance = np.zeros((leaf["value"].size, len(near)))
    for x in _scaled_positions(leaf["value"], lengths):
        distance += np.abs(x[:, None] - x[near])
    return _region_distance(distance, sampled, near)


def _region_distance(distance: np.ndarray, sampled: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Return the distance of every node from the flown region.

    `distance` is that from the nodes `near`, which have samples in their cells.  Nodes with
    `_WITHIN` of the weight of a sample are in the region.  A node with less weight has the distance
    from the nearest of these, in proportion to the missing weight.  The region grows with the
    samples without a step.
    """
    inside = sampled[near] >= _WITHIN
    if not inside.any():
        return np.zeros(len(sampled))
    missing_weight = 1.0 - np.minimum(sampled / _WITHIN, 1.0)
    own_distance = distance[:, inside].min(axis=1) * missing_weight
    return (own_distance[near] + distance).min(axis=1)


def _scaled_positions(value: xr.DataArray, lengths: Mapping[str, float]) -> list[np.ndarray]:
    """Return the coordinate of every node on each axis, in correlation lengths."""
    if not value.ndim:
        return []
    grids = np.meshgrid(*(value[axis].values for axis in value.dims), indexing="ij")
    positions = []
    for axis, grid in zip(value.dims, grids):
        positions.append(grid.ravel() / lengths.get(str(axis), np.inf))
    return positions


def covariance_between(
    leaf: xr.Dataset,
    i: np.ndarray,
    j: np.ndarray,
    lengths: Mapping[str, float] | None = None,
    level: float = LEVEL,
) -> np.ndarray:
    """Return the a-priori covariance of pairs of nodes.

    It is for tables that are too large for the full matrix.

    Parameters
    ----------
    leaf, lengths, level
        As in `prior_covariance`.
    i, j : array of int
        Positions of the nodes in ``value.ravel()``, broadcast against each other.
    """
    if lengths is None:
        lengths = LENGTHS
    squares = np.zeros(np.broadcast_shapes(i.shape, j.shape))
    for x in _scaled_positions(leaf["value"], lengths):
        squares += (x[i] - x[j]) ** 2
    return _error_products(leaf, i, j) * (level + (1.0 - level) * np.exp(-0.5 * squares))


def _error_products(leaf: xr.Dataset, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Return s_i s_j c_ij."""
    v, sd = leaf["value"].values.ravel(), leaf["stderr"].values.ravel()
    r2, a2 = fit_error_kinds(v, sd)
    size = np.sqrt(r2 * v**2 + a2)
    size[size == 0.0] = 1.0  # exact nodes: sd is zero as well
    return sd[i] * sd[j] * (r2 * v[i] * v[j] + a2) / (size[i] * size[j])


def error_kinds(leaf: xr.Dataset) -> np.ndarray:
    """Return the a-priori standard errors of the nodes as vectors, (2, nodes).

    The first component is proportional to the value, the second is constant.  The scalar product of
    two vectors is s_i s_j c_ij.
    """
    v, sd = leaf["value"].values.ravel(), leaf["stderr"].values.ravel()
    r2, a2 = fit_error_kinds(v, sd)
    parts = np.stack([np.sqrt(r2) * v, np.full(len(v), np.sqrt(a2))])
    size = np.sqrt((parts**2).sum(axis=0))
    size[size == 0.0] = 1.0
    return sd * parts / size


def fit_error_kinds(v: np.ndarray, sd: np.ndarray) -> tuple[float, float]:
    """Return the variances r^2 and a^2 whose proportion explains the standard errors best."""
    uncertain = sd > 0
    if not uncertain.any():
        return 0.0, 1.0
    ones = np.ones(uncertain.sum())
    # Relative misfit of r^2 v^2 + a^2 = sd^2.  With the absolute misfit the few nodes with large
    # errors would decide.
    regressors = np.stack([v[uncertain] ** 2, ones], axis=1) / sd[uncertain, None] ** 2
    (r2, a2), _ = scipy.optimize.nnls(regressors, ones)
    return float(r2), float(a2)
