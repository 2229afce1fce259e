"""One value out of several estimates of the same parameter.

The estimates must be independent: those of two methods on the same record are not, and their mean is no better than the
better of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flightmech.errors import IdentificationError

from ..equation_error.fit import Fit

METHODS = ("inverse_variance", "median", "inverse_sigma")
DISAGREEMENT = 3.0  # combined standard errors between two estimates that should not be averaged silently


@dataclass(frozen=True)
class Pooled:
    """Several estimates joined.

    Attributes
    ----------
    value, stderr : float
        The joined value and its standard error.
    scatter : float
        1.4826 times the median absolute deviation from the median: scatter of single estimates.
    chi2 : float
        sum((theta - mean)^2/s^2) about the inverse-variance mean; about `count` - 1 when the estimates agree.
    birge : float
        sqrt(chi2/(count - 1)); above one the standard error of the inverse-variance mean has been multiplied by it.
    scatter_ratio : float
        `scatter` over the mean standard error; 0.7 to 1.4 is sound.
    disagreement : float
        Largest difference of two estimates in combined standard errors; above 3 they contradict each other.
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


def pool(values: Sequence[float], stderr: Sequence[float], method: str = "inverse_variance") -> Pooled:
    """Join independent estimates of one parameter.

    Parameters
    ----------
    values, stderr : array (estimates,)
        Estimates and their standard errors, positive.
    method : {"inverse_variance", "median", "inverse_sigma"}
        Weights 1/s^2, with the Birge ratio; the median, with 1.25 scatter/sqrt(n) for its error; weights 1/s and error
        sqrt(n)/sum(1/s), as some papers do (to reproduce their tables, not to be preferred).

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
            f"found {len(theta)} values and {len(s)} standard errors {s.tolist()}; expected one positive standard error per finite value"
        )
    n = len(theta)
    w = 1.0 / s**2
    mean = float(w @ theta / w.sum())
    chi2 = float(w @ (theta - mean) ** 2)
    birge = float(np.sqrt(chi2 / (n - 1))) if n > 1 else 0.0
    scatter = float(1.4826 * np.median(np.abs(theta - np.median(theta))))
    if method == "inverse_variance":
        value, error = mean, max(1.0, birge) / np.sqrt(w.sum())
    elif method == "median":
        value, error = float(np.median(theta)), 1.25 * scatter / np.sqrt(n) if n > 2 else float(np.sqrt((s**2).mean() / n))
    else:
        value, error = float((theta / s).sum() / (1.0 / s).sum()), np.sqrt(n) / (1.0 / s).sum()
    apart = np.abs(theta[:, None] - theta) / np.hypot(s[:, None], s)
    return Pooled(value, float(error), scatter, chi2, birge, scatter / float(s.mean()), float(apart.max()), n)


def pool_fits(fits: Sequence[Fit], method: str = "inverse_variance"):
    """Join the fits of one coefficient term by term.

    Parameters
    ----------
    fits : sequence of Fit
        All of the same coefficient, at comparable conditions.
    method : str
        As in `pool`.

    Returns
    -------
    DataFrame
        One row per term: the attributes of `Pooled` and ``contradictory``.  Systematic errors are common to the fits
        and not in these standard errors.

    Raises
    ------
    IdentificationError
        Fits of different coefficients.
    """
    import pandas as pd

    if len(found := {fit.model.coefficient for fit in fits}) != 1:
        raise IdentificationError(f"fits of {', '.join(sorted(found)) or 'nothing'} cannot be pooled; give fits of one coefficient")
    rows = {}
    for term in dict.fromkeys(str(name) for fit in fits for name in fit.estimates["term"].values):
        having = [fit.estimates.sel(term=term) for fit in fits if term in fit.estimates["term"].values]
        joined = pool([float(e["estimate"]) for e in having], [float(e["stderr"]) for e in having], method)
        rows[term] = {**vars(joined), "contradictory": joined.contradictory}
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("term")
