"""A fit joined with a-priori values (mixed estimation)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, UnknownName

from .fit import Fit


def mixed(fit: Fit, prior: Mapping[str, tuple[float, float]]) -> xr.Dataset:
    """Return the estimates that join a fit with a-priori values (mixed estimation).

    Parameters
    ----------
    fit : Fit
        Least squares, with its coloured covariance.
    prior : mapping of str to (value, stderr)
        Of some or all terms.

    Returns
    -------
    Dataset (term, term_)
        ``estimate``, ``stderr``, ``covariance``; ``prior``, ``prior_stderr`` (NaN where none is given); ``distance`` =
        (fit - prior)/sqrt(s_fit^2 + s_prior^2); ``prior_share`` = stderr^2/prior_stderr^2.  Attributes: ``chi2`` of the
        compatibility of fit and prior, ``terms_with_prior`` (its degrees of freedom), ``probability`` that it is larger.

    References
    ----------
    .. [Theil1961] Theil, Goldberger, Int. Econ. Rev. 2, 1961.
    """
    from scipy.stats import chi2 as chi2_distribution

    terms = [str(term) for term in fit.estimates["term"].values]
    for name in prior:
        if name not in terms:
            raise UnknownName(name, terms, "term", "the prior must belong to a term of the fit")
    chosen = [terms.index(name) for name in prior]
    theta, C = fit.estimates["estimate"].values, total_covariance(fit.estimates)
    value, sd = np.full(len(terms), np.nan), np.full(len(terms), np.nan)
    value[chosen], sd[chosen] = np.array([prior[terms[j]] for j in chosen], float).reshape(-1, 2).T
    if chosen and not (sd[chosen] > 0).all():
        raise IdentificationError(
            "a prior standard error is not positive; give one above zero, or leave the term out of the model to hold it"
        )
    S = C[np.ix_(chosen, chosen)] + np.diag(sd[chosen] ** 2)
    gain = C[:, chosen] @ np.linalg.inv(S)
    innovation = value[chosen] - theta[chosen]
    covariance = C - gain @ C[chosen]
    statistic = float(innovation @ np.linalg.solve(S, innovation))
    stderr = np.sqrt(np.diag(covariance))
    found = xr.Dataset(
        {
            "estimate": ("term", theta + gain @ innovation),
            "stderr": ("term", stderr),
            "covariance": (("term", "term_"), covariance),
            "prior": ("term", value),
            "prior_stderr": ("term", sd),
            "distance": ("term", (theta - value) / np.sqrt(np.diag(C) + sd**2)),
            "prior_share": ("term", stderr**2 / sd**2),
        },
        coords={"term": terms, "term_": terms},
    )
    found.attrs = {
        "chi2": statistic,
        "terms_with_prior": len(chosen),
        "probability": float(chi2_distribution.sf(statistic, max(len(chosen), 1))),
    }
    return found


def total_covariance(estimates: xr.Dataset) -> np.ndarray:
    """Return coloured plus systematic covariance of the estimates, (term, term_)."""
    D = estimates["systematic"].values
    return estimates["covariance"].values + D @ D.T
