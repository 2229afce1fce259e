"""Fits of several manoeuvres joined into one set of estimates.

The manoeuvres must be independent.  The median is deaf to a record that went wrong; the inverse
covariance is the most exact when all fits deserve their standard errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

import aerodb
from flightmech import terms as _terms
from flightmech.errors import IdentificationError, UnknownName
from flighttest.regression.combining.pooling import METHODS, Pooled, pool
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.samples import RegressionSamples, stack_samples
from flighttest.regression.uncertainty.coloured_residuals import coloured_covariance_of
from flighttest.remarks import Remark, remark_lines


def table_samples(
    coefficient: str, database: xr.DataTree, data: xr.Dataset | Sequence[xr.Dataset], name: str = ""
) -> xr.Dataset:
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
        Coefficient, variables, ``time``, ``manoeuvre``, the common errors of the coefficient and of
        the variables; attributes ``coefficient``, ``name`` and ``steps``, the sampling interval of
        each manoeuvre [s].

    Raises
    ------
    IdentificationError
        No manoeuvre, or one whose time does not rise.
    UnknownName
        The database has no term of the coefficient, or a manoeuvre does not hold it.
    """
    mine = [
        leaf for term, leaf in aerodb.terms(database).items() if term.startswith(f"{coefficient}/")
    ]
    if not mine:
        raise UnknownName(
            coefficient, {term.split("/")[0] for term in aerodb.terms(database)}, "coefficient"
        )
    manoeuvres = [data] if isinstance(data, xr.Dataset) else list(data)
    needed = {variable for leaf in mine for variable in _terms.list_model_variables(leaf)}
    in_error = sorted(
        variable
        for variable in needed
        if manoeuvres and all(f"{variable}_error" in one for one in manoeuvres)
    )
    samples = stack_samples(coefficient, in_error, manoeuvres, f"the terms of {coefficient}")
    return samples.data.assign_attrs(coefficient=coefficient, name=name, steps=samples.steps)


def coloured_covariance(samples: xr.Dataset, X: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the covariance of a least-squares estimate from samples whose residuals are correlated
    in time.

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
    pieces, steps = RegressionSamples(samples, list(samples.attrs["steps"])).pieces()
    return coloured_covariance_of(X, v, pieces, steps).covariance


_DISAGREEMENT = 3.0
# standard deviation of a scaled median absolute deviation over its value, times the root of the
# number
_LOOSE = 1.17


@dataclass(frozen=True)
class Joined:
    """Several fits of one coefficient joined.

    Attributes
    ----------
    name, coefficient, method : str
    estimates : Dataset (term, term_)
        ``estimate``, ``stderr``, ``stderr_white`` (the same rule applied to the white standard
        errors), ``covariance``, ``correlation``, ``systematic``; of each term ``scatter`` (scaled
        median absolute deviation: twice it is the published 95 % bound of single records),
        ``scatter_ratio``, ``chi2``, ``birge``, ``disagreement``, ``count``.
    """

    name: str
    coefficient: str
    method: str
    estimates: xr.Dataset

    @property
    def remarks(self) -> list[Remark]:
        """Terms whose fits contradict each other, or scatter otherwise than their standard errors
        indicate.
        """
        e = self.estimates
        found = []
        for term in e["term"].values:
            row = e.sel(term=term)
            if float(row["disagreement"]) > _DISAGREEMENT:
                apart = float(row["disagreement"])
                words = f"{term}: two fits are {apart:.1f} combined standard errors apart"
                found.append(Remark("scatter", words, str(term), apart, _DISAGREEMENT))
            ratio, count = float(row["scatter_ratio"]), int(row["count"])
            loose = 1.0 + 2.0 * _LOOSE / np.sqrt(count)
            if count >= 5 and not 1.0 / loose <= ratio <= loose:
                words = (
                    f"{term}: the fits scatter {ratio:.1f} times as much as their standard "
                    f"errors indicate"
                )
                found.append(
                    Remark(
                        "scatter", words, str(term), ratio, loose if ratio > 1.0 else 1.0 / loose
                    )
                )
        return found

    def report(self) -> str:
        """Return the joined estimates as a text table."""
        e = self.estimates
        text = [
            f"{self.name or self.coefficient}: {e.attrs['fits']} fits joined by "
            f"{self.method.replace('_', ' ')}",
            f"{'term':<18}{'estimate':>11}{'stderr':>10}{'white':>10}{'scatter':>10}{'ratio':>7}{'Birge':>7}{'apart':>7}{'fits':>6}",
        ]
        for term in e["term"].values:
            row = {
                str(name): float(item.sel(term=term))
                for name, item in e.data_vars.items()
                if item.dims == ("term",)
            }
            text.append(
                f"{term!s:<18}{row['estimate']:>11.5g}{row['stderr']:>10.2g}{row['stderr_white']:>10.2g}{row['scatter']:>10.2g}"
                f"{row['scatter_ratio']:>7.2f}{row['birge']:>7.2f}{row['disagreement']:>7.1f}{row['count']:>6.0f}"
            )
        return "\n".join([*text, *remark_lines(self.remarks)])


def join_fits(fits: Sequence[Fit], method: str = "inverse_variance", name: str = "") -> Joined:
    """Join the fits of one coefficient, in time or in frequency.

    Parameters
    ----------
    fits : sequence of Fit
        Of one coefficient, at comparable conditions; a term need not be in all of them.
    method : {"inverse_variance", "median", "inverse_sigma"}
        Weights by the inverse of the whole covariances, errors inflated by each term's Birge ratio;
        the median with 1.25 scatter/sqrt(n); weights 1/sigma.  See `pool`.
    name : str
        For reports.

    Returns
    -------
    Joined

    Raises
    ------
    IdentificationError
        No fit, or fits of different coefficients.

    Notes
    -----
    The correlation of medians is taken as that of the inverse-variance mean.  Common errors of the measurement do not
    average out: `systematic` is the mean of theirs.

    References
    ----------
    .. [Gresham] Gresham, Simmons, Hopwood, Woolsey, Spin aerodynamic modeling for a fixed-wing aircraft, IV.C (median,
       scaled median absolute deviation).
    """
    if method not in METHODS:
        raise ValueError(f"method is {method!r}; allowed: {', '.join(METHODS)}")
    if len(found := {fit.model.coefficient for fit in fits}) != 1:
        raise IdentificationError(
            f"fits of {', '.join(sorted(found)) or 'nothing'} cannot be joined; give fits of "
            f"one coefficient"
        )
    terms = list(dict.fromkeys(str(term) for fit in fits for term in fit.estimates["term"].values))
    single = {term: _pooled(fits, term, "stderr", method) for term in terms}
    white = np.array([_pooled(fits, term, "stderr_white", method).stderr for term in terms])
    theta, C, systematic = _weighted(fits, terms)
    if method == "inverse_variance":
        widen = np.array([max(1.0, single[term].birge) for term in terms])
        C = C * np.outer(widen, widen)
    else:
        theta = np.array([single[term].value for term in terms])
        stderr = np.array([single[term].stderr for term in terms])
        C = C * np.outer(stderr, stderr) / np.sqrt(np.outer(np.diag(C), np.diag(C)))
    more = {
        key: ("term", np.array([getattr(single[term], key) for term in terms], float))
        for key in _SHOWN
    }
    more["count"] = "term", np.array([single[term].count for term in terms])
    estimates = least_squares.regression_estimates(terms, theta, C, white, systematic, more)
    estimates.attrs = {
        "coefficient": found.pop(),
        "name": name,
        "method": method,
        "fits": len(fits),
    }
    return Joined(name, estimates.attrs["coefficient"], method, estimates)


_SHOWN = ("scatter", "scatter_ratio", "chi2", "birge", "disagreement")


def _pooled(fits: Sequence[Fit], term: str, errors: str, method: str) -> Pooled:
    having = [fit.estimates.sel(term=term) for fit in fits if term in fit.estimates["term"].values]
    return pool([float(e["estimate"]) for e in having], [float(e[errors]) for e in having], method)


def _weighted(
    fits: Sequence[Fit], terms: list[str]
) -> tuple[np.ndarray, np.ndarray, tuple[list[str], np.ndarray]]:
    """Generalised mean of all terms together, its covariance, and what the common errors change."""
    sources = list(
        dict.fromkeys(str(source) for fit in fits for source in fit.estimates["error"].values)
    )
    information, pull = np.zeros((len(terms), len(terms))), np.zeros((len(terms), 1 + len(sources)))
    for fit in fits:
        e = fit.estimates
        at = [terms.index(str(term)) for term in e["term"].values]
        sd = e["stderr"].values
        inverse = np.linalg.inv(e["correlation"].values) / np.outer(sd, sd)
        columns = np.zeros((len(at), 1 + len(sources)))
        columns[:, 0] = e["estimate"].values
        columns[:, [1 + sources.index(str(source)) for source in e["error"].values]] = e[
            "systematic"
        ].values
        information[np.ix_(at, at)] += inverse
        pull[at] += inverse @ columns
    scale = 1.0 / np.sqrt(np.diag(information))
    C = np.linalg.inv(information * np.outer(scale, scale)) * np.outer(scale, scale)
    means = C @ pull
    return means[:, 0], C, (sources, means[:, 1:])
