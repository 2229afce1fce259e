"""Separable least squares on flight records, with the joint covariance of all parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, UnknownName
from flightmech.short_text import ShortText
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.samples import stack_samples
from flighttest.regression.expressions import Scope, parse_expression
from flighttest.regression.separable.identifiability import assess_identifiability
from flighttest.regression.separable.search import (
    SAME,
    WRONG,
    SeparableProblem,
    SeparableSolution,
    WeightedMinimum,
)
from flighttest.regression.separable_model import SeparableModel, ShapeParameter
from flighttest.regression.uncertainty import collinearity
from flighttest.remarks import Convergence, Remark, TabledEstimates, warn_forbidden

_SINGULAR = 1e-14  # eigenvalue of the scaled normal matrix, over the largest, that counts as zero


@dataclass(frozen=True)
class SeparableFit(ShortText, TabledEstimates):
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
        ``identified``, ``why`` as in `assess_identifiability`; ``condition_index`` (component) and
        ``proportion`` (component, term). NaN for the errors of a parameter at a bound.
    data : dict of str to Dataset (sample,)
        The samples used, by quantity.
    residuals : dict of str to array (sample,)
        Measured minus fitted, by quantity.
    convergence : Convergence
        End of the rounds of weights of several quantities or of priors. Its change is that of an
        estimate by the last round over a tenth of its standard error.
    """

    name: str
    models: tuple[SeparableModel, ...]
    estimates: xr.Dataset
    data: Mapping[str, xr.Dataset]
    residuals: Mapping[str, np.ndarray]
    convergence: Convergence

    def value(self, parameter: str) -> tuple[float, float]:
        """Return an estimate and its standard error.

        Raises
        ------
        UnknownName
            No such coefficient or parameter.
        """
        names = [str(term) for term in self.estimates["term"].values]
        if parameter not in names:
            raise UnknownName(parameter, names, "coefficient or parameter")
        row = self.estimates.sel(term=parameter)
        return float(row["estimate"]), float(row["stderr"])

    def derived(self, *texts: str) -> tuple[np.ndarray, np.ndarray]:
        """Return functions of the estimates and their covariance, by first-order propagation.

        Parameters
        ----------
        *texts : str
            Expressions of the estimates. A coefficient is written as its term in brackets:
            ``"[alpha*h_agl^s] / [alpha]"``.

        Returns
        -------
        values : array (texts,)
        covariance : array (texts, texts)
            NaN where an estimate without standard error takes part.

        Raises
        ------
        UnknownName
            A name that is not an estimate.
        ParseError
            A text that is not an expression.
        """
        names = [str(term) for term in self.estimates["term"].values]
        scope = Scope({}, dict(zip(names, self.estimates["estimate"].values)))
        values, rows = [], []
        for text in texts:
            result = parse_expression(text).at(scope)
            values.append(float(result.value))
            rows.append([float(result.by.get(name, 0.0)) for name in names])
        # Covariance G C G' with the derivatives G (texts, terms).
        G = np.array(rows)
        C = self.estimates["covariance"].values
        unknown = np.isnan(np.diag(C))
        covariance = G @ np.where(unknown[:, None] | unknown, 0.0, C) @ G.T
        is_unknown = (G[:, unknown] != 0.0).any(axis=1)
        covariance[is_unknown] = covariance[:, is_unknown] = np.nan
        return np.array(values), covariance

    @property
    def remarks(self) -> list[str]:
        """Weights that did not converge, parameters that are not identified, and parameters that
        are hardly distinguishable.
        """
        e = self.estimates
        remarks = [remark.text for remark in self.convergence_remarks]
        for term, why in zip(e["term"].values, e["why"].values):
            if why:
                remarks.append(f"{term}: not identified: {why}")
        for index, terms in collinearity.collinear_terms(e):
            remarks.append(f"condition index {index:.0f}: hardly distinguishable are {terms}")
        return remarks

    @property
    def convergence_remarks(self) -> list[Remark]:
        """A remark on weights that did not converge: an error above one standard error."""
        advice = (
            "estimates belong to weights that still change; give a prior or a quantity that fits "
            "the others, or fit the quantities separately"
        )
        severity = "warning" if SAME * self.convergence.change <= WRONG else "error"
        return self.convergence.remarks("weights", advice, severity=severity)

    def report(self) -> str:
        """Return the estimates as a text table."""
        e, a = self.estimates, self.estimates.attrs
        width = max(len(str(term)) for term in e["term"].values) + 2
        lines = [
            self._title(),
            *self._quality_lines(),
            f"samples {a['samples']}, manoeuvres {a['manoeuvres']}",
            f"{'parameter':<{width}}{'estimate':>12}{'stderr':>10}{'white':>10}{'system.':>10}"
            f"{'t':>9}{'narrowed':>10}",
        ]
        for k, term in enumerate(e["term"].values):
            cells = [f"{term!s:<{width}}{float(e['estimate'][k]):>12.5g}"]
            for name in ("stderr", "stderr_white", "stderr_systematic"):
                cells.append(_format_cell(float(e[name][k]), 10, form=".2g"))
            cells.append(_format_cell(float(e["t"][k]), 9, form=".1f"))
            cells.append(_format_cell(float(e["narrowed"][k]), 10, form=".3f"))
            lines.append("".join(cells))
        for text in self.remarks:
            lines.append(f"! {text}")
        return "\n".join(lines)

    def _title(self) -> str:
        """Return the name of the fit, and the model if there is one."""
        if not self.name:
            return str(self.models[0])
        if len(self.models) > 1:
            return self.name
        return f"{self.name}: {self.models[0]}"

    def _quality_lines(self) -> list[str]:
        """Return R2 and residual rms of each quantity."""
        a = self.estimates.attrs
        R2, rms = np.atleast_1d(a["R2"]), np.atleast_1d(a["residual_rms"])
        lines = []
        for model, fraction, residual, unit in zip(self.models, R2, rms, a["units"].split("; ")):
            quality = f"R2 {fraction:.4f}, residual rms {residual:.3g}"
            lines.append(f"{model.target} [{unit}]: {quality}")
        return lines


def _format_cell(value: float, width: int, form: str) -> str:
    """Return a number as text of a width; NaN is a dash."""
    text = "-" if np.isnan(value) else format(value, form)
    return f"{text:>{width}}"


def regress_separable(
    model: SeparableModel | Sequence[SeparableModel],
    data: xr.Dataset | Sequence[xr.Dataset],
    name: str = "",
    lag: float | None = None,
) -> SeparableFit:
    """Fit models with linear coefficients and nonlinear shape parameters by least squares.

    Parameters
    ----------
    model : SeparableModel or list of them
        One model per measured quantity. Shape parameters with the same name are the same parameter.
        Each quantity has the weight of one over its residual rms.
    data : Dataset (time,) or list of them
        Manoeuvres. Samples with NaN in a quantity or its regressors are ignored for this quantity.
    name : str
        Name of the fit in reports and in the provenance.
    lag : float, optional
        Lag window of the residual's own autocorrelation, which replaces the estimated spectrum; see
        `coloured_covariance_of`. [s]

    Returns
    -------
    SeparableFit

    Raises
    ------
    IdentificationError
        Too few samples, or coefficients that the data cannot distinguish at any start.
    UnknownName
        A variable that the data do not hold.
    OutOfRange
        A term that cannot be computed from the data at any start.

    Warns
    -----
    AeromatchWarning
        The last round of the weights moved an estimate by more than its standard error.

    Notes
    -----
    The covariance is that of least squares linearised at the solution, with the regressors
    ``[A, (dA/ds) c]``, for residuals that are correlated in time (`coloured_covariance_of`).
    Residuals of different quantities count as independent. A parameter at a bound counts as exact
    and has no standard error. The estimate minimises the plain sum of squares. Colour enters the
    standard errors and the weight of a prior.

    References
    ----------
    .. [Golub2003] Golub, Pereyra, Separable nonlinear least squares: the variable projection method
       and its applications, Inverse Problems 19, 2003.
    """
    models = [model] if isinstance(model, SeparableModel) else list(model)
    _demand_models(models)
    samples = [stack_samples(item.target, item.variables, data, purpose=item) for item in models]
    problem = SeparableProblem(models, samples)
    rounds = WeightedMinimum(problem).iterate_weights(lag)
    solution = rounds.last
    estimates = _tabulate_estimates(problem, solution)
    residuals = problem.residuals(solution.values, solution.coefficients)
    estimates.attrs.update(_fit_attributes(problem, solution, residuals=residuals, name=name))
    data_of, residual_of = {}, {}
    for item, used, residual in zip(models, samples, residuals):
        data_of[item.target] = used.data.drop_dims("error", errors="ignore")
        residual_of[item.target] = residual
    fit = SeparableFit(
        name,
        tuple(models),
        estimates,
        data=data_of,
        residuals=residual_of,
        convergence=rounds.convergence(problem, estimates["stderr"].values),
    )
    warn_forbidden(fit.convergence_remarks, name or str(models[0]))
    return fit


def minimum_residual(model: SeparableModel, data: xr.Dataset | Sequence[xr.Dataset]) -> np.ndarray:
    """Return the residual of `regress_separable` for one model, without any standard error.

    It costs a third less, for comparisons of many models.
    """
    samples = stack_samples(model.target, model.variables, data, purpose=model)
    problem = SeparableProblem([model], [samples])
    minimum = WeightedMinimum(problem)
    s = minimum.search(np.zeros(len(problem.names)))
    projection = problem.project(s, np.zeros(len(problem.names)))
    if projection is None:
        raise IdentificationError(f"the coefficients of {model} are not determined")
    (residual,) = problem.residuals(s, [np.asarray(c) for c in projection.coefficients])
    return residual


def _tabulate_estimates(problem: SeparableProblem, solution: SeparableSolution) -> xr.Dataset:
    """Return estimates as a Dataset; a parameter at a bound has no standard error."""
    names: list[str] = []
    for terms in problem.terms:
        names.extend(terms)
    names.extend(problem.names)
    theta = np.concatenate([*solution.coefficients, solution.values])
    free = solution.free
    # Sandwich covariance N^-1 (S + K) N^-1 of the free parameters. N is the normal matrix with the
    # prior, S the products of the disturbance, and K the variance of the a-priori values.
    block = np.ix_(free, free)
    free_names = [name for name, is_free in zip(names, free) if is_free]
    inverse = _invert_scaled((solution.products + np.diag(solution.prior))[block], free_names)
    prior = np.diag(_prior_variance(problem, solution))
    covariance = _fill_fixed(inverse @ (solution.spread + prior)[block] @ inverse, free)
    white = _fill_fixed(inverse @ (solution.white + prior)[block] @ inverse, free)
    return least_squares.regression_estimates(
        names,
        theta,
        covariance=covariance,
        white=np.sqrt(np.diag(white)),
        systematic=_systematic_changes(problem, solution, inverse),
        extra=assess_identifiability(
            problem.models,
            problem.shape,
            names=names,
            theta=theta,
            covariance=covariance,
            solution=solution,
        ),
    )


def _prior_variance(problem: SeparableProblem, solution: SeparableSolution) -> np.ndarray:
    """Return the noise of the a-priori values in the normal equations, (parameters,)."""
    sigma2 = np.zeros(len(solution.free))
    sigma2[len(sigma2) - len(problem.names) :] = [
        problem.shape[name].sigma ** 2 for name in problem.names
    ]
    finite = np.where(np.isfinite(sigma2), sigma2, 0.0)
    return np.where(solution.prior > 0.0, solution.prior**2 * finite, 0.0)


def _systematic_changes(
    problem: SeparableProblem, solution: SeparableSolution, inverse: np.ndarray
) -> tuple[list[str], np.ndarray]:
    """Return the sources of common errors and the changes (parameters, sources) by them."""
    sources: dict[str, None] = {}
    for model, samples in zip(problem.models, problem.samples):
        sources.update(dict.fromkeys(samples.errors(model.target)[0]))
    order = list(sources)
    free, size = solution.free, len(solution.free)
    change = np.zeros((size, len(order)))
    start = 0
    for j, (model, samples) in enumerate(zip(problem.models, problem.samples)):
        # Columns of this quantity: its coefficients, and all shape parameters at the end.
        stop = start + len(model.terms)
        columns = [*range(start, stop), *range(size - len(problem.names), size)]
        start = stop
        response = problem.response(j, solution.values, solution.coefficients[j])
        names, errors = samples.errors(model.target, model.variables, response)
        for source, error in zip(names, errors):
            # N^-1 X' e: the estimates that fit an error e of the samples
            products = np.zeros(size)
            products[columns] = solution.regressors[j].T @ (problem.weights[j] * error)
            change[free, order.index(source)] += inverse @ products[free]
    return order, change


def _invert_scaled(M: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """Return the inverse of a normal matrix, scaled to a unit diagonal first."""
    # A combination with a vanishing eigenvalue does not change the fit.
    scale = 1.0 / np.sqrt(np.diag(M))
    values, vectors = np.linalg.eigh(M * np.outer(scale, scale))
    if values[0] <= _SINGULAR * values[-1]:
        combination = collinearity.describe_combination(vectors[:, 0], names)
        raise IdentificationError(
            f"the data cannot distinguish: {combination} does not change the fit; leave a term out"
        )
    return (vectors / values @ vectors.T) * np.outer(scale, scale)


def _fill_fixed(covariance: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return a covariance of the free parameters over all parameters; NaN for the others."""
    filled = np.full((len(free), len(free)), np.nan)
    filled[np.ix_(free, free)] = 0.5 * (covariance + covariance.T)
    return filled


def _fit_attributes(
    problem: SeparableProblem,
    solution: SeparableSolution,
    residuals: Sequence[np.ndarray],
    name: str,
) -> dict[str, Any]:
    """Return the attributes of the estimates."""
    targets = [model.target for model in problem.models]
    # A constant quantity has no R2.
    R2, rms = [], []
    for z, v in zip(problem.z, residuals):
        total = float(((z - z.mean()) ** 2).sum())
        R2.append(1.0 - float(v @ v) / total if total else float("nan"))
        rms.append(float(np.sqrt(v @ v / len(v))))
    is_single = len(targets) == 1
    return {
        "name": name,
        "coefficient": " ".join(targets),
        "units": "; ".join(model.unit(model.target) for model in problem.models),
        "domain": "time",
        "R2": R2[0] if is_single else np.array(R2),
        "residual_rms": rms[0] if is_single else np.array(rms),
        "samples": int(sum(map(len, problem.z))),
        "manoeuvres": max(len(samples.steps) for samples in problem.samples),
        "offset": solution.offset,
    }


def _demand_models(models: Sequence[SeparableModel]) -> None:
    """Raise when there is no model, two of one quantity, or one parameter with two meanings."""
    if not models:
        raise IdentificationError("no model; give at least one")
    targets: set[str] = set()
    parameters: dict[str, ShapeParameter] = {}
    for model in models:
        if model.target in targets:
            raise IdentificationError(f"{model.target} has two models; give one of each quantity")
        targets.add(model.target)
        for name, item in model.parameters.items():
            if parameters.setdefault(name, item) != item:
                raise IdentificationError(
                    f"the parameter {name} has {parameters[name]} in one model and {item} in "
                    f"another; make them equal"
                )
