"""Joint estimates from the fits of several manoeuvres.

The manoeuvres must be independent. The median is insensitive to a faulty record. Weights by the
inverse covariance are the most accurate ones if all standard errors are correct.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

import aerodb
from flightmech import terms as _terms
from flightmech.errors import UnknownName
from flighttest.parameter_constraints import demand_unconstrained
from flighttest.regression.combining.pooling import (
    METHODS,
    common_coefficient,
    list_terms,
    pool_term,
)
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.samples import (
    RegressionSamples,
    list_manoeuvres,
    stack_samples,
)
from flighttest.regression.uncertainty.coloured_residuals import coloured_covariance_of
from flighttest.remarks import PrintedResult, Remark, TabledEstimates

_DISAGREEMENT = 3.0  # combined standard errors between two fits that are remarked
# standard deviation of a scaled median absolute deviation over its value, times the root of the
# number
_LOOSE = 1.17
_FEWEST = 5  # fits from which on their scatter is judged
_POOLED = ("scatter", "scatter_ratio", "chi2", "birge", "disagreement")  # figures of a term


def table_samples(
    coefficient: str, database: xr.DataTree, data: xr.Dataset | Sequence[xr.Dataset], name: str = ""
) -> xr.Dataset:
    """Return the samples of manoeuvres for `aerodb.update.regress_tables`.

    Parameters
    ----------
    coefficient : str
        Such as ``"CL"``.
    database : DataTree
        Its terms of the coefficient contain the variables.
    data : Dataset (time,) or sequence of them
        Manoeuvres of one disturbance; from `flighttest.coefficients`. [SI]
    name : str
        Name in reports.

    Returns
    -------
    Dataset (sample,)
        Coefficient, variables, ``time``, ``manoeuvre``, the common errors of the coefficient and of
        the variables; attributes ``coefficient``, ``name`` and ``steps``, the sampling interval of
        each manoeuvre [s].

    Raises
    ------
    IdentificationError
        No manoeuvre, or a manoeuvre whose time does not rise.
    UnknownName
        The database has no term of the coefficient, or a manoeuvre does not hold it.
    """
    variables: set[str] = set()
    coefficients: set[str] = set()
    for term, leaf in aerodb.terms(database).items():
        coefficients.add(term.split("/")[0])
        if term.startswith(f"{coefficient}/"):
            variables.update(_terms.list_model_variables(leaf))
    if coefficient not in coefficients:
        raise UnknownName(coefficient, coefficients, "coefficient")
    manoeuvres = list_manoeuvres(data)
    in_error = []
    for variable in sorted(variables):
        if manoeuvres and all(f"{variable}_error" in manoeuvre for manoeuvre in manoeuvres):
            in_error.append(variable)
    samples = stack_samples(
        coefficient, in_error, manoeuvres, purpose=f"the terms of {coefficient}"
    )
    return samples.data.assign_attrs(coefficient=coefficient, name=name, steps=samples.steps)


def coloured_covariance(samples: xr.Dataset, X: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the covariance of a least-squares estimate whose residuals are correlated in time.

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
    return coloured_covariance_of(X, v, pieces=pieces, steps=steps).covariance


@dataclass(frozen=True)
class Joined(PrintedResult, TabledEstimates):
    """Joint estimates from several fits of one coefficient.

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
        """Terms whose fits contradict each other, or whose scatter contradicts the stderr."""
        e = self.estimates
        remarks = []
        for term in e["term"].values:
            row = e.sel(term=term)
            disagreement = float(row["disagreement"])
            if disagreement > _DISAGREEMENT:
                text = f"{term}: two fits are {disagreement:.1f} combined standard errors apart"
                remarks.append(Remark("scatter", text, str(term), disagreement, _DISAGREEMENT))
            # The limits are two standard deviations of the scatter of `count` estimates.
            ratio, count = float(row["scatter_ratio"]), int(row["count"])
            high = 1.0 + 2.0 * _LOOSE / np.sqrt(count)
            low = 1.0 / high
            if count >= _FEWEST and not low <= ratio <= high:
                text = (
                    f"{term}: the fits scatter {ratio:.1f} times as much as their standard "
                    f"errors indicate"
                )
                limit = high if ratio > 1.0 else low
                remarks.append(Remark("scatter", text, str(term), ratio, limit))
        return remarks

    def report_lines(self) -> list[str]:
        """Return the joint estimates as lines."""
        e = self.estimates
        lines = [
            f"{self.name or self.coefficient}: {e.attrs['fits']} fits joined by "
            f"{self.method.replace('_', ' ')}",
            f"{'term':<18}{'estimate':>11}{'stderr':>10}{'white':>10}{'scatter':>10}{'ratio':>7}"
            f"{'Birge':>7}{'apart':>7}{'fits':>6}",
        ]
        # One row per term, below the headings.
        for k, term in enumerate(e["term"].values):
            lines.append(
                f"{term!s:<18}{float(e['estimate'][k]):>11.5g}{float(e['stderr'][k]):>10.2g}"
                f"{float(e['stderr_white'][k]):>10.2g}{float(e['scatter'][k]):>10.2g}"
                f"{float(e['scatter_ratio'][k]):>7.2f}{float(e['birge'][k]):>7.2f}"
                f"{float(e['disagreement'][k]):>7.1f}{float(e['count'][k]):>6.0f}"
            )
        return lines


def join_fits(fits: Sequence[Fit], method: str = "inverse_variance", name: str = "") -> Joined:
    """Join the fits of one coefficient, in time or in frequency.

    Parameters
    ----------
    fits : sequence of Fit
        Fits of one coefficient, at comparable conditions. Not all of them need every term.
    method : {"inverse_variance", "median", "inverse_sigma"}
        Weights by the inverse of the full covariances, with standard errors inflated by each term's
        Birge ratio; the median with 1.25 scatter/sqrt(n) [Gresham]_, from eight fits on as
        published; weights 1/sigma. See `pool`.
    name : str
        Name in reports.

    Returns
    -------
    Joined

    Raises
    ------
    IdentificationError
        No fit, or fits of different coefficients.

    Notes
    -----
    Medians have the correlation of the inverse-variance mean. Common errors of the measurement do
    not average out: `systematic` is their mean.

    References
    ----------
    .. [Gresham] Gresham, Simmons, Hopwood, Woolsey, Spin aerodynamic modeling for a fixed-wing
       aircraft, IV.C (median, scaled median absolute deviation).
    """
    if method not in METHODS:
        raise ValueError(f"method is {method!r}; allowed: {', '.join(METHODS)}")
    coefficient = common_coefficient(fits, "joined")
    for fit in fits:
        demand_unconstrained(str(fit.estimates.attrs.get("constraints", "")), "joined fits")
    terms = list_terms(fits)
    pooled = [pool_term(fits, term, method) for term in terms]
    white = []
    for term in terms:
        white.append(pool_term(fits, term, method, stderr_name="stderr_white").stderr)
    theta, C, systematic = _generalised_mean(fits, terms)
    if method == "inverse_variance":
        inflation = np.array([max(1.0, item.birge) for item in pooled])
        C = C * np.outer(inflation, inflation)
    else:
        # The correlations of the inverse-variance mean with the standard errors of the method.
        theta = np.array([item.value for item in pooled])
        stderr = np.array([item.stderr for item in pooled])
        C = C * np.outer(stderr, stderr) / np.sqrt(np.outer(np.diag(C), np.diag(C)))
    variables: dict[str, Any] = {}
    for key in _POOLED:
        variables[key] = "term", np.array([getattr(item, key) for item in pooled], float)
    variables["count"] = "term", np.array([item.count for item in pooled])
    estimates = least_squares.regression_estimates(
        terms,
        theta,
        covariance=C,
        white=np.array(white),
        systematic=systematic,
        extra=variables,
    )
    estimates.attrs = {
        "coefficient": coefficient,
        "name": name,
        "method": method,
        "fits": len(fits),
    }
    return Joined(name, coefficient, method=method, estimates=estimates)


def _generalised_mean(
    fits: Sequence[Fit], terms: list[str]
) -> tuple[np.ndarray, np.ndarray, tuple[list[str], np.ndarray]]:
    """Return the generalised mean of all terms, its covariance, and its common errors."""
    names: dict[str, None] = {}
    for fit in fits:
        names.update(dict.fromkeys(map(str, fit.estimates["error"].values)))
    sources = list(names)
    # theta = (sum C_i^-1)^-1 sum C_i^-1 theta_i; the changes by common errors have the same mean.
    information = np.zeros((len(terms), len(terms)))
    weighted_sum = np.zeros((len(terms), 1 + len(sources)))
    for fit in fits:
        e = fit.estimates
        rows = [terms.index(str(term)) for term in e["term"].values]
        stderr = e["stderr"].values
        inverse = np.linalg.inv(e["correlation"].values) / np.outer(stderr, stderr)
        source_columns = [1 + sources.index(str(source)) for source in e["error"].values]
        columns = np.zeros((len(rows), 1 + len(sources)))
        columns[:, 0] = e["estimate"].values
        columns[:, source_columns] = e["systematic"].values
        information[np.ix_(rows, rows)] += inverse
        weighted_sum[rows] += inverse @ columns
    # The information is scaled to a unit diagonal before it is inverted.
    scale = 1.0 / np.sqrt(np.diag(information))
    C = np.linalg.inv(information * np.outer(scale, scale)) * np.outer(scale, scale)
    means = C @ weighted_sum
    return means[:, 0], C, (sources, means[:, 1:])
