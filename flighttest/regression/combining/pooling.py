"""A fit joined with a-priori values (mixed estimation), and the a-priori values that a database
holds for a local model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import xarray as xr
from scipy.stats import chi2 as chi2_distribution

from aerodb.update.observations import basis_at
from aerodb.update.posterior import joint_covariance
from flightmech.errors import IdentificationError, SchemaError, UnknownName
from flightmech.terms import list_model_variables
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.fit_remarks import against_prior
from flighttest.regression.equation_error.model import term_powers, variable_of
from flighttest.remarks import Remark, remark_lines

Prior = Mapping[str, tuple[float, float]] | xr.Dataset


@dataclass(frozen=True)
class Mixed:
    """A fit that has heard a prior.

    Attributes
    ----------
    fit : Fit
        Flight alone, in time or in frequency.
    estimates : Dataset (term, term_)
        ``estimate``, ``stderr``, ``stderr_white`` (as if flight's residuals were white),
        ``covariance``, ``correlation``; ``prior``, ``prior_stderr`` (NaN where none is given);
        ``distance`` = (fit - prior)/sqrt(s_fit^2 + s_prior^2); ``prior_share`` =
        stderr^2/prior_stderr^2.  Attributes: ``chi2`` of the compatibility of fit and prior,
        ``terms_with_prior`` (its degrees of freedom), ``probability`` that it is larger.
    """

    fit: Fit
    estimates: xr.Dataset

    @property
    def remarks(self) -> list[Remark]:
        """Terms whose sign or size contradicts the prior, and those that the flight hardly moves."""
        e = self.estimates
        f, D = self.fit.estimates, self.fit.estimates["systematic"].values
        variance = np.diag(f["covariance"].values + D @ D.T)
        free = f["dof"].values if "dof" in f else np.full(len(variance), np.inf)
        columns = (
            f["estimate"].values,
            variance,
            free,
            e["prior"].values,
            e["prior_stderr"].values,
        )
        found = against_prior(e["term"].values, *columns)
        found += [
            Remark(
                "prior",
                f"{term}: flight and prior differ by {abs(d):.1f} combined standard errors",
                str(term),
                float(d),
                _CONTRADICTION,
            )
            for term, d in zip(e["term"].values, e["distance"].values)
            if abs(d) > _CONTRADICTION
        ]
        own = [
            str(term)
            for term, share in zip(e["term"].values, e["prior_share"].values)
            if share > _UNMOVED
        ]
        if own:
            found.append(
                Remark(
                    "prior",
                    f"hardly moved by the flight: {', '.join(own)}",
                    threshold=_UNMOVED,
                    severity="note",
                )
            )
        if e.attrs["probability"] < _IMPROBABLE:
            words = (
                f"chi2 {e.attrs['chi2']:.1f} of {e.attrs['terms_with_prior']} terms has "
                f"probability {e.attrs['probability']:.1g}"
            )
            found.append(
                Remark(
                    "prior",
                    f"{words}: prior or fit is overconfident",
                    "",
                    e.attrs["probability"],
                    _IMPROBABLE,
                )
            )
        return found

    def report(self) -> str:
        """Return flight, prior and both as a text table."""
        e, f = self.estimates, self.fit.estimates
        title = (
            f"{self.fit.name}: {self.fit.model}, with prior"
            if self.fit.name
            else f"{self.fit.model}, with prior"
        )
        text = [
            title,
            f"chi2 {e.attrs['chi2']:.1f} of {e.attrs['terms_with_prior']} terms, probability "
            f"{e.attrs['probability']:.2g}",
            f"{'term':<18}{'estimate':>11}{'stderr':>10}{'flight':>11}{'stderr':>10}{'prior':>11}{'stderr':>10}{'apart':>7}{'share':>7}",
        ]
        for k, term in enumerate(e["term"].values):
            numbers = (
                e["estimate"],
                e["stderr"],
                f["estimate"],
                f["stderr"],
                e["prior"],
                e["prior_stderr"],
            )
            cells = [
                f"{float(x[k]):>{w}.{d}g}" for x, w, d in zip(numbers, (11, 10) * 3, (5, 2) * 3)
            ]
            text.append(
                f"{term!s:<18}{''.join(cells)}{float(e['distance'][k]):>7.1f}{float(e['prior_share'][k]):>7.2f}".replace(
                    "nan", "  -"
                )
            )
        return "\n".join([*text, *remark_lines(self.remarks)])


_CONTRADICTION = 3.0
_IMPROBABLE = 0.01
_UNMOVED = 0.81  # share of the prior's variance that is left: a standard error above 0.9 of it


def mix_with_prior(fit: Fit, prior: Prior) -> Mixed:
    """Return the estimates that join a fit with a-priori values (mixed estimation).

    Parameters
    ----------
    fit : Fit
        Least squares in time or in frequency, of one manoeuvre or many, with its coloured
        covariance.
    prior : mapping of str to (value, stderr), or Dataset
        Of some or all terms; a Dataset as `prior_of` returns it.

    Raises
    ------
    UnknownName
        A prior of a term that the fit does not have.
    IdentificationError
        A prior standard error that is not positive.

    References
    ----------
    .. [Theil1961] Theil, Goldberger, Int. Econ. Rev. 2, 1961.
    """

    terms = [str(term) for term in fit.estimates["term"].values]
    chosen, value, P = _prior(prior, terms)
    theta, C = fit.estimates["estimate"].values, total_covariance(fit.estimates)
    S = C[np.ix_(chosen, chosen)] + P
    gain = C[:, chosen] @ np.linalg.inv(S)
    innovation = value - theta[chosen]
    covariance = _updated(C, gain, chosen, P)
    statistic = float(innovation @ np.linalg.solve(S, innovation))
    given, sd = np.full(len(terms), np.nan), np.full(len(terms), np.nan)
    given[chosen], sd[chosen] = value, np.sqrt(np.diag(P))
    W = _scaled(C, fit.estimates["stderr_white"].values)
    white = _updated(W, W[:, chosen] @ np.linalg.inv(W[np.ix_(chosen, chosen)] + P), chosen, P)
    more = {
        "prior": ("term", given),
        "prior_stderr": ("term", sd),
        "distance": ("term", (theta - given) / np.sqrt(np.diag(C) + sd**2)),
        "prior_share": ("term", np.diag(covariance) / sd**2),
    }
    nothing: tuple[list[str], np.ndarray] = ([], np.zeros((len(terms), 0)))
    found = least_squares.regression_estimates(
        terms, theta + gain @ innovation, covariance, np.sqrt(np.diag(white)), nothing, more
    )
    found.attrs = {
        "chi2": statistic,
        "terms_with_prior": len(chosen),
        "probability": float(chi2_distribution.sf(statistic, max(len(chosen), 1))),
    }
    return Mixed(fit, found)


def prior_of(fit: Fit, database: xr.DataTree) -> xr.Dataset:
    """Return what a database states the terms of a fit should be: DATCOM as the prior of a local
    model.

    A table is not a slope: what least squares makes of the tables depends on the samples.  So the
    tables are evaluated at the samples of the fit and sent through the same linear map as the
    measurements, theta = A B g.

    Parameters
    ----------
    fit : Fit
        Of the manoeuvre the prior is wanted for.
    database : DataTree
        With standard errors; those of the nodes are correlated as `aerodb.tabulate` has it.

    Returns
    -------
    Dataset (term, term_)
        ``estimate``, ``stderr``, ``covariance``, ``correlation`` of the terms the tables speak of:
        a term whose variable no table of the coefficient knows has no prior here.

    Raises
    ------
    SchemaError
        A term of the coefficient without standard errors.
    UnknownName
        The database has no such coefficient, or the samples lack a variable of its tables.
    """

    coefficient = fit.model.coefficient
    if coefficient not in database.children:
        raise UnknownName(
            coefficient, map(str, database.children), "coefficient", "the database does not hold it"
        )
    leaves = {
        f"{coefficient}/{name}": node.to_dataset(inherit=False)
        for name, node in database[coefficient].children.items()
    }
    if without_error := [
        f"{name} has no stderr" for name, leaf in leaves.items() if "stderr" not in leaf
    ]:
        raise SchemaError("database as a prior", without_error)
    A = least_squares.estimator_matrix(fit.design.values)
    H = np.hstack([(basis_at(leaf, fit.data).T @ A.T).T for leaf in leaves.values()])
    theta = H @ np.concatenate([leaf["value"].values.ravel() for leaf in leaves.values()])
    C = H @ joint_covariance(leaves)[1] @ H.T
    known = set().union(*(list_model_variables(leaf) for leaf in leaves.values()))
    terms = [str(term) for term in fit.estimates["term"].values]
    spoken = [
        least_squares.intercept_mask([term])[0]
        or {variable_of(factor) for factor in term_powers(term)} <= known
        for term in terms
    ]
    spoken = [bool(s) and C[k, k] > 0 for k, s in enumerate(spoken)]
    names = [term for term, s in zip(terms, spoken) if s]
    nothing: tuple[list[str], np.ndarray] = ([], np.zeros((len(names), 0)))
    P = C[np.ix_(spoken, spoken)]
    found = least_squares.regression_estimates(
        names, theta[spoken], P, np.sqrt(np.diag(P)), nothing, {}
    )
    return found[["estimate", "stderr", "covariance", "correlation"]].assign_attrs(
        coefficient=coefficient
    )


def total_covariance(estimates: xr.Dataset) -> np.ndarray:
    """Return coloured plus systematic covariance of the estimates, (term, term_)."""
    D = estimates["systematic"].values
    return estimates["covariance"].values + D @ D.T


def _prior(prior: Prior, terms: list[str]) -> tuple[list[int], np.ndarray, np.ndarray]:
    """Places of the terms with a prior, its values and covariance."""
    names = (
        [str(name) for name in prior["term"].values]
        if isinstance(prior, xr.Dataset)
        else list(prior)
    )
    for name in names:
        if name not in terms:
            raise UnknownName(name, terms, "term", "the prior must belong to a term of the fit")
    if isinstance(prior, xr.Dataset):
        value, P = prior["estimate"].values, prior["covariance"].values
    else:
        pairs = np.array([prior[name] for name in names], float).reshape(-1, 2)
        value, P = pairs[:, 0], np.diag(pairs[:, 1]) * np.abs(pairs[:, 1])
    if not (np.diag(P) > 0).all():
        raise IdentificationError(
            "a prior standard error is not positive; give one above zero, or leave the term "
            "out of the model to hold it"
        )
    return [terms.index(name) for name in names], value, P


def _updated(C: np.ndarray, gain: np.ndarray, chosen: list[int], P: np.ndarray) -> np.ndarray:
    """Return the covariance with the prior, a sum of squares (Joseph's form): C - gain C rounds to
    negative variances.
    """
    left = np.eye(len(C))
    left[:, chosen] -= gain
    return left @ C @ left.T + gain @ P @ gain.T


def _scaled(C: np.ndarray, stderr: np.ndarray) -> np.ndarray:
    """The same correlations with other standard errors."""
    own = np.sqrt(np.diag(C))
    scale = stderr / np.where(own > 0, own, 1.0)
    return C * np.outer(scale, scale)


METHODS = ("inverse_variance", "median", "inverse_sigma")
DISAGREEMENT = (
    3.0  # combined standard errors between two estimates that should not be averaged silently
)


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
        sum((theta - mean)^2/s^2) about the inverse-variance mean; about `count` - 1 when the
        estimates agree.
    birge : float
        sqrt(chi2/(count - 1)); above one the standard error of the inverse-variance mean has been
        multiplied by it.
    scatter_ratio : float
        `scatter` over the mean standard error; 0.7 to 1.4 is sound.
    disagreement : float
        Largest difference of two estimates in combined standard errors; above 3 they contradict
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
    """Join independent estimates of one parameter.

    Parameters
    ----------
    values, stderr : array (estimates,)
        Estimates and their standard errors, positive.
    method : {"inverse_variance", "median", "inverse_sigma"}
        Weights 1/s^2, with the Birge ratio; the median, with 1.25 scatter/sqrt(n) for its error;
        weights 1/s and error sqrt(n)/sum(1/s), as some papers do (to reproduce their tables, not to
        be preferred).

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
    n = len(theta)
    w = 1.0 / s**2
    mean = float(w @ theta / w.sum())
    chi2 = float(w @ (theta - mean) ** 2)
    birge = float(np.sqrt(chi2 / (n - 1))) if n > 1 else 0.0
    scatter = float(1.4826 * np.median(np.abs(theta - np.median(theta))))
    if method == "inverse_variance":
        value, error = mean, max(1.0, birge) / np.sqrt(w.sum())
    elif method == "median":
        value, error = (
            float(np.median(theta)),
            1.25 * scatter / np.sqrt(n) if n > 2 else float(np.sqrt((s**2).mean() / n)),
        )
    else:
        value, error = float((theta / s).sum() / (1.0 / s).sum()), np.sqrt(n) / (1.0 / s).sum()
    apart = np.abs(theta[:, None] - theta) / np.hypot(s[:, None], s)
    return Pooled(
        value, float(error), scatter, chi2, birge, scatter / float(s.mean()), float(apart.max()), n
    )


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
        One row per term: the attributes of `Pooled` and ``contradictory``.  Systematic errors are
        common to the fits and not in these standard errors.

    Raises
    ------
    IdentificationError
        Fits of different coefficients.
    """

    if len(found := {fit.model.coefficient for fit in fits}) != 1:
        raise IdentificationError(
            f"fits of {', '.join(sorted(found)) or 'nothing'} cannot be pooled; give fits of "
            f"one coefficient"
        )
    rows = {}
    for term in dict.fromkeys(str(name) for fit in fits for name in fit.estimates["term"].values):
        having = [
            fit.estimates.sel(term=term) for fit in fits if term in fit.estimates["term"].values
        ]
        joined = pool(
            [float(e["estimate"]) for e in having], [float(e["stderr"]) for e in having], method
        )
        rows[term] = {**vars(joined), "contradictory": joined.contradictory}
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("term")
