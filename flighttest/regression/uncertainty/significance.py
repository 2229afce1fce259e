"""How well a prediction follows a measurement, in the numbers that reports print.

Samples where either signal is NaN are left out.  Every metric takes the measured signal first.

References
----------
.. [Gresham] Gresham, Simmons, Hopwood, Woolsey, Spin Aerodynamic Modeling for a Fixed-Wing Aircraft Using Flight Data, eq. (36), (37).
.. [Jategaonkar] Jategaonkar, Flight Vehicle System Identification, 2nd ed., AIAA 2015 (Theil's coefficient, its proportions).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from scipy import stats

from flightmech.errors import IdentificationError, UnknownName
from flightmech.support.arrays import rms


class TheilShares(NamedTuple):
    """Parts of the mean square error that are bias, unequal spread and lack of correlation; their
    sum is one.
    """

    bias: float
    variance: float
    covariance: float


def r_squared(measured, predicted) -> float:
    """Return the coefficient of determination, 1 - sum((z - y)^2)/sum((z - mean z)^2).

    Parameters
    ----------
    measured, predicted : array (time,)
        Signals z and y, of the same unit.

    Returns
    -------
    float
        1 for a perfect prediction, 0 for one that is no better than the mean, negative for a worse
        one. [1]

    Raises
    ------
    IdentificationError
        Signals of different lengths, fewer than two samples in common, or a measurement that is
        constant.
    """
    z, y = _pair(measured, predicted)
    return 1.0 - float(((z - y) ** 2).sum() / _nonzero(((z - z.mean()) ** 2).sum()))


def nrmse(measured, predicted) -> float:
    """Return the rms error over the range of the measurement, [Gresham] eq. (37). [%]

    Parameters and errors as in `r_squared`.
    """
    z, y = _pair(measured, predicted)
    return 100.0 * rms(z - y) / _nonzero(np.ptp(z))


def theil(measured, predicted) -> float:
    """Return Theil's inequality coefficient rms(z - y)/(rms(z) + rms(y)).

    Returns
    -------
    float
        0 for a perfect prediction, 1 for the worst; below 0.3 counts as good. [1]

    Notes
    -----
    This is the standard form, and the one that the numbers of [Gresham] Tables 4 and 5 were computed with.  Its eq. (36) as
    printed has one root over the sum of both squares: `theil_single_root`.

    Examples
    --------
    >>> theil([1.0, -1.0], [1.0, -1.0]), theil([1.0, -1.0], [-1.0, 1.0])
    (0.0, 1.0)
    """
    z, y = _pair(measured, predicted)
    return rms(z - y) / _nonzero(rms(z) + rms(y))


def theil_single_root(measured, predicted) -> float:
    """Return [Gresham] eq. (36) as printed, rms(z - y)/sqrt(mean z^2 + mean y^2): 0 to sqrt(2). [1]

    Parameters and errors as in `r_squared`.
    """
    z, y = _pair(measured, predicted)
    return rms(z - y) / _nonzero(np.hypot(rms(z), rms(y)))


def theil_shares(measured, predicted) -> TheilShares:
    """Return what the mean square error consists of: different means, different spreads, lack of
    correlation.

    Raises
    ------
    IdentificationError
        As in `r_squared`; also when the signals agree exactly, which leaves nothing to divide.
    """
    z, y = _pair(measured, predicted)
    total = _nonzero(((z - y) ** 2).mean())
    bias, spread = (z.mean() - y.mean()) ** 2, (z.std() - y.std()) ** 2
    rest = 2.0 * (z.std() * y.std() - ((z - z.mean()) * (y - y.mean())).mean())
    return TheilShares(float(bias / total), float(spread / total), float(rest / total))


METRICS = {"TIC": theil, "NRMSE": nrmse, "R2": r_squared}
_TITLES = {
    "TIC": "Theil's inequality coefficient (TIC): 0 is perfect, below 0.3 good",
    "NRMSE": "rms error over the range of the measurement (NRMSE) [%]: 0 is perfect",
    "R2": "coefficient of determination (R2): 1 is perfect",
}


def validation_table(
    measured: Mapping[str, Any], predicted: Mapping[str, Mapping[str, Any]]
) -> pd.DataFrame:
    """Return the metrics of one or several models against one record, laid out as [Gresham] Tables
    4 and 5.

    Parameters
    ----------
    measured : mapping of str to array (time,)
        Signals by name; a Dataset will do.
    predicted : mapping of str to mapping of str to array (time,)
        Model by model, the predictions of the same signals; the signals of the first model are the
        columns.

    Returns
    -------
    DataFrame
        Index (``metric``, ``model``) with the metrics TIC, NRMSE [%] and R2, one column per signal.

    Raises
    ------
    UnknownName
        A signal that a model or the record does not have.
    IdentificationError
        As in `r_squared`.
    """

    if not predicted:
        raise IdentificationError("no prediction to compare; give at least one model")
    columns = list(map(str, next(iter(predicted.values()))))
    for what, signals in {"the record": measured, **predicted}.items():
        for name in columns:
            if name not in signals:
                raise UnknownName(name, map(str, signals), "signal", f"{what} does not hold it")
    rows = {
        (metric, model): [
            function(np.asarray(measured[name]), np.asarray(signals[name])) for name in columns
        ]
        for metric, function in METRICS.items()
        for model, signals in predicted.items()
    }
    return pd.DataFrame.from_dict(rows, orient="index", columns=columns).set_axis(
        pd.MultiIndex.from_tuples(rows, names=["metric", "model"]), axis="index"
    )


def validation_report(table: pd.DataFrame) -> str:
    """Return a `validation_table` as text: one block per metric, one line per model."""
    width = max(len(str(model)) for model in table.index.get_level_values("model")) + 2
    lines = [" " * width + "".join(f"{name:>10}" for name in table.columns)]
    for metric, rows in table.groupby(level="metric", sort=False):
        lines.append(_TITLES.get(str(metric), str(metric)))
        lines += [
            f"{model!s:<{width}}" + "".join(f"{value:>10.4f}" for value in row)
            for (_, model), row in zip(rows.index, rows.values)
        ]
    return "\n".join(lines)


def _pair(measured, predicted) -> tuple[np.ndarray, np.ndarray]:
    z, y = np.asarray(measured, float), np.asarray(predicted, float)
    if z.shape != y.shape or z.ndim != 1:
        raise IdentificationError(
            f"signals of shape {z.shape} and {y.shape} cannot be compared; put both on one "
            f"clock first"
        )
    good = np.isfinite(z) & np.isfinite(y)
    if good.sum() < 2:
        raise IdentificationError(f"{good.sum()} samples with both signals; at least 2 are needed")
    return z[good], y[good]


def _nonzero(size) -> float:
    if not size > 0.0:
        raise IdentificationError(
            "the signals do not move, so that nothing can be divided by; choose a record "
            "with a manoeuvre"
        )
    return float(size)


CONFIDENCE = 0.95
LAGS = 20  # of the portmanteau statistic; fewer on short stretches, a fifth of the longest


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
        Parameters fitted, which are subtracted.

    Returns
    -------
    array (estimates,)
        2 (sum_f w_f)^2 / sum_f w_f^2 - terms with w_f = |A(f)|^2 S(f); of the periodogram I of the
        residual, with E[I^2] = 2 S^2, this is 4 (sum |A|^2 I)^2 / sum |A|^4 I^2.  At least one.
    """
    total, squares = np.zeros(len(A)), np.zeros(len(A))
    for piece in pieces:
        power = (np.abs(np.fft.rfft(A[:, piece], axis=1)) * np.abs(np.fft.rfft(v[piece])))[
            :, 1:
        ] ** 2
        total += power.sum(axis=1)
        squares += (power**2).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        found = np.where(squares > 0.0, 4.0 * total**2 / squares, v.size)
    return np.maximum(1.0, found - terms)


def of_slopes(
    A: np.ndarray, v: np.ndarray, pieces: Sequence[slice], fixed: np.ndarray
) -> np.ndarray:
    """Return the degrees of freedom of all terms; a constant, which has no frequency, takes the
    fewest of the slopes.

    Parameters
    ----------
    A, v, pieces
        As in `degrees_of_freedom`.
    fixed : array of bool (terms,)
        Intercepts.
    """
    found = degrees_of_freedom(A, v, pieces, len(A))
    return np.where(fixed, found[~fixed].min(), found) if not fixed.all() else found


def add_tests(
    estimates: xr.Dataset, fixed: np.ndarray, dof: np.ndarray, inflated: np.ndarray
) -> xr.Dataset:
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
        With ``dof``, ``t``, ``p_value`` (two-sided), ``low``, ``high`` of the 95 % interval: t
        quantile times the coloured standard error, and the normal quantile times the systematic
        one, squares added.  Attributes ``F`` = theta' C^-1 theta / k (Wald) of the k slopes
        together, ``F_terms`` = k, ``F_dof`` (the fewest of the slopes), ``F_probability``.
    """

    own = estimates["stderr"].values / inflated
    theta = estimates["estimate"].values
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(
            own > 0.0, theta / own, np.where(theta == 0.0, 0.0, np.copysign(np.inf, theta))
        )
    systematic = stats.norm.ppf(0.5 + CONFIDENCE / 2.0) * estimates["stderr_systematic"].values
    half = np.hypot(stats.t.ppf(0.5 + CONFIDENCE / 2.0, dof) * own, systematic)
    F, k, fewest = _wald(
        t[~fixed], estimates["correlation"].values[np.ix_(~fixed, ~fixed)], dof[~fixed]
    )
    more = {
        "dof": ("term", dof, {"long_name": "degrees of freedom of the standard error"}),
        "t": ("term", t),
        "p_value": (
            "term",
            2.0 * stats.t.sf(np.abs(t), dof),
            {"long_name": "two-sided probability of so large a t by chance"},
        ),
        "low": (
            "term",
            theta - half,
            {"long_name": "lower end of the 95 % confidence interval, systematic errors included"},
        ),
        "high": (
            "term",
            theta + half,
            {"long_name": "upper end of the 95 % confidence interval, systematic errors included"},
        ),
    }
    about = {
        "F": F,
        "F_terms": k,
        "F_dof": fewest,
        "F_probability": float(stats.f.sf(F, k, fewest)) if k else float("nan"),
    }
    return estimates.assign(more).assign_attrs(about)


def _wald(t: np.ndarray, correlation: np.ndarray, dof: np.ndarray) -> tuple[float, int, float]:
    """F, its terms and its degrees of freedom."""
    if not len(t):
        return float("nan"), 0, float("nan")
    if not np.isfinite(t).all():
        return float("inf"), len(t), float(dof.min())
    return max(0.0, float(t @ np.linalg.solve(correlation, t))) / len(t), len(t), float(dof.min())


def residual_whiteness(
    v: np.ndarray, pieces: Sequence[slice], steps: Sequence[float]
) -> dict[str, float]:
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
        ``portmanteau`` Q = N (N + 2) sum_k rho_k^2/(N - k) over ``portmanteau_lags``, which is
        chi-square of so many degrees of freedom when the residuals are white [Ljung1978]_,
        ``portmanteau_probability`` that white residuals give more, and ``correlation_time`` = step
        (1/2 + sum_k rho_k) up to the first autocorrelation below zero [s].
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
