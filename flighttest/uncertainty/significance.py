"""Whether estimates differ from zero, how wide their confidence intervals are, and what colour the residuals have.

The covariance of an estimate is itself an estimate.  The power of the residual that decides on a standard error is that
at the frequencies of the regressor, and a record of length T has one independent ordinate per 1/T: ten seconds in which
the controls move below 0.8 Hz hold eight of them, whatever the sampling rate.  The degrees of freedom follow by the
moments of that weighted sum (Satterthwaite), and Student's t and the F distribution take the place of the normal one.

References
----------
.. [Satterthwaite1946] Satterthwaite, An approximate distribution of estimates of variance components, Biometrics Bull. 2, 1946.
.. [Ljung1978] Ljung, Box, On a measure of lack of fit in time series models, Biometrika 65, 1978.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

CONFIDENCE = 0.95
LAGS = 20  # of the portmanteau statistic; fewer on short stretches, a fifth of the longest


def degrees(A: np.ndarray, v: np.ndarray, pieces: Sequence[slice], terms: int) -> np.ndarray:
    """Return the degrees of freedom of the standard errors of linear estimates theta = A z.

    Parameters
    ----------
    A : array (estimates, samples)
    v : array (samples,)
        Residuals.
    pieces : sequence of slice
        Contiguous stretches of samples.
    terms : int
        Parameters fitted, which are subtracted.

    Returns
    -------
    array (estimates,)
        2 (sum_f w_f)^2 / sum_f w_f^2 - terms with w_f = |A(f)|^2 S(f); of the periodogram I of the residual, with
        E[I^2] = 2 S^2, this is 4 (sum |A|^2 I)^2 / sum |A|^4 I^2.  At least one.
    """
    total, squares = np.zeros(len(A)), np.zeros(len(A))
    for piece in pieces:
        power = (np.abs(np.fft.rfft(A[:, piece], axis=1)) * np.abs(np.fft.rfft(v[piece])))[:, 1:] ** 2
        total += power.sum(axis=1)
        squares += (power**2).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        found = np.where(squares > 0.0, 4.0 * total**2 / squares, v.size)
    return np.maximum(1.0, found - terms)


def of_slopes(A: np.ndarray, v: np.ndarray, pieces: Sequence[slice], fixed: np.ndarray) -> np.ndarray:
    """Return the degrees of freedom of all terms; a constant, which has no frequency, takes the fewest of the slopes.

    Parameters
    ----------
    A, v, pieces
        As in `degrees`.
    fixed : array of bool (terms,)
        Intercepts.
    """
    found = degrees(A, v, pieces, len(A))
    return np.where(fixed, found[~fixed].min(), found) if not fixed.all() else found


def added(estimates: xr.Dataset, fixed: np.ndarray, dof: np.ndarray, inflated: np.ndarray) -> xr.Dataset:
    """Return estimates with t and F tests and confidence intervals.

    Parameters
    ----------
    estimates : Dataset (term, term_)
    fixed : array of bool (terms,)
        Intercepts, which the F test leaves out.
    dof : array (terms,)
        Degrees of freedom of the standard errors.
    inflated : array (terms,)
        Factor by which a standard error has been inflated for few degrees of freedom already.

    Returns
    -------
    Dataset
        With ``dof``, ``t``, ``p_value`` (two-sided), ``low``, ``high`` of the 95 % interval: t quantile times the coloured
        standard error, and the normal quantile times the systematic one, squares added.  Attributes ``F`` = theta' C^-1 theta / k
        (Wald) of the k slopes together, ``F_terms`` = k, ``F_dof`` (the fewest of the slopes), ``F_probability``.
    """
    from scipy import stats

    own = estimates["stderr"].values / inflated
    theta = estimates["estimate"].values
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(own > 0.0, theta / own, np.where(theta == 0.0, 0.0, np.copysign(np.inf, theta)))
    systematic = stats.norm.ppf(0.5 + CONFIDENCE / 2.0) * estimates["stderr_systematic"].values
    half = np.hypot(stats.t.ppf(0.5 + CONFIDENCE / 2.0, dof) * own, systematic)
    F, k, fewest = _wald(t[~fixed], estimates["correlation"].values[np.ix_(~fixed, ~fixed)], dof[~fixed])
    more = {
        "dof": ("term", dof, {"long_name": "degrees of freedom of the standard error"}),
        "t": ("term", t),
        "p_value": ("term", 2.0 * stats.t.sf(np.abs(t), dof), {"long_name": "two-sided probability of so large a t by chance"}),
        "low": ("term", theta - half, {"long_name": "lower end of the 95 % confidence interval, systematic errors included"}),
        "high": ("term", theta + half, {"long_name": "upper end of the 95 % confidence interval, systematic errors included"}),
    }
    about = {"F": F, "F_terms": k, "F_dof": fewest, "F_probability": float(stats.f.sf(F, k, fewest)) if k else float("nan")}
    return estimates.assign(more).assign_attrs(about)


def _wald(t: np.ndarray, correlation: np.ndarray, dof: np.ndarray) -> tuple[float, int, float]:
    """F, its terms and its degrees of freedom."""
    if not len(t):
        return float("nan"), 0, float("nan")
    if not np.isfinite(t).all():
        return float("inf"), len(t), float(dof.min())
    return max(0.0, float(t @ np.linalg.solve(correlation, t))) / len(t), len(t), float(dof.min())


def whiteness(v: np.ndarray, pieces: Sequence[slice], steps: Sequence[float]) -> dict[str, float]:
    """Return how far the residuals are from white.

    Parameters
    ----------
    v : array (samples,)
        Residuals.
    pieces, steps
        Contiguous stretches of samples and their sampling intervals [s].

    Returns
    -------
    dict
        ``portmanteau`` Q = N (N + 2) sum_k rho_k^2/(N - k) over ``portmanteau_lags``, which is chi-square of so many degrees of
        freedom when the residuals are white [Ljung1978]_, ``portmanteau_probability`` that white residuals give more, and
        ``correlation_time`` = step (1/2 + sum_k rho_k) up to the first autocorrelation below zero [s].
    """
    from scipy import stats

    longest = max(piece.stop - piece.start for piece in pieces)
    parts = [v[piece] - v[piece].mean() for piece in pieces]
    power = sum(float(x @ x) for x in parts)
    lags = max(1, min(LAGS, longest // 5))
    if power <= 0.0 or longest < 2:
        return {"portmanteau": 0.0, "portmanteau_lags": lags, "portmanteau_probability": 1.0, "correlation_time": 0.0}
    rho = np.sum([_products(x, longest) for x in parts], axis=0) / power
    N, k = len(v), np.arange(1, lags + 1)
    Q = N * (N + 2.0) * float((rho[k] ** 2 / (N - k)).sum())
    ends = np.flatnonzero(rho <= 0.0)
    positive = rho[1 : int(ends[0]) if len(ends) else len(rho)]
    step = float(np.average(steps, weights=[piece.stop - piece.start for piece in pieces]))
    return {
        "portmanteau": Q,
        "portmanteau_lags": lags,
        "portmanteau_probability": float(stats.chi2.sf(Q, lags)),
        "correlation_time": step * (0.5 + float(positive.sum())),
    }


def _products(x: np.ndarray, lags: int) -> np.ndarray:
    """Lagged products sum_t x_t x_(t+k) at lags 0 ... lags - 1."""
    size = 1 << (2 * len(x)).bit_length()
    found = np.fft.irfft(np.abs(np.fft.rfft(x, size)) ** 2, size)[: len(x)]
    return np.pad(found, (0, lags - len(x)))
