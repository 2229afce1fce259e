"""Least squares with weights and a penalty, and the labelled tables of its results.

Every estimate here is linear in the measurements, theta = A z. It is the ordinary least-squares
estimate with the regressors E = A' (A A')^-1, because pinv(E) = A. The regressors E therefore
determine what the estimate expects of tables g that the local model does not describe,
theta = A B g. This holds for weighted, ridge and frequency-domain estimates alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flighttest.regression.uncertainty import collinearity
from flighttest.remarks import Convergence

WEIGHTS = ("equal", "manoeuvre", "robust")
RIDGE_BIAS = "bias of the ridge, from the estimates without it"
# scaled deviations from which on a residual loses weight: 95 % efficiency on Gaussian noise
HUBER = 1.345
_TO_SIGMA = 1.4826  # standard deviation of Gaussian noise over its median absolute deviation
_ROUNDS = 20  # alternations of fit and weights
_STILL = 1e-4  # change of the root of a weight that ends them
_NOT_ITERATED = Convergence(True, 0, 0.0)
_LEAST_RMS = 1e-6  # smallest rms of a manoeuvre that its weight uses, of the largest rms


def solve_least_squares(
    X: np.ndarray, z: np.ndarray, penalty: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the least-squares estimate and its equivalent regressors.

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
    # E = Q R^-T (X'X + K), with the penalty K on the diagonal
    raised = np.linalg.solve(R.T, R.T @ R + np.diag(penalty))
    return np.linalg.solve(R.T @ R + np.diag(penalty), R.T @ (Q.T @ z)), Q @ raised


def equivalent_regressors(A: np.ndarray) -> np.ndarray:
    """Return the regressors (samples, terms) whose ordinary least squares is theta = A z."""
    Q, R = np.linalg.qr(A.T)
    return np.linalg.solve(R, Q.T).T


def estimator_matrix(E: np.ndarray) -> np.ndarray:
    """Return A = pinv(E), (terms, samples), of regressors of full rank."""
    Q, R = np.linalg.qr(E)
    return np.linalg.solve(R, Q.T)


def ridge_bias(X: np.ndarray, z: np.ndarray, penalty: np.ndarray) -> np.ndarray:
    """Return the bias of a ridge estimate, -(X'X + K)^-1 K theta, (terms,).

    Parameters
    ----------
    X : array (rows, terms)
    z : array (rows,)
    penalty : array (terms,)
        Diagonal of K. theta is the estimate without penalty.
    """
    unbiased = solve_least_squares(X, z)[0]
    return -np.linalg.solve(X.T @ X + np.diag(penalty), penalty * unbiased)


def label_terms(X: np.ndarray, terms: Sequence[str]) -> xr.DataArray:
    """Return regressors with the names of their terms."""
    return xr.DataArray(X, dims=("sample", "term"), coords={"term": list(terms)})


def intercept_mask(terms: Sequence[str]) -> np.ndarray:
    """Return which terms are intercepts: ``1``, or ``1[k]`` of one manoeuvre."""
    return np.array([term == "1" or term.startswith("1[") for term in terms])


def regressor_diagnostics(X: np.ndarray, fixed: np.ndarray) -> dict[str, Any]:
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


def spread_diagnostics(diagnostics: dict[str, Any], is_missing: np.ndarray) -> dict[str, Any]:
    """Return diagnostics of some terms for all terms; the missing ones are not collinear.

    Parameters
    ----------
    diagnostics : dict
        As from `regressor_diagnostics`, of the other terms.
    is_missing : array of bool (terms,)
        Terms that are removed or eliminated.
    """
    n, columns = len(is_missing), np.flatnonzero(~is_missing)
    # Missing terms have no variance inflation, and are not correlated with the others.
    vif, correlation = np.full(n, np.nan), np.eye(n)
    vif[columns] = diagnostics["vif"][1]
    correlation[np.ix_(columns, columns)] = diagnostics["regressor_correlation"][1]
    proportion = np.zeros((len(diagnostics["condition_index"][1]), n))
    proportion[:, columns] = diagnostics["proportion"][1]
    return {
        **diagnostics,
        "vif": ("term", vif, diagnostics["vif"][2]),
        "regressor_correlation": (("term", "term_"), correlation),
        "proportion": (("component", "term"), proportion, diagnostics["proportion"][2]),
    }


def regression_estimates(
    terms: Sequence[str],
    theta: np.ndarray,
    covariance: np.ndarray,
    white: np.ndarray,
    systematic: tuple[Sequence[str], np.ndarray],
    extra: dict[str, Any],
) -> xr.Dataset:
    """Return estimates as a Dataset with the names that all methods share.

    Parameters
    ----------
    terms : sequence of str
    theta : array (terms,)
    covariance : array (terms, terms)
        Covariance for coloured residuals.
    white : array (terms,)
        Standard errors for white residuals.
    systematic : (names, array (terms, errors))
        Change of the estimates for one standard error of each common error of the measurement.
    extra : dict
        Further variables of the Dataset.
    """
    stderr = np.sqrt(np.diag(covariance))
    sources, change = systematic
    # An estimate without standard error keeps a correlation of zero.
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
            **extra,
        },
        coords={
            "term": list(terms),
            "term_": list(terms),
            "error": np.array(list(sources), dtype=str),
        },
    )


def weight_roots(
    kind: str, X: np.ndarray, z: np.ndarray, data: xr.Dataset
) -> tuple[np.ndarray, Convergence]:
    """Return the square roots of the weights, (samples,), and the end of their iteration.

    The squares of the roots have the mean one.  The change of the iteration is the largest of a
    root over its tolerance.

    Parameters
    ----------
    kind : str
        One of `WEIGHTS`, or a variable of `data` with standard errors.
    X : array (samples, terms)
    z : array (samples,)
    data : Dataset (sample,)
        Contains ``manoeuvre``.

    Raises
    ------
    IdentificationError
        Standard errors that are not positive.
    """
    if kind == "equal":
        return np.ones(len(z)), _NOT_ITERATED
    if kind not in WEIGHTS:
        sigma = data[kind].values
        if not (sigma > 0).all():
            raise IdentificationError(
                f"{kind} is not positive in {int((~(sigma > 0)).sum())} samples; a standard "
                f"error is needed in each"
            )
        return _scale_to_unit_mean(1.0 / sigma), _NOT_ITERATED
    # The weights depend on the residual: iteratively reweighted least squares.
    rule = _manoeuvre_weights if kind == "manoeuvre" else _huber_weights
    root = np.ones(len(z))
    convergence = _NOT_ITERATED
    for count in range(1, _ROUNDS + 1):
        theta = np.linalg.lstsq(X * root[:, None], z * root, rcond=None)[0]
        previous = root
        root = _scale_to_unit_mean(rule(z - X @ theta, data["manoeuvre"].values))
        change = float(np.abs(root - previous).max())
        convergence = Convergence(change < _STILL, count, change / _STILL)
        if convergence.converged:
            break
    return root, convergence


def ridge_penalty(
    ridge: float | str, X: np.ndarray, z: np.ndarray, fixed: np.ndarray
) -> tuple[np.ndarray, float]:
    """Return the penalty on the diagonal of X'X, (terms,), and the ridge parameter.

    Parameters
    ----------
    ridge : float or "auto"
        The parameter k on standardised regressors. ``auto`` takes k = n s^2/(theta' theta) of the
        standardised regression.
    X : array (rows, terms)
    z : array (rows,)
    fixed : array of bool (terms,)
        Intercepts, which are not penalised.

    Raises
    ------
    IdentificationError
        A parameter that is negative or not finite.
    """
    # squared length of each regressor about its mean; without a constant, about zero
    centre = X.mean(axis=0) if fixed.any() else 0.0
    length2 = np.where(fixed, 0.0, ((X - centre) ** 2).sum(axis=0))
    if ridge == "auto":
        theta = np.linalg.lstsq(X, z, rcond=None)[0]
        v = z - X @ theta
        s2 = float(v @ v) / (len(z) - len(theta))
        ridge = float((~fixed).sum() * s2 / (length2 * theta**2).sum())
    if isinstance(ridge, str) or not 0.0 <= ridge < np.inf:
        raise IdentificationError(
            f"ridge is {ridge!r}; expected a finite number that is not negative, or 'auto'"
        )
    return ridge * length2, float(ridge)


def _manoeuvre_weights(v: np.ndarray, manoeuvre: np.ndarray) -> np.ndarray:
    """Return one over the residual rms of the manoeuvre of each sample."""
    rms = np.sqrt(np.bincount(manoeuvre, v**2) / np.maximum(np.bincount(manoeuvre), 1))
    least = _LEAST_RMS * rms.max() or 1.0
    return 1.0 / np.maximum(rms, least)[manoeuvre]


def _huber_weights(v: np.ndarray, manoeuvre: np.ndarray) -> np.ndarray:
    """Return the roots of Huber's weights of the residuals."""
    limit = _huber_limit(v)
    if not limit:
        return np.ones(len(v))
    return np.sqrt(np.minimum(1.0, limit / np.maximum(np.abs(v), 1e-300)))


def _huber_limit(v: np.ndarray) -> float:
    """Return the size from which on a residual loses weight."""
    return HUBER * _TO_SIGMA * float(np.median(np.abs(v - np.median(v))))


def huber_pseudo_residuals(v: np.ndarray) -> np.ndarray:
    """Return the residuals (samples,) whose ordinary least squares have Huber's standard errors.

    The error of Huber's estimate is (X' psi' X)^-1 X' psi, where psi is the residual v clipped at
    the limit and psi' is 1 within it [Huber1981]_.  It is that of ordinary least squares with
    psi over the share of the residuals within the limit.  Weighted residuals in their place give
    10 % too little for Gaussian noise, and too much when there are spikes.

    References
    ----------
    .. [Huber1981] Huber, Robust Statistics, Wiley 1981, section 7.6.
    """
    limit = _huber_limit(v)
    if not limit:
        return v
    return np.clip(v, -limit, limit) / float(np.mean(np.abs(v) <= limit))


def _scale_to_unit_mean(root: np.ndarray) -> np.ndarray:
    return root / np.sqrt(np.mean(root**2))
