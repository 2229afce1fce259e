"""Least squares with weights and a penalty, and the one fact about linear estimates that the tables
need.

Every estimate here is linear in the measurements, theta = A z.  It is the ordinary least squares of
the regressors E = A' (A A')^-1, because pinv(E) = A.  So whoever knows E knows what an estimate
expects of tables that the local model does not describe, theta = A B g, whichever way it was made:
weighted, ridge, or in frequency.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flighttest.regression.uncertainty import collinearity


def solve_least_squares(
    X: np.ndarray, z: np.ndarray, penalty: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
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


def equivalent_regressors(A: np.ndarray) -> np.ndarray:
    """Return the regressors (samples, terms) whose ordinary least squares is theta = A z."""
    Q, R = np.linalg.qr(A.T)
    return np.linalg.solve(R, Q.T).T


def estimator_matrix(E: np.ndarray) -> np.ndarray:
    """Return A = pinv(E), (terms, samples), of regressors of full rank."""
    Q, R = np.linalg.qr(E)
    return np.linalg.solve(R, Q.T)


def label_terms(X: np.ndarray, terms: Sequence[str]) -> xr.DataArray:
    """Return regressors with the names of their terms."""
    return xr.DataArray(X, dims=("sample", "term"), coords={"term": list(terms)})


def intercept_mask(terms: Sequence[str]) -> np.ndarray:
    """Return which terms are intercepts: ``1``, or ``1[k]`` of one manoeuvre."""
    return np.array([term == "1" or term.startswith("1[") for term in terms])


def regressor_diagnostics(X: np.ndarray, fixed: np.ndarray) -> dict[str, tuple]:
    """Return the diagnostics of the regressors, as variables of a Dataset.

    Parameters
    ----------
    X : array (rows, terms)
    fixed : array of bool (terms,)
        Intercepts.

    Returns
    -------
    dict
        ``vif``, ``regressor_correlation``, ``condition_index`` (component), ``proportion``
        (component, term).
    """
    correlation = collinearity.regressor_correlations(X, fixed)
    index, proportion = collinearity.variance_decomposition(X)
    return {
        "vif": (
            "term",
            np.where(fixed, np.nan, collinearity.variance_inflation(correlation)),
            {"long_name": "variance inflation factor"},
        ),
        "regressor_correlation": (("term", "term_"), correlation),
        "condition_index": (
            "component",
            index,
            {"long_name": "largest singular value of the scaled regressors over each"},
        ),
        "proportion": (
            ("component", "term"),
            proportion,
            {"long_name": "share of the variance of a term that comes from a component"},
        ),
    }


def regression_estimates(
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
            "stderr_white": (
                "term",
                white,
                {"long_name": "standard error if residuals were white"},
            ),
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
        coords={
            "term": list(terms),
            "term_": list(terms),
            "error": np.array(list(sources), dtype=str),
        },
    )


WEIGHTS = ("equal", "manoeuvre", "robust")
# scaled deviations from which on a residual loses weight: 95 % efficiency on Gaussian noise
HUBER = 1.345
_ROUNDS = 20
_STILL = 1e-4


def weight_roots(kind: str, X: np.ndarray, z: np.ndarray, data: xr.Dataset) -> np.ndarray:
    """Return the square roots of the weights, (samples,); their squares have the mean one.

    Parameters
    ----------
    kind : str
        One of `WEIGHTS`, or a variable of `data` with standard errors.
    X, z : array (samples, terms), (samples,)
    data : Dataset (sample,)
        With ``manoeuvre``.

    Raises
    ------
    IdentificationError
        Standard errors that are not positive.
    """
    if kind == "equal":
        return np.ones(len(z))
    if kind not in WEIGHTS:
        sigma = data[kind].values
        if not (sigma > 0).all():
            raise IdentificationError(
                f"{kind} is not positive in {int((~(sigma > 0)).sum())} samples; a standard "
                f"error is needed in each"
            )
        return _scaled(1.0 / sigma)
    root, rule = np.ones(len(z)), _by_manoeuvre if kind == "manoeuvre" else _huber
    for _ in range(_ROUNDS):
        theta = np.linalg.lstsq(X * root[:, None], z * root, rcond=None)[0]
        last, root = root, _scaled(rule(z - X @ theta, data["manoeuvre"].values))
        if np.abs(root - last).max() < _STILL:
            break
    return root


def ridge_penalty(
    ridge: float | str, X: np.ndarray, z: np.ndarray, fixed: np.ndarray
) -> tuple[np.ndarray, float]:
    """Return what a ridge adds to the diagonal of X'X, (terms,), and the ridge parameter.

    Parameters
    ----------
    ridge : float or "auto"
        The parameter on standardised regressors; ``auto``: n s^2/(theta' theta) of the standardised
        regression.
    X, z : array (rows, terms), (rows,)
    fixed : array of bool (terms,)
        Intercepts, which are not penalised.

    Raises
    ------
    IdentificationError
        A negative parameter.
    """
    length2 = np.where(
        fixed, 0.0, ((X - (X.mean(axis=0) if fixed.any() else 0.0)) ** 2).sum(axis=0)
    )
    if ridge == "auto":
        theta = np.linalg.lstsq(X, z, rcond=None)[0]
        v = z - X @ theta
        s2 = float(v @ v) / (len(z) - len(theta))
        ridge = float((~fixed).sum() * s2 / (length2 * theta**2).sum())
    if isinstance(ridge, str) or not ridge >= 0.0:
        raise IdentificationError(
            f"ridge is {ridge!r}; expected a number that is not negative, or 'auto'"
        )
    return ridge * length2, float(ridge)


def _by_manoeuvre(v: np.ndarray, manoeuvre: np.ndarray) -> np.ndarray:
    rms = np.sqrt(np.bincount(manoeuvre, v**2) / np.maximum(np.bincount(manoeuvre), 1))
    least = 1e-6 * rms.max() or 1.0
    return 1.0 / np.maximum(rms, least)[manoeuvre]


def _huber(v: np.ndarray, manoeuvre: np.ndarray) -> np.ndarray:
    scale = 1.4826 * float(np.median(np.abs(v - np.median(v))))
    return (
        np.sqrt(np.minimum(1.0, HUBER * scale / np.maximum(np.abs(v), 1e-300)))
        if scale
        else np.ones(len(v))
    )


def _scaled(root: np.ndarray) -> np.ndarray:
    return root / np.sqrt(np.mean(root**2))
