"""Equation error in time: a linear model fitted to measured coefficients by least squares.

The method is that of [Klein2006]_. Errors of the regressors bias the slopes towards zero by about
var(noise)/var(signal), so the states are reconstructed first. Standard errors are those of coloured
residuals. The errors of mass, inertia, thrust, surface pick-ups and reconstructed states are common
to many samples. They are reported separately, as systematic errors.

References
----------
.. [Klein2006] Klein, Morelli, Aircraft System Identification, AIAA 2006.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flighttest.parameter_constraints import (
    ParameterElimination,
    choose_active,
    eliminate,
    parse_constraints,
    rate_constraints,
)
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.fit_remarks import unsettled_attributes
from flighttest.regression.equation_error.least_squares import WEIGHTS, ridge_penalty, weight_roots
from flighttest.regression.equation_error.model import (
    RegressionModel,
)
from flighttest.regression.equation_error.problem import (
    LinearSolution,
    RegressionProblem,
    Solve,
    demand_choice,
    demand_determined,
    prepare_problem,
)
from flighttest.regression.equation_error.samples import slopes_of
from flighttest.regression.uncertainty import significance
from flighttest.regression.uncertainty.coloured_residuals import coloured_covariance_of
from flighttest.regression.uncertainty.growing_residuals import growth_envelope


def regress(
    model: RegressionModel,
    data: xr.Dataset | Sequence[xr.Dataset],
    name: str = "",
    intercepts: str = "common",
    lag: float | None = None,
    weights: str = "equal",
    ridge: float | str = 0.0,
    constraints: Sequence[str] = (),
) -> Fit:
    """Fit a model to measured coefficients by least squares.

    Parameters
    ----------
    model : RegressionModel
        Coefficient and terms.
    data : Dataset (time,) or list of them
        Manoeuvres, as `coefficients` returns them. Samples with NaN in the coefficient or a
        regressor are ignored.
    name : str
        Name of the fit in reports and in the provenance.
    intercepts : {"common", "separate"}
        ``separate`` gives each manoeuvre its own constant, in place of the term ``1``: terms
        ``1[0]``, ``1[1]`` ...
    lag : float, optional
        Lag window of the residual's own autocorrelation, which replaces the estimated spectrum;
        see `coloured_covariance_of`. [s]
    weights : str
        ``equal``; ``manoeuvre``, the inverse variance of each manoeuvre's residual; ``robust``,
        Huber's weights against spikes [Huber1981]_; or a variable of the data with the standard
        error of the coefficient, sample by sample.
    ridge : float or "auto"
        Ridge parameter on standardised regressors without the intercepts. ``auto`` takes the
        parameter of Hoerl, Kennard and Baldwin [Hoerl1975]_. A ridge biases the estimates towards
        zero; the variable ``shrinkage`` is the bias.
    constraints : sequence of str
        Linear constraints among the terms, as ``qhat = 1.2*alphadothat`` or ``delta_e < 0``; see
        `parse_constraints`. A ridge then acts on the free terms; its parameter is that of the
        equalities, and constraints are compared with the estimate without a ridge.

    Returns
    -------
    Fit

    Raises
    ------
    IdentificationError
        Too few samples, a term without movement, terms that the data cannot distinguish, or
        standard errors in `weights` that are not positive.
    UnknownName
        A variable that the data do not hold.
    SchemaError
        Constraints that cannot be read, or that contradict each other.

    References
    ----------
    .. [Huber1981] Huber, Robust Statistics, Wiley 1981.
    .. [Hoerl1975] Hoerl, Kennard, Baldwin, Ridge regression: some simulations, Communications in
       Statistics 4, 1975.
    """
    demand_choice("intercepts", intercepts, ("common", "separate"))
    # Weights may be the standard errors in a variable of the data.
    needed = list(model.variables)
    if weights not in WEIGHTS:
        needed.append(weights)
    problem = prepare_problem(model, data, name=name, intercepts=intercepts, needed=needed)

    parameter: float | str = ridge

    def solve(elimination: ParameterElimination) -> LinearSolution:
        nonlocal parameter
        found = _solve_least_squares(problem, elimination, weights=weights, ridge=parameter)
        # one parameter for all choices of inequalities
        parameter = found.attributes["ridge"]
        return found

    def solve_without_ridge(elimination: ParameterElimination) -> LinearSolution:
        return _solve_least_squares(problem, elimination, weights=weights, ridge=0.0)

    return fit_problem(
        problem, solve, constraints=constraints, lag=lag, unbiased=solve_without_ridge
    )


def fit_problem(
    problem: RegressionProblem,
    solve: Solve,
    constraints: Sequence[str] = (),
    lag: float | None = None,
    unbiased: Solve | None = None,
) -> Fit:
    """Return the fit of a problem by an estimator, with constraints among its parameters.

    Parameters
    ----------
    problem : RegressionProblem
    solve : callable
        The estimator: from an elimination to a `LinearSolution`.
    constraints : sequence of str
    lag : float, optional
        As of `regress`. [s]
    unbiased : callable, optional
        The estimator with which constraints are compared, if it is another one.
    """
    parsed = parse_constraints(constraints, problem.terms, problem.spell)
    equalities = [constraint for constraint in parsed if constraint.is_equality]
    limits = [constraint for constraint in parsed if not constraint.is_equality]
    held = eliminate(equalities, len(problem.terms))
    _demand_free(problem, held)
    solution, active = solve(held), equalities
    if limits:
        violated = choose_active(limits, held, solution.phi, solution.information)
        if violated:
            active = [*equalities, *violated]
            solution = solve(eliminate(active, len(problem.terms)))
    estimates, design, errors = _describe_solution(problem, solution, lag)
    estimates.attrs.update(name=problem.name, intercepts=problem.intercepts)
    if parsed:
        # Without any constraint: what the data alone state about them.
        theta, covariance = _estimate_freely(problem, unbiased or solve, lag)
        rated = rate_constraints(parsed, active, theta, covariance)
        estimates.attrs["constraints"] = rated
    return Fit(
        name=problem.name,
        model=problem.model,
        estimates=estimates,
        data=problem.samples.for_fit(problem.model.coefficient, errors),
        design=least_squares.label_terms(design, problem.terms),
        regressors=least_squares.label_terms(problem.X, problem.terms),
    )


def _demand_free(problem: RegressionProblem, elimination: ParameterElimination) -> None:
    """Raise when the samples cannot determine the free parameters."""
    demand_determined(
        problem.name,
        problem.model,
        z=problem.z,
        X=problem.X @ elimination.matrix,
        terms=[problem.terms[k] for k in elimination.free],
    )


def _estimate_freely(
    problem: RegressionProblem, solve: Solve, lag: float | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return estimate and covariance without constraints; NaN if the samples cannot give them."""
    count = len(problem.terms)
    none = eliminate([], count)
    try:
        _demand_free(problem, none)
        estimates = _describe_solution(problem, solve(none), lag)[0]
    except IdentificationError:
        return np.full(count, np.nan), np.zeros((count, count))
    D = estimates["systematic"].values
    return estimates["estimate"].values, estimates["covariance"].values + D @ D.T


def _solve_least_squares(
    problem: RegressionProblem, elimination: ParameterElimination, weights: str, ridge: float | str
) -> LinearSolution:
    """Return the weighted least-squares estimate with a ridge."""
    T, data = elimination.matrix, problem.samples.data
    X, z = problem.X @ T, problem.z - problem.X @ elimination.offset
    # Weighted least squares with a ridge: theta = (X'WX + K)^-1 X'W z, W the squares of `root`.
    root, weighting = weight_roots(weights, X, z=z, data=data)
    Xw, zw = X * root[:, None], z * root
    is_constant = problem.is_constant[elimination.free]
    penalty, parameter = ridge_penalty(ridge, Xw, z=zw, fixed=is_constant)
    phi, E = least_squares.solve_least_squares(Xw, zw, penalty)
    # Huber's weights follow the residuals, which changes their standard errors.
    carrier, influence = E, None
    if weights == "robust":
        carrier = least_squares.solve_least_squares(X, z, penalty)[1]
        influence = least_squares.huber_pseudo_residuals
    variables: dict[str, Any] = {}
    if parameter:
        bias = least_squares.ridge_bias(Xw, zw, penalty)
        variables["shrinkage"] = "term", T @ bias, {"long_name": least_squares.RIDGE_BIAS}
    return LinearSolution(
        elimination,
        phi,
        E=E,
        design=E,
        carrier=carrier,
        X=Xw,
        motion=X,
        information=Xw.T @ Xw + np.diag(penalty),
        root=root,
        added=np.zeros((len(phi), len(phi))),
        variables=variables,
        attributes={
            "weights": weights,
            "ridge": parameter,
            **unsettled_attributes("weights", weighting),
        },
        influence=influence,
    )


def _describe_solution(
    problem: RegressionProblem, solution: LinearSolution, lag: float | None
) -> tuple[xr.Dataset, np.ndarray, np.ndarray]:
    """Return estimates, equivalent regressors (samples, terms), and errors of the samples."""
    model, samples, z, X = problem.model, problem.samples, problem.z, problem.X
    elimination, root, E = solution.elimination, solution.root, solution.E
    T, is_constant = elimination.matrix, problem.is_constant
    theta = elimination.expand(solution.phi)
    v = z - X @ theta
    scaled = v * root if solution.influence is None else solution.influence(v)
    s2 = float(scaled @ scaled) / (len(z) - len(solution.phi))
    pieces, steps = samples.pieces()
    carrier = solution.carrier
    coloured = coloured_covariance_of(carrier, scaled, pieces=pieces, steps=steps, lag=lag)
    stationary = elimination.expand_covariance(coloured.covariance + solution.added)
    covariance, growing = stationary, None
    envelope = growth_envelope(solution.motion, scaled, pieces)
    if lag is None and np.ptp(envelope) > 0.0:
        growing = elimination.expand_covariance(
            coloured_covariance_of(
                carrier, scaled, pieces=pieces, steps=steps, envelope=envelope
            ).covariance
            + solution.added
        )
        covariance = _larger_covariance(growing, stationary)
    # A maps the samples without weights to the estimates, theta = A z.
    A = T @ (least_squares.estimator_matrix(E) * root)
    sources, errors = samples.errors(model.coefficient, model.variables, slopes_of(model, theta))

    contribution = np.std(X, axis=0) * np.abs(theta) / float(np.std(z))
    windowed = _expand_stderr(T, coloured.windowed)
    variables = {
        **least_squares.spread_diagnostics(
            least_squares.regressor_diagnostics(solution.X, is_constant[elimination.free]),
            ~elimination.is_free,
        ),
        **solution.variables,
        **_term_variables(contribution, windowed=windowed),
    }
    spread = A / root
    if solution.influence is not None:
        spread = T @ least_squares.estimator_matrix(carrier)
    white = np.sqrt(s2 * (spread**2).sum(axis=1))
    estimates = least_squares.regression_estimates(
        problem.terms,
        theta,
        covariance=covariance,
        white=white,
        systematic=(sources, A @ errors.T),
        extra=variables,
    )
    if growing is not None:
        estimates = estimates.assign(_growth_errors(growing, stationary))
    estimates.attrs = {
        "coefficient": model.coefficient,
        "domain": "time",
        **_quality_of_fit(z, v),
        "manoeuvres": len(samples.steps),
        "offset": coloured.offset,
        "hidden": coloured.hidden,
        "edge": coloured.edge,
        **solution.attributes,
        **significance.residual_whiteness(v * root, pieces, steps),
    }
    dof = significance.of_slopes(A, v, pieces=pieces, fixed=is_constant, terms=len(solution.phi))
    not_inflated = np.ones(len(problem.terms))
    # The F test is that of the free slopes; the others follow them.
    tested = elimination.is_free & ~is_constant
    estimates = significance.add_tests(estimates, ~tested, dof=dof, inflated=not_inflated)
    for name in ("t", "p_value"):
        estimates[name] = estimates[name].where(~elimination.is_fixed)
    if T.shape[0] == T.shape[1] and solution.attributes["weights"] == "equal":
        return estimates, solution.design, errors
    if T.shape[0] == T.shape[1]:
        return estimates, least_squares.equivalent_regressors(A), errors
    return estimates, np.linalg.pinv(A), errors


def _expand_stderr(T: np.ndarray, stderr: np.ndarray) -> np.ndarray:
    """Return standard errors of all parameters that follow one free parameter each."""
    return np.sqrt((T**2) @ stderr**2)


def _larger_covariance(growing: np.ndarray, stationary: np.ndarray) -> np.ndarray:
    """Return the first covariance, enlarged where the second one has larger standard errors."""
    small, large = np.diag(growing), np.diag(stationary)
    factor = np.sqrt(np.maximum(1.0, large / np.where(small > 0.0, small, np.inf)))
    return growing * np.outer(factor, factor)


def _growth_errors(growing: np.ndarray, stationary: np.ndarray) -> dict[str, Any]:
    """Return both standard errors of the terms for a Dataset."""
    name = "standard error for residuals that "
    return {
        "stderr_growing": (
            "term",
            np.sqrt(np.diag(growing)),
            {"long_name": f"{name}grow with the motion"},
        ),
        "stderr_stationary": (
            "term",
            np.sqrt(np.diag(stationary)),
            {"long_name": f"{name}are stationary"},
        ),
    }


def _quality_of_fit(z: np.ndarray, v: np.ndarray) -> dict[str, float | int]:
    """Return R2, rms of the residuals v, and number of the samples z."""
    return {
        "R2": 1.0 - float(v @ v) / float(((z - z.mean()) ** 2).sum()),
        "residual_rms": float(np.sqrt(v @ v / len(v))),
        "samples": len(z),
    }


def _term_variables(contribution: np.ndarray, windowed: np.ndarray) -> dict[str, Any]:
    """Return contribution and lag-window error of the terms for a Dataset."""
    window_name = {"long_name": "standard error by a lag window, for comparison"}
    return {
        "contribution": ("term", contribution),
        "stderr_window": ("term", windowed, window_name),
    }
