"""Standard errors of terms and coefficients at conditions, from the standard errors of the nodes.

A contribution is linear in the nodes, c = B g (`flightmech.terms.basis`), so its variance is B P B'.  P are the standard errors
of the nodes of the term with the correlation that `aerodb.update.correlation` gives an a-priori table.  A file keeps standard errors and no
correlation; for an identified table this one is therefore an assumption as well, and between nodes it makes the band run
smoothly from node to node, where independent errors would make it dip.  Terms are taken as independent of each other, factor
tables K as known.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from flightmech import terms as _terms
from flightmech.errors import UnknownName

from ..store.schema import terms
from .correlation import covariance_between

if TYPE_CHECKING:
    from scipy.sparse import csr_array

_CHUNK = 4096  # samples at a time: 16 x 16 corners of each


def standard_error(db: xr.DataTree, coefficient: str, conditions: Mapping[str, Any]) -> np.ndarray:
    """Return the standard error of a coefficient at given conditions.

    Parameters
    ----------
    db : DataTree
        The database.
    coefficient : str
        Such as ``"CL"``.
    conditions : mapping of str to array
        Every variable the terms need, broadcast against each other; beyond a table the rule of the leaf. [SI]

    Returns
    -------
    array (broadcast shape of the conditions used)
        Root of the sum of the variances of the terms; a term without ``stderr`` counts as exact. [1]

    Raises
    ------
    UnknownName
        The database has no term of the coefficient, or a variable is missing in `conditions`.
    """
    leaves = [leaf for name, leaf in terms(db).items() if name.split("/")[0] == coefficient]
    if not leaves:
        raise UnknownName(coefficient, {name.split("/")[0] for name in terms(db)}, "coefficient")
    variance: Any = 0.0
    for leaf in leaves:
        value = _terms.evaluate(leaf, conditions, "clamp")
        variance = variance + spread(_terms.basis(leaf, conditions, "clamp"), leaf).reshape(value.shape) ** 2
    return np.sqrt(variance)


def spread(B: csr_array, leaf: xr.Dataset) -> np.ndarray:
    """Return the standard errors of linear combinations of the nodes of a term.

    Parameters
    ----------
    B : sparse array (samples, nodes)
        From `flightmech.terms.basis`.
    leaf : Dataset
        The term; without ``stderr`` the errors are zero.

    Returns
    -------
    array (samples,)
    """
    variance = np.zeros(B.shape[0])
    if "stderr" not in leaf:
        return variance
    corners = np.diff(B.indptr)
    for count in np.unique(corners):
        rows = np.flatnonzero(corners == count)
        for part in np.array_split(rows, -(-len(rows) // _CHUNK)):
            at = B.indptr[part][:, None] + np.arange(count)
            nodes, weights = B.indices[at], B.data[at]
            P = covariance_between(leaf, nodes[:, :, None], nodes[:, None, :])
            variance[part] = np.einsum("ni,nij,nj->n", weights, P, weights)
    return np.sqrt(np.maximum(variance, 0.0))
