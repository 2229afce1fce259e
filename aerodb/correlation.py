"""How the a-priori errors of the nodes of one table hang together.

Prior covariance of the nodes i, j of one term, with their a-priori standard errors s, values v and distances d along
the axes:

    P_ij = s_i s_j c_ij [level + (1 - level) exp(-1/2 sum (d/length)^2)]
    c_ij = (r^2 v_i v_j + a^2) / sqrt((r^2 v_i^2 + a^2)(r^2 v_j^2 + a^2))

c says what kind of error the standard errors speak of: a part r proportional to the value (slope, effectiveness: nodes of
opposite sign move apart) and a constant part a (all nodes move together); r and a are those that explain s best.  The
level part in the bracket is common to the whole table: a handbook method is wrong in the same sense over a table (LR-743
found whole curves displaced), and it makes a correction found at some nodes count at nodes that were not flown.  The
other part lets the shape change, over the correlation lengths, and fades away from the flown region.  By default each
has half of the variance.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

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


def prior_covariance(leaf: xr.Dataset, lengths: Mapping[str, float] | None = None, level: float = LEVEL) -> np.ndarray:
    """Return the a-priori covariance of the nodes of a term, (nodes, nodes), in the order of ``value.ravel()``.

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


def covariance_between(
    leaf: xr.Dataset, i: np.ndarray, j: np.ndarray, lengths: Mapping[str, float] | None = None, level: float = LEVEL
) -> np.ndarray:
    """Return the a-priori covariance of single pairs of nodes, for tables too large for the whole matrix.

    Parameters
    ----------
    leaf, lengths, level
        As in `prior_covariance`.
    i, j : array of int
        Places of the nodes in ``value.ravel()``, broadcast against each other.
    """
    lengths = LENGTHS if lengths is None else lengths
    value = leaf["value"]
    places = np.meshgrid(*(value[axis].values for axis in value.dims), indexing="ij") if value.ndim else []
    squares = np.zeros(np.broadcast_shapes(i.shape, j.shape))
    for axis, place in zip(value.dims, places):
        x = place.ravel() / lengths.get(str(axis), np.inf)
        squares += (x[i] - x[j]) ** 2
    v, sd = value.values.ravel(), leaf["stderr"].values.ravel()
    r2, a2 = _kind(v, sd)
    size = np.sqrt(r2 * v**2 + a2)
    size[size == 0.0] = 1.0
    alike = (r2 * v[i] * v[j] + a2) / (size[i] * size[j])
    return sd[i] * sd[j] * alike * (level + (1.0 - level) * np.exp(-0.5 * squares))


def _kind(v: np.ndarray, sd: np.ndarray) -> tuple[float, float]:
    """Variances of an error proportional to the value and of a constant one, in the proportion that explains `sd`."""
    from scipy.optimize import nnls

    known = sd > 0
    if not known.any():
        return 0.0, 1.0
    shares = np.stack([v[known] ** 2, np.ones(known.sum())], axis=1) / sd[known, None] ** 2
    (r2, a2), _ = nnls(shares, np.ones(known.sum()))  # relative misfit, or the few nodes with large errors would decide
    return float(r2), float(a2)
