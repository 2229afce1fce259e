"""Samples of manoeuvres for tables that are estimated directly, without a local model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

import aerodb
from flightmech import terms as _terms
from flightmech.errors import UnknownName

from ..equation_error.samples import Samples, stack
from ..uncertainty.coloured_residuals import coloured


def table_samples(coefficient: str, database: xr.DataTree, data: xr.Dataset | Sequence[xr.Dataset], name: str = "") -> xr.Dataset:
    """Return the samples of manoeuvres for `aerodb.update.regress_tables`.

    Parameters
    ----------
    coefficient : str
        Such as ``"CL"``.
    database : DataTree
        Its terms of the coefficient name the variables.
    data : Dataset (time,) or sequence of them
        Manoeuvres of one disturbance; from `flighttest.coefficients`. [SI]
    name : str
        For reports.

    Returns
    -------
    Dataset (sample,)
        Coefficient, variables, ``time``, ``manoeuvre``, the common errors of the coefficient and of the variables; attributes
        ``coefficient``, ``name`` and ``steps``, the sampling interval of each manoeuvre [s].

    Raises
    ------
    IdentificationError
        No manoeuvre, or one whose time does not rise.
    UnknownName
        The database has no term of the coefficient, or a manoeuvre does not hold it.
    """
    mine = [leaf for term, leaf in aerodb.terms(database).items() if term.startswith(f"{coefficient}/")]
    if not mine:
        raise UnknownName(coefficient, {term.split("/")[0] for term in aerodb.terms(database)}, "coefficient")
    manoeuvres = [data] if isinstance(data, xr.Dataset) else list(data)
    needed = {variable for leaf in mine for variable in _terms.variables(leaf)}
    in_error = sorted(variable for variable in needed if manoeuvres and all(f"{variable}_error" in one for one in manoeuvres))
    samples = stack(coefficient, in_error, manoeuvres, f"the terms of {coefficient}")
    return samples.data.assign_attrs(coefficient=coefficient, name=name, steps=samples.steps)


def coloured_covariance(samples: xr.Dataset, X: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the covariance of a least-squares estimate from samples whose residuals are correlated in time.

    Parameters
    ----------
    samples : Dataset (sample,)
        From `table_samples`.
    X : array (samples, terms)
        Regressors.
    v : array (samples,)
        Residuals.

    References
    ----------
    .. [Morelli1997] Morelli, Klein, J. Guidance 20, 1997.
    """
    pieces, steps = Samples(samples, list(samples.attrs["steps"])).pieces()
    return coloured(X, v, pieces, steps).covariance
