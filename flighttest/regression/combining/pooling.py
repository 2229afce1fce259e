"""Pooling of independent estimates of one parameter, and of fits term by term."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from flightmech.errors import IdentificationError
from flighttest.regression.equation_error.fit import Fit

METHODS = ("inverse_variance", "median", "inverse_sigma")
# combined standard errors between two estimates that must not be averaged without a remark
DISAGREEMENT = 3.0
_TO_SIGMA = 1.4826  # standard deviation of Gaussian noise over its median absolute deviation
_OF_MEDIAN = 1.25  # standard error of a median over that of a mean, Gaussian noise
_FEW = 8  # estimates; the scatter of fewer is often much too small by chance


@dataclass(frozen=True)
class Pooled:
    """Several estimates of one parameter, pooled.

    Attributes
    ----------
    value, stderr : float
        The pooled value and its standard error.
    scatter : float
        1.4826 times the median absolute deviation from the median: scatter of single estimates.
    chi2 : float
        sum((theta - mean)^2/s^2) about the inverse-variance mean; about `count` - 1 if the
        estimates agree.
    birge : float
        sqrt(chi2/(count - 1)). If it is above one, the standard error of the inverse-variance mean
        has been multiplied by it.
    scatter_ratio : float
        `scatter` over the mean standard error; 0.7 to 1.4 is sound.
    disagreement : float
        Largest difference of two estimates in combined standard errors. Above 3 they contradict
        each other.
    count : int
        Number of estimates.
    """

    value: float
    stderr: float
    scatter: float
    chi2: float
    birge: float
    scatter_ratio: float
    disagreement: float
    count: int

    @property
    def contradictory(self) -> bool:
        """Whether two of the estimates are more than three combined standard errors apart."""
        return self.disagreement > DISAGREEMENT


def pool(
    values: Sequence[float], stderr: Sequence[float], method: str = "inverse_variance"
) -> Pooled:
    """Pool independent estimates of one parameter.

    Parameters
    ----------
    values, stderr : array (estimates,)
        Estimates and their standard errors, positive.
    method : {"inverse_variance", "median", "inverse_sigma"}
        Weights 1/s^2, with the Birge ratio; the median, with the standard error
        1.25 scatter/sqrt(n), where the scatter of fewer than eight estimates counts at least as
        much as the median of their standard errors; or weights 1/s and the standard error
        sqrt(n)/sum(1/s) of [Grauer2010]_, which reproduces published tables and is not recommended.

    Raises
    ------
    IdentificationError
        No estimate, or a standard error that is not positive.

    References
    ----------
    .. [Grauer2010] Grauer, Ulrich, Hubbard, Pines, Humbert, AIAA 2010-7632 (weights 1/s).

    Examples
    --------
    >>> joined = pool([1.0, 1.2], [0.1, 0.1])
    >>> round(joined.value, 3), round(joined.birge, 3), round(joined.stderr, 3)
    (1.1, 1.414, 0.1)
    """
    if method not in METHODS:
        raise ValueError(f"method is {method!r}; allowed: {', '.join(METHODS)}")
    theta, s = np.atleast_1d(np.asarray(values, float)), np.atleast_1d(np.asarray(stderr, float))
    if not len(theta) or len(theta) != len(s) or not (s > 0).all() or not np.isfinite(theta).all():
        raise IdentificationError(
            f"found {len(theta)} values and {len(s)} standard errors {s.tolist()}; expected "
            f"one positive standard error per finite value"
        )
    # Inverse-variance mean, its consistency chi2, and the Birge ratio sqrt(chi2/(n - 1)).
    n = len(theta)
    w = 1.0 / s**2
    mean = float(w @ theta / w.sum())
    chi2 = float(w @ (theta - mean) ** 2)
    birge = float(np.sqrt(chi2 / (n - 1))) if n > 1 else 0.0
    scatter = float(_TO_SIGMA * np.median(np.abs(theta - np.median(theta))))
    if method == "inverse_variance":
        value, error = mean, max(1.0, birge) / np.sqrt(w.sum())
    elif method == "median":
        value, error = _median_with_error(theta, s, scatter)
    else:
        value, error = float((theta / s).sum() / (1.0 / s).sum()), np.sqrt(n) / (1.0 / s).sum()
    # differences of all pairs in combined standard errors
    differences = np.abs(theta[:, None] - theta) / np.hypot(s[:, None], s)
    return Pooled(
        value=value,
        stderr=float(error),
        scatter=scatter,
        chi2=chi2,
        birge=birge,
        scatter_ratio=scatter / float(s.mean()),
        disagreement=float(differences.max()),
        count=n,
    )


def _median_with_error(theta: np.ndarray, s: np.ndarray, scatter: float) -> tuple[float, float]:
    """Return the median of estimates and its standard error."""
    value, n = float(np.median(theta)), len(theta)
    # the scatter of two estimates is not meaningful
    if n <= 2:
        return value, float(np.sqrt((s**2).mean() / n))
    # Of three estimates, two equal ones have no scatter. Two standard errors by the scatter of
    # three normal variables cover 65 %, with this limit 97 %.
    if n < _FEW:
        scatter = max(scatter, float(np.median(s)))
    return value, _OF_MEDIAN * scatter / np.sqrt(n)


def common_coefficient(fits: Sequence[Fit], verb: str) -> str:
    """Return the coefficient of all fits; raise if they have several, or if there is no fit."""
    coefficients = {fit.model.coefficient for fit in fits}
    if len(coefficients) != 1:
        raise IdentificationError(
            f"fits of {', '.join(sorted(coefficients)) or 'nothing'} cannot be {verb}; give fits "
            f"of one coefficient"
        )
    return coefficients.pop()


def list_terms(fits: Sequence[Fit]) -> list[str]:
    """Return the terms of all fits, each once, in order of appearance."""
    terms: dict[str, None] = {}
    for fit in fits:
        terms.update(dict.fromkeys(map(str, fit.estimates["term"].values)))
    return list(terms)


def pool_term(fits: Sequence[Fit], term: str, method: str, stderr_name: str = "stderr") -> Pooled:
    """Return the pooled estimate of one term, from the fits that have it."""
    values, stderr = [], []
    for fit in fits:
        if term in fit.estimates["term"].values:
            row = fit.estimates.sel(term=term)
            values.append(float(row["estimate"]))
            stderr.append(float(row[stderr_name]))
    return pool(values, stderr, method)


def pool_fits(fits: Sequence[Fit], method: str = "inverse_variance") -> pd.DataFrame:
    """Pool the fits of one coefficient term by term.

    Parameters
    ----------
    fits : sequence of Fit
        All of the same coefficient, at comparable conditions.
    method : str
        As in `pool`.

    Returns
    -------
    DataFrame
        One row per term: the attributes of `Pooled` and ``contradictory``. Systematic errors are
        common to the fits and are not part of these standard errors.

    Raises
    ------
    IdentificationError
        Fits of different coefficients.
    """
    common_coefficient(fits, "pooled")
    rows = {}
    for term in list_terms(fits):
        pooled = pool_term(fits, term, method)
        rows[term] = {**vars(pooled), "contradictory": pooled.contradictory}
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("term")
