"""Separable least squares on flight records: linear and shape parameters with their joint
covariance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, UnknownName
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.samples import stack_samples
from flighttest.regression.expressions import Scope, parse_expression
from flighttest.regression.separable.search import (
    SeparableProblem,
    SeparableSolution,
    WeightedMinimum,
    assess_identifiability,
)
from flighttest.regression.separable_model import SeparableModel, ShapeParameter
from flighttest.regression.uncertainty import collinearity


@dataclass(frozen=True)
class SeparableFit:
    """Estimates of models that are nonlinear in few parameters.

    Attributes
    ----------
    name : str
    models : tuple of SeparableModel
        One per measured quantity.
    estimates : Dataset (term, term_, error)
        All coefficients (of several quantities as ``CL: alpha``), then the shape parameters:
        ``estimate``, ``stderr`` (coloured residuals), ``stderr_white``, ``stderr_systematic``,
        ``covariance``, ``correlation``, ``systematic`` as in `Fit`; ``t``, ``narrowed``,
        ``identified``, ``why`` as in `identifiability`; ``condition_index`` (component) and
        ``proportion`` (component, term).  NaN for the errors of a parameter at a bound.
    data : dict of str to Dataset (sample,)
        The samples used, by quantity.
    residuals : dict of str to array (sample,)
        Measured minus fitted, by quantity.
    """

    name: str
    models: tuple[SeparableModel, ...]
    estimates: xr.Dataset
    data: Mapping[str, xr.Dataset]
    residuals: Mapping[str, np.ndarray]

    def value(self, parameter: str) -> tuple[float, float]:
        """Return an estimate and its standard error.

        Raises
        ------
        UnknownName
            No such coefficient or parameter.
        """
        known = [str(term) for term in self.estimates["term"].values]
        if parameter not in known:
            raise UnknownName(parameter, known, "coefficient or parameter")
        one = self.estimates.sel(term=parameter)
        return float(one["estimate"]), float(one["stderr"])

    def derived(self, *texts: str) -> tuple[np.ndarray, np.ndarray]:
        """Return functions of the estimates and their covariance, by first-order propagation.

        Parameters
        ----------
        *texts : str
            Expressions of the estimates; a coefficient is written as its term in brackets:
            ``"[alpha*h_agl^s] / [alpha]"``.

        Returns
        -------
        values : array (texts,)
        covariance : array (texts, texts)
            NaN where an estimate without standard error takes part.

        Raises
        ------
        UnknownName
            A name that is no estimate.
        ParseError
            What is no expression.
        """
        names = [str(term) for term in self.estimates["term"].values]
        scope = Scope({}, dict(zip(names, self.estimates["estimate"].values)))
        found = [parse_expression(text).at(scope) for text in texts]
        G = np.array([[float(one.by.get(name, 0.0)) for name in names] for one in found])
        C = self.estimates["covariance"].values
        unknown = np.isnan(np.diag(C))
        covariance = G @ np.where(unknown[:, None] | unknown, 0.0, C) @ G.T
        lost = (G[:, unknown] != 0.0).any(axis=1)
        covariance[lost] = covariance[:, lost] = np.nan
        return np.array([float(one.value) for one in found]), covariance

    @property
    def remarks(self) -> list[str]:
        """Parameters that the data cannot see, and those that they hardly distinguish, in words."""
        e = self.estimates
        found = [
            f"{term}: not identified: {why}"
            for term, why in zip(e["term"].values, e["why"].values)
            if why
        ]
        found += [
            f"condition index {index:.0f}: hardly distinguishable are {words}"
            for index, words in collinearity.collinear_terms(e)
        ]
        return found

    def report(self) -> str:
        """Return the estimates as a text table."""
        e, a = self.estimates, self.estimates.attrs
        fitted = zip(
            self.models,
            np.atleast_1d(a["R2"]),
            np.atleast_1d(a["residual_rms"]),
            a["units"].split("; "),
        )
        lines = [
            f"{self.name}: {self.models[0]}" if self.name and len(self.models) == 1 else self.name
        ]
        lines = [line for line in lines if line] or [str(self.models[0])]
        lines += [
            f"{model.target} [{unit}]: R2 {R2:.4f}, residual rms {rms:.3g}"
            for model, R2, rms, unit in fitted
        ]
        lines.append(f"samples {a['samples']}, manoeuvres {a['manoeuvres']}")
        wide = max(len(str(term)) for term in e["term"].values) + 2
        lines.append(
            f"{'parameter':<{wide}}{'estimate':>12}{'stderr':>10}{'white':>10}{'system.':>10}{'t':>9}{'narrowed':>10}"
        )
        for k, term in enumerate(e["term"].values):
            errors = "".join(
                _cell(float(e[name][k]), 10, ".2g")
                for name in ("stderr", "stderr_white", "stderr_systematic")
            )
            t, narrowed = (
                _cell(float(e["t"][k]), 9, ".1f"),
                _cell(float(e["narrowed"][k]), 10, ".3f"),
            )
            lines.append(f"{term!s:<{wide}}{float(e['estimate'][k]):>12.5g}{errors}{t}{narrowed}")
        return "\n".join([*lines, *(f"! {text}" for text in self.remarks)])


def _cell(value: float, width: int, form: str) -> str:
    return f"{'-' if np.isnan(value) else format(value, form):>{width}}"


def regress_separable(
    model: SeparableModel | Sequence[SeparableModel],
    data: xr.Dataset | Sequence[xr.Dataset],
    name: str = "",
    lag: float | None = None,
) -> SeparableFit:
    """Fit models that are linear in their coefficients and nonlinear in few shape parameters by
    least squares.

    Parameters
    ----------
    model : SeparableModel or list of them
        Of one measured quantity each.  Shape parameters with the same name are the same parameter;
        each quantity is weighed by the inverse of its residual rms.
    data : Dataset (time,) or list of them
        Manoeuvres; samples with NaN in a quantity or its regressors are left out of it.
    name : str
        For reports and provenance.
    lag : float, optional
        Window of the residual's own autocorrelation in place of the autoregression, see
        `covariance.coloured`. [s]

    Returns
    -------
    SeparableFit

    Raises
    ------
    IdentificationError
        Too few samples, coefficients that the data cannot distinguish wherever the search starts.
    UnknownName
        A variable that the data do not hold.
    OutOfRange
        A term that cannot be formed of the data at any start.

    Notes
    -----
    The covariance is that of least squares linearised at the solution, with the regressors ``[A, (dA/ds) c]``, for
    residuals that are correlated in time (`covariance.coloured`); residuals of different quantities count as independent.
    A parameter at a bound is taken for known there and has no standard error.  The estimate minimises the plain sum of
    squares: colour enters the standard errors, and the weight of a prior.

    References
    ----------
    .. [Golub2003] Golub, Pereyra, Separable nonlinear least squares: the variable projection method and its applications,
       Inverse Problems 19, 2003.
    """
    models = [model] if isinstance(model, SeparableModel) else list(model)
    _demand_models(models)
    problem = SeparableProblem(
        models, [stack_samples(one.target, one.variables, data, one) for one in models]
    )
    search = WeightedMinimum(problem)
    found = search.settled(lag)
    estimates = _estimates(problem, found)
    residuals = problem.residuals(found.values, found.coefficients)
    for attribute, value in _facts(problem, found, residuals, name).items():
        estimates.attrs[attribute] = value
    kept = {
        one.target: samples.data.drop_dims("error", errors="ignore")
        for one, samples in zip(models, problem.samples)
    }
    return SeparableFit(
        name, tuple(models), estimates, kept, {one.target: v for one, v in zip(models, residuals)}
    )


def _estimates(problem: SeparableProblem, found: SeparableSolution) -> xr.Dataset:
    """Estimates under the names that all fits share; what is at a bound has no standard error."""
    names = [*(term for terms in problem.terms for term in terms), *problem.names]
    theta = np.concatenate([*found.coefficients, found.values])
    free, size = found.free, len(names)
    M = (found.products + np.diag(found.prior))[np.ix_(free, free)]
    D = _inverse(M, [name for name, use in zip(names, free) if use])
    sigma2 = np.concatenate(
        [
            np.zeros(size - len(problem.names)),
            [problem.shape[name].sigma ** 2 for name in problem.names],
        ]
    )
    known = np.where(
        found.prior > 0.0, found.prior**2 * np.where(np.isfinite(sigma2), sigma2, 0.0), 0.0
    )
    covariance = _whole(D @ (found.spread + np.diag(known))[np.ix_(free, free)] @ D, free)
    white = np.sqrt(
        np.diag(_whole(D @ (found.white + np.diag(known))[np.ix_(free, free)] @ D, free))
    )
    sources = list(
        dict.fromkeys(
            s
            for model, one in zip(problem.models, problem.samples)
            for s in one.errors(model.target)[0]
        )
    )
    change = np.zeros((size, len(sources)))
    at = 0
    for j, (model, samples, X) in enumerate(zip(problem.models, problem.samples, found.regressors)):
        columns = [*range(at, at + len(model.terms)), *range(size - len(problem.names), size)]
        at += len(model.terms)
        own, errors = samples.errors(
            model.target, model.variables, problem.fitted(j, found.values, found.coefficients[j])
        )
        for source, error in zip(own, errors):
            pushed = np.zeros(size)
            pushed[columns] = X.T @ (problem.weights[j] * error)
            change[free, sources.index(source)] += D @ pushed[free]
    more = assess_identifiability(problem.models, problem.shape, names, theta, covariance, found)
    return least_squares.regression_estimates(
        names, theta, covariance, white, (sources, change), more
    )


def _inverse(M: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """Inverse of a product matrix, scaled to a unit diagonal first."""
    scale = 1.0 / np.sqrt(np.diag(M))
    values, vectors = np.linalg.eigh(M * np.outer(scale, scale))
    if values[0] <= 1e-14 * values[-1]:
        raise IdentificationError(
            f"the data cannot distinguish: {collinearity.describe_combination(vectors[:, 0], names)} "
            f"does not change the fit; leave a term out"
        )
    return (vectors / values @ vectors.T) * np.outer(scale, scale)


def _whole(part: np.ndarray, free: np.ndarray) -> np.ndarray:
    """A covariance over all parameters from that of the free ones; NaN for the others."""
    found = np.full((len(free), len(free)), np.nan)
    found[np.ix_(free, free)] = 0.5 * (part + part.T)
    return found


def _facts(
    problem: SeparableProblem, found: SeparableSolution, residuals: Sequence[np.ndarray], name: str
) -> dict:
    targets = [model.target for model in problem.models]
    total = [float(((z - z.mean()) ** 2).sum()) for z in problem.z]
    R2 = [1.0 - float(v @ v) / t if t else float("nan") for v, t in zip(residuals, total)]
    rms = [float(np.sqrt(v @ v / len(v))) for v in residuals]
    one = len(targets) == 1
    return {
        "name": name,
        "coefficient": " ".join(targets),
        "units": "; ".join(model.unit(model.target) for model in problem.models),
        "domain": "time",
        "R2": R2[0] if one else np.array(R2),
        "residual_rms": rms[0] if one else np.array(rms),
        "samples": int(sum(map(len, problem.z))),
        "manoeuvres": max(len(samples.steps) for samples in problem.samples),
        "offset": found.offset,
    }


def _demand_models(models: Sequence[SeparableModel]) -> None:
    """Raise when there is no model, two of one quantity, or one parameter with two meanings."""
    if not models:
        raise IdentificationError("no model; give at least one")
    targets = [model.target for model in models]
    if len(set(targets)) < len(targets):
        raise IdentificationError(
            f"{next(t for t in targets if targets.count(t) > 1)} has two models; give one of "
            f"each quantity"
        )
    seen: dict[str, ShapeParameter] = {}
    for model in models:
        for name, item in model.parameters.items():
            if seen.setdefault(name, item) != item:
                raise IdentificationError(
                    f"the parameter {name} has {seen[name]} in one model and {item} in "
                    f"another; make them equal"
                )
