"""Mixed estimation: a fit combined with a-priori values, such as those of a database.

References
----------
.. [Theil1961] Theil, Goldberger, Int. Econ. Rev. 2, 1961.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy
import xarray as xr

from aerodb.update.observations import basis_at
from aerodb.update.posterior import joint_covariance
from flightmech.errors import IdentificationError, SchemaError, UnknownName
from flightmech.terms import list_model_variables
from flighttest.parameter_constraints import demand_unconstrained
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.fit_remarks import against_prior
from flighttest.regression.equation_error.model import term_powers, variable_of
from flighttest.remarks import PrintedResult, Remark, TabledEstimates

Prior = Mapping[str, tuple[float, float]] | xr.Dataset

_CONTRADICTION = 3.0  # combined standard errors between fit and prior that are remarked
_IMPROBABLE = 0.01  # probability of chi2 below which prior or fit is overconfident
_UNMOVED = 0.81  # share of the prior's variance above which a term is hardly moved: 0.9 of stderr


@dataclass(frozen=True)
class Mixed(PrintedResult, TabledEstimates):
    """A fit combined with a-priori values.

    Attributes
    ----------
    fit : Fit
        Flight alone, in time or in frequency.
    estimates : Dataset (term, term_)
        ``estimate``, ``stderr``, ``stderr_white`` (for white residuals of the flight),
        ``covariance``, ``correlation``; ``prior``, ``prior_stderr`` (NaN without a prior);
        ``distance`` = (fit - prior)/sqrt(s_fit^2 + s_prior^2); ``prior_share`` =
        stderr^2/prior_stderr^2. Attributes: ``chi2`` of the compatibility of fit and prior,
        ``terms_with_prior`` (its degrees of freedom), ``probability`` that it is larger.
    """

    fit: Fit
    estimates: xr.Dataset

    @property
    def remarks(self) -> list[Remark]:
        """Terms that contradict the prior, and terms that the flight hardly moves."""
        e = self.estimates
        remarks = self._sign_remarks()
        for term, distance in zip(e["term"].values, e["distance"].values):
            if abs(distance) > _CONTRADICTION:
                text = (
                    f"{term}: flight and prior differ by {abs(distance):.1f} combined "
                    f"standard errors"
                )
                remarks.append(Remark("prior", text, str(term), float(distance), _CONTRADICTION))
        is_unmoved = e["prior_share"].values > _UNMOVED
        unmoved = [str(term) for term in e["term"].values[is_unmoved]]
        if unmoved:
            text = f"hardly moved by the flight: {', '.join(unmoved)}"
            remarks.append(Remark("prior", text, threshold=_UNMOVED, severity="note"))
        probability = e.attrs["probability"]
        if probability < _IMPROBABLE:
            text = (
                f"chi2 {e.attrs['chi2']:.1f} of {e.attrs['terms_with_prior']} terms has "
                f"probability {probability:.1g}: prior or fit is overconfident"
            )
            remarks.append(Remark("prior", text, "", probability, _IMPROBABLE))
        return remarks

    def _sign_remarks(self) -> list[Remark]:
        """Return terms whose sign contradicts the prior."""
        e, flight = self.estimates, self.fit.estimates
        D = flight["systematic"].values
        variance = np.diag(flight["covariance"].values + D @ D.T)
        dof = np.full(len(variance), np.inf)
        if "dof" in flight:
            dof = flight["dof"].values
        return against_prior(
            e["term"].values,
            estimate=flight["estimate"].values,
            variance=variance,
            dof=dof,
            prior=e["prior"].values,
            prior_stderr=e["prior_stderr"].values,
        )

    def report_lines(self) -> list[str]:
        """Return flight, prior and their combination as lines."""
        e, flight = self.estimates, self.fit.estimates
        name = f"{self.fit.name}: " if self.fit.name else ""
        lines = [
            f"{name}{self.fit.model}, with prior",
            f"chi2 {e.attrs['chi2']:.1f} of {e.attrs['terms_with_prior']} terms, probability "
            f"{e.attrs['probability']:.2g}",
            f"{'term':<18}{'estimate':>11}{'stderr':>10}{'flight':>11}{'stderr':>10}{'prior':>11}"
            f"{'stderr':>10}{'apart':>7}{'share':>7}",
        ]
        pairs = (
            (e["estimate"], e["stderr"]),
            (flight["estimate"], flight["stderr"]),
            (e["prior"], e["prior_stderr"]),
        )
        for k, term in enumerate(e["term"].values):
            line = f"{term!s:<18}"
            for value, stderr in pairs:
                line += f"{float(value[k]):>11.5g}{float(stderr[k]):>10.2g}"
            line += f"{float(e['distance'][k]):>7.1f}{float(e['prior_share'][k]):>7.2f}"
            # A term without a prior has no numbers of one.
            lines.append(line.replace("nan", "  -"))
        return lines


def mix_with_prior(fit: Fit, prior: Prior) -> Mixed:
    """Return the estimates that combine a fit with a-priori values [Theil1961]_.

    Parameters
    ----------
    fit : Fit
        Least squares in time or in frequency, of one manoeuvre or many, with its coloured
        covariance.
    prior : mapping of str to (value, stderr), or Dataset
        Priors of some or all terms; a Dataset as `prior_of` returns it.

    Raises
    ------
    UnknownName
        A prior of a term that the fit does not have.
    IdentificationError
        A prior standard error that is not positive.

    Notes
    -----
    With the fit theta and its total covariance C, the prior values theta_0 and their covariance P,
    theta + C (C + P)^-1 (theta_0 - theta), in the rows and columns of the terms with a prior.
    """
    demand_unconstrained(str(fit.estimates.attrs.get("constraints", "")), "fit with a prior")
    terms = [str(term) for term in fit.estimates["term"].values]
    rows, value, P = _read_prior(prior, terms)
    theta, C = fit.estimates["estimate"].values, total_covariance(fit.estimates)
    S = C[np.ix_(rows, rows)] + P
    gain = C[:, rows] @ np.linalg.inv(S)
    innovation = value - theta[rows]
    covariance = _update_covariance(C, gain, rows=rows, P=P)
    # chi2 of the compatibility of fit and prior
    statistic = float(innovation @ np.linalg.solve(S, innovation))
    W = _replace_stderr(C, fit.estimates["stderr_white"].values)
    white_gain = W[:, rows] @ np.linalg.inv(W[np.ix_(rows, rows)] + P)
    white = _update_covariance(W, white_gain, rows=rows, P=P)
    prior_value, prior_stderr = np.full(len(terms), np.nan), np.full(len(terms), np.nan)
    prior_value[rows], prior_stderr[rows] = value, np.sqrt(np.diag(P))
    variables = {
        "prior": ("term", prior_value),
        "prior_stderr": ("term", prior_stderr),
        "distance": ("term", (theta - prior_value) / np.sqrt(np.diag(C) + prior_stderr**2)),
        "prior_share": ("term", np.diag(covariance) / prior_stderr**2),
    }
    estimates = least_squares.regression_estimates(
        terms,
        theta + gain @ innovation,
        covariance=covariance,
        white=np.sqrt(np.diag(white)),
        systematic=_no_systematic(len(terms)),
        extra=variables,
    )
    estimates.attrs = {
        "chi2": statistic,
        "terms_with_prior": len(rows),
        "probability": float(scipy.stats.chi2.sf(statistic, max(len(rows), 1))),
    }
    return Mixed(fit, estimates)


def prior_of(fit: Fit, database: xr.DataTree) -> xr.Dataset:
    """Return the prior of a fit's terms from a database, such as one of DATCOM.

    A table is not a slope: the least-squares estimate from the tables depends on the samples. The
    tables g are therefore evaluated at the samples of the fit, B g. The linear map of the
    measurements is applied to the result, theta = A B g.

    Parameters
    ----------
    fit : Fit
        Fit of the manoeuvre.
    database : DataTree
        Database with standard errors. Those of the nodes are correlated as in `aerodb.tabulate`.

    Returns
    -------
    Dataset (term, term_)
        ``estimate``, ``stderr``, ``covariance``, ``correlation`` of the terms that the tables
        describe. A term with a variable that no table of the coefficient contains has no prior.

    Raises
    ------
    SchemaError
        A term of the coefficient without standard errors.
    UnknownName
        The database has no such coefficient, or the samples lack a variable of its tables.
    """
    coefficient = fit.model.coefficient
    leaves = _read_leaves(database, coefficient)
    A = least_squares.estimator_matrix(fit.design.values)
    # H = A B, (terms, nodes): the map from the nodes of all tables to the estimates
    H = np.hstack([(basis_at(leaf, fit.data).T @ A.T).T for leaf in leaves.values()])
    theta = H @ np.concatenate([leaf["value"].values.ravel() for leaf in leaves.values()])
    C = H @ joint_covariance(leaves)[1] @ H.T
    variables: set[str] = set()
    for leaf in leaves.values():
        variables.update(list_model_variables(leaf))
    terms = [str(term) for term in fit.estimates["term"].values]
    rows = []
    for k, term in enumerate(terms):
        if C[k, k] > 0 and _is_described(term, variables):
            rows.append(k)
    names = [terms[k] for k in rows]
    P = C[np.ix_(rows, rows)]
    estimates = least_squares.regression_estimates(
        names,
        theta[rows],
        covariance=P,
        white=np.sqrt(np.diag(P)),
        systematic=_no_systematic(len(names)),
        extra={},
    )
    columns = ["estimate", "stderr", "covariance", "correlation"]
    return estimates[columns].assign_attrs(coefficient=coefficient)


def _read_leaves(database: xr.DataTree, coefficient: str) -> dict[str, xr.Dataset]:
    """Return the terms of a coefficient; raise if one has no standard errors."""
    if coefficient not in database.children:
        raise UnknownName(
            coefficient, map(str, database.children), "coefficient", "the database does not hold it"
        )
    leaves, problems = {}, []
    for name, node in database[coefficient].children.items():
        leaf = node.to_dataset(inherit=False)
        leaves[f"{coefficient}/{name}"] = leaf
        if "stderr" not in leaf:
            problems.append(f"{coefficient}/{name} has no stderr")
    if problems:
        raise SchemaError("database as a prior", problems)
    return leaves


def _is_described(term: str, variables: set[str]) -> bool:
    """Return whether tables over `variables` describe a term of a local model."""
    if least_squares.intercept_mask([term])[0]:
        return True
    return {variable_of(factor) for factor in term_powers(term)} <= variables


def total_covariance(estimates: xr.Dataset) -> np.ndarray:
    """Return coloured plus systematic covariance of the estimates, (term, term_)."""
    D = estimates["systematic"].values
    return estimates["covariance"].values + D @ D.T


def _no_systematic(terms: int) -> tuple[list[str], np.ndarray]:
    """Return the systematic changes of estimates without common errors."""
    return [], np.zeros((terms, 0))


def _read_prior(prior: Prior, terms: list[str]) -> tuple[list[int], np.ndarray, np.ndarray]:
    """Return the rows of the terms with a prior, the prior values and their covariance."""
    if isinstance(prior, xr.Dataset):
        names = [str(name) for name in prior["term"].values]
        value, P = prior["estimate"].values, prior["covariance"].values
    else:
        names = list(prior)
        pairs = np.array([prior[name] for name in names], float).reshape(-1, 2)
        # s |s| keeps the sign of a negative standard error, which is refused below
        value, P = pairs[:, 0], np.diag(pairs[:, 1]) * np.abs(pairs[:, 1])
    for name in names:
        if name not in terms:
            raise UnknownName(name, terms, "term", "the prior must belong to a term of the fit")
    if not (np.diag(P) > 0).all():
        raise IdentificationError(
            "a prior standard error is not positive; give one above zero, or leave the term "
            "out of the model to hold it"
        )
    return [terms.index(name) for name in names], value, P


def _update_covariance(
    C: np.ndarray, gain: np.ndarray, rows: list[int], P: np.ndarray
) -> np.ndarray:
    """Return the covariance with the prior in Joseph's form, (I - K H) C (I - K H)' + K P K'."""
    # The form is a sum of squares: C - gain C would round to negative variances.
    complement = np.eye(len(C))
    complement[:, rows] -= gain
    return complement @ C @ complement.T + gain @ P @ gain.T


def _replace_stderr(C: np.ndarray, stderr: np.ndarray) -> np.ndarray:
    """Return a covariance with the correlations of C and other standard errors."""
    deviations = np.sqrt(np.diag(C))
    scale = stderr / np.where(deviations > 0, deviations, 1.0)
    return C * np.outer(scale, scale)
