"""How the a-priori errors of the nodes of one table are correlated.

Prior covariance of the nodes i, j of one term, with their a-priori standard errors s, values v and
distances d along the axes:

    P_ij = s_i s_j c_ij [level + (1 - level) exp(-1/2 sum (d/length)^2)]
    c_ij = (r^2 v_i v_j + a^2) / sqrt((r^2 v_i^2 + a^2)(r^2 v_j^2 + a^2))

c is the kind of error that the standard errors stand for: a part r proportional to the value
(slope, effectiveness: nodes of opposite sign move apart) and a constant part a (all nodes move
together); r and a are those that explain s best.  The level part in the bracket is common to the
whole table: a handbook method is wrong in the same sense over a table (LR-743 found whole curves
displaced), and it makes a correction found at some nodes count at nodes that were not flown.  The
other part lets the shape change, over the correlation lengths.  By default each has half of the
variance.

`aerodb.tabulate`, which knows where the flights were, takes a sum of four parts instead and learns
their weights (`prior_parts`), each with s_i s_j c_ij and a factor of its own:

    level   1
    reach   exp(-2 |D_i - D_j|)      D the distance from the flown region, in correlation lengths
    long    exp(-e^2/32 - 2 |D_i - D_j|)    e the distance between the nodes in correlation lengths
    short   exp(-d)                  d the same, summed over the axes

Inside the flown region `reach` is a level and `long` a smooth curve, such as a slope in error;
outside, both fade with the distance: a correction that is smooth where it was flown holds little
information on the next node, where flow may separate.  `short` is the exponential of a path with
independent increments and lets a correction have a kink.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr
from scipy.optimize import nnls

from flightmech.units import DEGREE

# correlation lengths of the correction along the axes; infinite on every axis not named here [SI]
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
LEVEL = 0.5
# parts of the a-priori covariance of `tabulate`: what they count before anything is learnt, and the
# standard error of the logarithm
# of that.  `reach` has nearly the declared variance and is hardly learnt: flights do not say how
# wrong a handbook is elsewhere.  The
# level comes on top and may grow by much: handbooks are wrong as a whole (71 % of the nodes of the
# T-37 within two declared errors).
SHARES = {"level": 0.5, "reach": 0.9, "long": 0.1, "short": 0.1}
SPREADS = {"level": 2.0, "reach": 0.3, "long": 1.5, "short": 1.5}
PARTS = tuple(SHARES)
_REACH, _LONG = (
    0.5,
    4.0,
)  # correlation lengths of the distance D, and of the smooth curves of `long`
# least weight of a sample that puts a node into the flown region: straight local models cannot see
# a kink nearer to it
_WITHIN = 0.1


def prior_covariance(
    leaf: xr.Dataset, lengths: Mapping[str, float] | None = None, level: float = LEVEL
) -> np.ndarray:
    """Return the a-priori covariance of the nodes of a term, (nodes, nodes), in the order of
    ``value.ravel()``.

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
    return covariance_between(leaf, nodes[:, None], nodes, lengths, level)


def prior_parts(
    leaf: xr.Dataset,
    sampled: np.ndarray,
    lengths: Mapping[str, float] | None = None,
    nodes: np.ndarray | None = None,
) -> np.ndarray:
    """Return the parts of the a-priori covariance of a term of which some nodes were flown,
    (`PARTS`, nodes, nodes).

    Parameters
    ----------
    leaf : Dataset
        A term with ``stderr``.
    sampled : array (nodes,)
        Largest weight that interpolation gives to each node at a sample flown, in the order of
        ``value.ravel()``: 1 at a sample on the node, 0 without samples in the cells about it.
        Without any, `reach` is a level.
    lengths : mapping, optional
        As in `prior_covariance`.
    nodes : array of int, optional
        Places of the nodes whose covariance is returned; all nodes without it.
    """
    lengths = LENGTHS if lengths is None else lengths
    distance = flown_distance(leaf, sampled, lengths)
    nodes = np.arange(leaf["value"].size) if nodes is None else nodes
    factors = node_correlation(leaf["value"], distance, nodes[:, None], nodes, lengths)
    return _alike(leaf, nodes[:, None], nodes) * np.stack(factors)


def node_correlation(
    value: xr.DataArray,
    distance: np.ndarray,
    i: np.ndarray,
    j: np.ndarray,
    lengths: Mapping[str, float],
) -> list[np.ndarray]:
    """Return the correlations of single pairs of nodes in each of the `PARTS`, without s_i s_j
    c_ij.

    Parameters
    ----------
    value : DataArray
        The table.
    distance : array (nodes,)
        Of every node from the flown region, in correlation lengths (`flown_distance`).
    i, j : array of int
        Places of the nodes in ``value.ravel()``, broadcast against each other.
    lengths : mapping of str to float
        Correlation lengths by axis. [SI]
    """
    sums, squares = np.zeros((2, *np.broadcast_shapes(i.shape, j.shape)))
    for x in _scaled_places(value, lengths):
        apart = np.abs(x[i] - x[j])
        sums += apart
        squares += apart**2
    fade = np.exp(-np.abs(distance[i] - distance[j]) / _REACH)
    return [np.ones_like(sums), fade, fade * np.exp(-squares / (2.0 * _LONG**2)), np.exp(-sums)]


def flown_distance(
    leaf: xr.Dataset, sampled: np.ndarray, lengths: Mapping[str, float]
) -> np.ndarray:
    """Return the distance of every node from the flown region, (nodes,) in correlation lengths;
    `sampled` as in `prior_parts`.
    """
    near = np.flatnonzero(sampled > 0)
    distance = np.zeros((leaf["value"].size, len(near)))
    for x in _scaled_places(leaf["value"], lengths):
        distance += np.abs(x[:, None] - x[near])
    return _away(distance, sampled, near)


def _away(distance: np.ndarray, sampled: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Return the distance of every node from the flown region; `distance` is that from the nodes
    `near`, in whose cells samples are.

    Nodes with `_WITHIN` of the weight of a sample are in the region.  The distance of one with
    less, of a cell that holds some samples, is that from the nearest of these in proportion to the
    weight it lacks: the region grows with the samples without a step.
    """
    inside = sampled[near] >= _WITHIN
    if not inside.any():
        return np.zeros(len(sampled))
    away = distance[:, inside].min(axis=1) * (1.0 - np.minimum(sampled / _WITHIN, 1.0))
    return (away[near] + distance).min(axis=1)


def _scaled_places(value: xr.DataArray, lengths: Mapping[str, float]) -> list[np.ndarray]:
    """Return the place of every node on each axis, in correlation lengths."""
    places = (
        np.meshgrid(*(value[axis].values for axis in value.dims), indexing="ij")
        if value.ndim
        else []
    )
    return [
        place.ravel() / lengths.get(str(axis), np.inf) for axis, place in zip(value.dims, places)
    ]


def covariance_between(
    leaf: xr.Dataset,
    i: np.ndarray,
    j: np.ndarray,
    lengths: Mapping[str, float] | None = None,
    level: float = LEVEL,
) -> np.ndarray:
    """Return the a-priori covariance of single pairs of nodes, for tables too large for the whole
    matrix.

    Parameters
    ----------
    leaf, lengths, level
        As in `prior_covariance`.
    i, j : array of int
        Places of the nodes in ``value.ravel()``, broadcast against each other.
    """
    lengths = LENGTHS if lengths is None else lengths
    squares = np.zeros(np.broadcast_shapes(i.shape, j.shape))
    for x in _scaled_places(leaf["value"], lengths):
        squares += (x[i] - x[j]) ** 2
    return _alike(leaf, i, j) * (level + (1.0 - level) * np.exp(-0.5 * squares))


def _alike(leaf: xr.Dataset, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Return s_i s_j c_ij."""
    v, sd = leaf["value"].values.ravel(), leaf["stderr"].values.ravel()
    r2, a2 = _kind(v, sd)
    size = np.sqrt(r2 * v**2 + a2)
    size[size == 0.0] = 1.0
    return sd[i] * sd[j] * (r2 * v[i] * v[j] + a2) / (size[i] * size[j])


def error_kinds(leaf: xr.Dataset) -> np.ndarray:
    """Return the a-priori standard errors of the nodes as vectors (2, nodes): the part proportional
    to the value, and the constant part.

    The scalar product of two of them is s_i s_j c_ij.
    """
    v, sd = leaf["value"].values.ravel(), leaf["stderr"].values.ravel()
    r2, a2 = _kind(v, sd)
    parts = np.stack([np.sqrt(r2) * v, np.full(len(v), np.sqrt(a2))])
    size = np.sqrt((parts**2).sum(axis=0))
    size[size == 0.0] = 1.0
    return sd * parts / size


def _kind(v: np.ndarray, sd: np.ndarray) -> tuple[float, float]:
    """Variances of an error proportional to the value and of a constant one, in the proportion that
    explains `sd`.
    """

    known = sd > 0
    if not known.any():
        return 0.0, 1.0
    shares = np.stack([v[known] ** 2, np.ones(known.sum())], axis=1) / sd[known, None] ** 2
    (r2, a2), _ = nnls(
        shares, np.ones(known.sum())
    )  # relative misfit, or the few nodes with large errors would decide
    return float(r2), float(a2)
