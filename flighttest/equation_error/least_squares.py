"""Least squares with weights and a penalty, and the one fact about linear estimates that the tables need.

Every estimate here is linear in the measurements, theta = A z.  It is the ordinary least squares of the regressors
E = A' (A A')^-1, because pinv(E) = A.  So whoever knows E knows what an estimate expects of tables that the local model
does not describe, theta = A B g, whichever way it was made: weighted, ridge, or in frequency.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from ..uncertainty import collinearity


def solve(X: np.ndarray, z: np.ndarray, penalty: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return the least-squares estimate and the regressors of which it is the ordinary one.

    Parameters
    ----------
    X : array (rows, terms)
    z : array (rows,)
    penalty : array (terms,), optional
        Added to the diagonal of X'X.

    Returns
    -------
    theta : array (terms,)
    equivalent : array (rows, terms)
        E with pinv(E) z = theta; X itself without penalty.
    """
    Q, R = np.linalg.qr(X)
    if penalty is None or not penalty.any():
        return np.linalg.solve(R, Q.T @ z), X
    raised = np.linalg.solve(R.T, R.T @ R + np.diag(penalty))  # E = Q R^-T (X'X + K)
    return np.linalg.solve(R.T @ R + np.diag(penalty), R.T @ (Q.T @ z)), Q @ raised


def equivalent(A: np.ndarray) -> np.ndarray:
    """Return the regressors (samples, terms) whose ordinary least squares is theta = A z."""
    Q, R = np.linalg.qr(A.T)
    return np.linalg.solve(R, Q.T).T


def estimator(E: np.ndarray) -> np.ndarray:
    """Return A = pinv(E), (terms, samples), of regressors of full rank."""
    Q, R = np.linalg.qr(E)
    return np.linalg.solve(R, Q.T)


def labelled(X: np.ndarray, terms: Sequence[str]) -> xr.DataArray:
    """Return regressors with the names of their terms."""
    return xr.DataArray(X, dims=("sample", "term"), coords={"term": list(terms)})


def constants(terms: Sequence[str]) -> np.ndarray:
    """Return which terms are intercepts: ``1``, or ``1[k]`` of one manoeuvre."""
    return np.array([term == "1" or term.startswith("1[") for term in terms])


def diagnostics(X: np.ndarray, fixed: np.ndarray) -> dict[str, tuple]:
    """Return the diagnostics of the regressors, as variables of a Dataset.

    Parameters
    ----------
    X : array (rows, terms)
    fixed : array of bool (terms,)
        Intercepts.

    Returns
    -------
    dict
        ``vif``, ``regressor_correlation``, ``condition_index`` (component), ``proportion`` (component, term).
    """
    correlation = collinearity.correlations(X, fixed)
    index, proportion = collinearity.decomposition(X)
    return {
        "vif": ("term", np.where(fixed, np.nan, collinearity.inflation(correlation)), {"long_name": "variance inflation factor"}),
        "regressor_correlation": (("term", "term_"), correlation),
        "condition_index": ("component", index, {"long_name": "largest singular value of the scaled regressors over each"}),
        "proportion": (("component", "term"), proportion, {"long_name": "share of the variance of a term that comes from a component"}),
    }


def estimates(
    terms: Sequence[str],
    theta: np.ndarray,
    covariance: np.ndarray,
    white: np.ndarray,
    systematic: tuple[Sequence[str], np.ndarray],
    more: dict[str, tuple],
) -> xr.Dataset:
    """Return estimates under the names that all methods share.

    Parameters
    ----------
    terms : sequence of str
    theta : array (terms,)
    covariance : array (terms, terms)
        Of coloured residuals.
    white : array (terms,)
        Standard errors if the residuals were white.
    systematic : (names, array (terms, errors))
        Change of the estimates for one standard error of each common error of the measurement.
    more : dict
        Further variables.
    """
    stderr = np.sqrt(np.diag(covariance))
    sources, change = systematic
    scale = np.where(stderr > 0, stderr, 1.0)
    return xr.Dataset(
        {
            "estimate": ("term", theta),
            "stderr": ("term", stderr, {"long_name": "standard error, coloured residuals"}),
            "stderr_white": ("term", white, {"long_name": "standard error if residuals were white"}),
            "stderr_systematic": (
                "term",
                np.linalg.norm(change, axis=1),
                {"long_name": "standard error from the common errors of the measurement"},
            ),
            "covariance": (("term", "term_"), covariance),
            "correlation": (("term", "term_"), covariance / np.outer(scale, scale)),
            "systematic": (("term", "error"), change),
            **more,
        },
        coords={"term": list(terms), "term_": list(terms), "error": np.array(list(sources), dtype=str)},
    )
