"""Tests of significance and confidence intervals of regression estimates, whiteness of residuals.

References
----------
.. [Ljung1978] Ljung, Box, On a measure of lack of fit in time series models, Biometrika 65, 1978.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy
import xarray as xr

CONFIDENCE = 0.95
LAGS = 20  # of the portmanteau statistic; fewer on short stretches, a fifth of the longest
_WITH_SYSTEMATIC = "end of the 95 % confidence interval, systematic errors included"


def degrees_of_freedom(
    A: np.ndarray, v: np.ndarray, pieces: Sequence[slice], terms: int
) -> np.ndarray:
    """Return the degrees of freedom of the standard errors of linear estimates theta = A z.

    Parameters
    ----------
    A : array (estimates, samples)
    v : array (samples,)
        Residuals.
    pieces : sequence of slice
        Contiguous stretches of samples.
    terms : int
        Fitted parameters, which are subtracted.

    Returns
    -------
    array (estimates,)
        2 (sum_f w_f)^2 / sum_f w_f^2 - terms with w_f = |A(f)|^2 S(f). For the periodogram I of the
        residual, with E[I^2] = 2 S^2, this is 4 (sum |A|^2 I)^2 / sum |A|^4 I^2. At least one.
    """
    total, squares = np.zeros(len(A)), np.zeros(len(A))
    for piece in pieces:
        # |A(f)|^2 I(f) without the mean of the piece, which has no frequency
        amplitude = np.abs(np.fft.rfft(A[:, piece], axis=1)) * np.abs(np.fft.rfft(v[piece]))
        power = amplitude[:, 1:] ** 2
        total += power.sum(axis=1)
        squares += (power**2).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        dof = np.where(squares > 0.0, 4.0 * total**2 / squares, v.size)
    return np.maximum(1.0, dof - terms)


def of_slopes(
    A: np.ndarray,
    v: np.ndarray,
    pieces: Sequence[slice],
    fixed: np.ndarray,
    terms: int | None = None,
) -> np.ndarray:
    """Return the degrees of freedom of all terms.

    A constant has no frequency and takes the fewest degrees of freedom of the slopes.

    Parameters
    ----------
    A, v, pieces
        As in `degrees_of_freedom`.
    fixed : array of bool (terms,)
        Intercepts.
    terms : int, optional
        Fitted parameters; all terms by default.
    """
    dof = degrees_of_freedom(A, v, pieces=pieces, terms=len(A) if terms is None else terms)
    if fixed.all():
        return dof
    return np.where(fixed, dof[~fixed].min(), dof)


def add_tests(
    estimates: xr.Dataset, fixed: np.ndarray, dof: np.ndarray, inflated: np.ndarray
) -> xr.Dataset:
    """Return estimates with t and F tests and confidence intervals.

    Parameters
    ----------
    estimates : Dataset (term, term_)
    fixed : array of bool (terms,)
        Intercepts, which the F test ignores.
    dof : array (terms,)
        Degrees of freedom of the standard errors.
    inflated : array (terms,)
        Student's factor that a standard error already contains for few degrees of freedom.

    Returns
    -------
    Dataset
        With ``dof``, ``t``, ``p_value`` (two-sided), ``low``, ``high`` of the 95 % interval: t
        quantile times the coloured standard error, and the normal quantile times the systematic
        one, squares added. Attributes ``F`` = theta' C^-1 theta / k (Wald) of the k slopes
        together, ``F_terms`` = k, ``F_dof`` (the fewest of the slopes), ``F_probability``.
    """
    stderr = estimates["stderr"].values / inflated
    theta = estimates["estimate"].values
    t = _t_ratio(theta, stderr)
    quantile = 0.5 + CONFIDENCE / 2.0
    systematic = scipy.stats.norm.ppf(quantile) * estimates["stderr_systematic"].values
    half_width = np.hypot(scipy.stats.t.ppf(quantile, dof) * stderr, systematic)
    correlation = estimates["correlation"].values[np.ix_(~fixed, ~fixed)]
    F, k, fewest = _wald_test(t[~fixed], correlation, dof[~fixed])
    probability = float("nan")
    if k:
        probability = float(scipy.stats.f.sf(F, k, fewest))
    variables = {
        "dof": ("term", dof, {"long_name": "degrees of freedom of the standard error"}),
        "t": ("term", t),
        "p_value": (
            "term",
            2.0 * scipy.stats.t.sf(np.abs(t), dof),
            {"long_name": "two-sided probability of so large a t by chance"},
        ),
        "low": ("term", theta - half_width, {"long_name": f"lower {_WITH_SYSTEMATIC}"}),
        "high": ("term", theta + half_width, {"long_name": f"upper {_WITH_SYSTEMATIC}"}),
    }
    attributes = {"F": F, "F_terms": k, "F_dof": fewest, "F_probability": probability}
    return estimates.assign(variables).assign_attrs(attributes)


def _t_ratio(theta: np.ndarray, stderr: np.ndarray) -> np.ndarray:
    """Return estimates over standard errors; infinite for an exact estimate that is not zero."""
    exact = np.where(theta == 0.0, 0.0, np.copysign(np.inf, theta))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(stderr > 0.0, theta / stderr, exact)


def _wald_test(t: np.ndarray, correlation: np.ndarray, dof: np.ndarray) -> tuple[float, int, float]:
    """Return F of all slopes together, the number of slopes, and their fewest dof."""
    if not len(t):
        return float("nan"), 0, float("nan")
    if not np.isfinite(t).all():
        return float("inf"), len(t), float(dof.min())
    # theta' C^-1 theta = t' rho^-1 t, with the correlation rho of the estimates
    F = max(0.0, float(t @ np.linalg.solve(correlation, t))) / len(t)
    return F, len(t), float(dof.min())


def residual_whiteness(
    v: np.ndarray, pieces: Sequence[slice], steps: Sequence[float]
) -> dict[str, float]:
    """Return the portmanteau test of the residuals and their correlation time.

    Parameters
    ----------
    v : array (samples,)
        Residuals.
    pieces : sequence of slice
        Contiguous stretches of samples.
    steps : sequence of float
        Sampling interval of each piece. [s]

    Returns
    -------
    dict
        ``portmanteau`` Q = N (N + 2) sum_k rho_k^2/(N - k) over ``portmanteau_lags`` lags
        [Ljung1978]_. For white residuals Q is chi-square with as many degrees of freedom.
        ``portmanteau_probability`` is the probability that white residuals give a larger Q.
        ``correlation_time`` = step (1/2 + sum_k rho_k) up to the first autocorrelation that is not
        positive [s].
    """
    longest = max(piece.stop - piece.start for piece in pieces)
    parts = [v[piece] - v[piece].mean() for piece in pieces]
    power = sum(float(x @ x) for x in parts)
    lags = max(1, min(LAGS, longest // 5))
    if power <= 0.0 or longest < 2:
        return {
            "portmanteau": 0.0,
            "portmanteau_lags": lags,
            "portmanteau_probability": 1.0,
            "correlation_time": 0.0,
        }
    rho = np.sum([_lagged_products(x, longest) for x in parts], axis=0) / power
    N, k = len(v), np.arange(1, lags + 1)
    Q = N * (N + 2.0) * float((rho[k] ** 2 / (N - k)).sum())
    # Autocorrelations beyond the first one that is not positive are noise.
    crossings = np.flatnonzero(rho <= 0.0)
    end = int(crossings[0]) if len(crossings) else len(rho)
    positive = rho[1:end]
    step = float(np.average(steps, weights=[piece.stop - piece.start for piece in pieces]))
    return {
        "portmanteau": Q,
        "portmanteau_lags": lags,
        "portmanteau_probability": float(scipy.stats.chi2.sf(Q, lags)),
        "correlation_time": step * (0.5 + float(positive.sum())),
    }


def _lagged_products(x: np.ndarray, lags: int) -> np.ndarray:
    """Return the sums x_t x_(t+k) over t, at lags 0 ... lags - 1."""
    # The transform is padded, so that its products do not wrap around.
    size = 1 << (2 * len(x)).bit_length()
    products = np.fft.irfft(np.abs(np.fft.rfft(x, size)) ** 2, size)[: len(x)]
    return np.pad(products, (0, lags - len(x)))
