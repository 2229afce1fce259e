"""Instrumental variables: equation error without the bias by noise of the regressors.

Noise of a regressor reduces its slope by the share of the noise in its movement. Instruments z are
correlated with the motion and not with the noise. Two-stage least squares projects the regressors
on the instruments, and fits the coefficient to the projection [Soderstrom2002]_:

    X^ = Z (Z'Z)^-1 Z'X,   theta = (X^'X^)^-1 X^'y

The instruments are the model's terms of a simulated response to the recorded controls
(`simulate_states`), or of another record of the same motion whose errors are independent. Neither
the size nor the colour of the noise has to be known.

Instruments that hardly move with a regressor leave the bias, and make the standard errors wrong
[Staiger1997]_. The first stage of each noisy term is therefore tested. F is that of
[Sanderson2016]_, with the covariance for coloured residuals.

References
----------
.. [Soderstrom2002] Soderstrom, Stoica, Instrumental variable methods for system identification,
   Circuits, Systems and Signal Processing 21, 2002.
.. [Staiger1997] Staiger, Stock, Instrumental variables regression with weak instruments,
   Econometrica 65, 1997.
.. [Sanderson2016] Sanderson, Windmeijer, A weak instrument F-test in linear IV models with multiple
   endogenous variables, J. Econometrics 190, 2016.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from flightmech.aircraft.controls import ICE
from flightmech.errors import IdentificationError, UnknownName
from flightmech.quantities import time_text
from flighttest.parameter_constraints import ParameterElimination
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.model import RegressionModel, term_powers, variable_of
from flighttest.regression.equation_error.problem import (
    LinearSolution,
    RegressionProblem,
    demand_choice,
    prepare_problem,
    separate_intercepts,
)
from flighttest.regression.equation_error.samples import list_manoeuvres
from flighttest.regression.equation_error.time_domain import fit_problem
from flighttest.regression.errors_in_variables.simulated_states import CONTROLS, simulate_states
from flighttest.regression.uncertainty import collinearity
from flighttest.regression.uncertainty.coloured_residuals import coloured_covariance_of

WEAK = 10.0  # F of the first stage below which instruments are weak [Staiger1997]
# variables that the crew sets, or that hardly have noise: they are their own instruments
EXACT = ("gear", "speedbrake", ICE, "mach", "h", "h_agl", "CT")
_TOO_NONLINEAR = 3  # power of a term whose mean the noise changes together with a slope


def regress_instrumental(
    model: RegressionModel,
    data: xr.Dataset | Sequence[xr.Dataset],
    name: str = "",
    intercepts: str = "common",
    instruments: xr.Dataset | Sequence[xr.Dataset] | None = None,
    constraints: Sequence[str] = (),
) -> Fit:
    """Fit a model to measured coefficients by instrumental variables.

    Parameters
    ----------
    model, data, name, intercepts, constraints
        As of `regress`.
    instruments : Dataset (time,) or list of them, optional
        Per manoeuvre the same variables from sensors with independent errors, or from a simulation.
        They are interpolated in time. The default is a simulated response to the controls.

    Returns
    -------
    Fit
        ``weak_F`` of every noisy term is the F of its first stage, ``least_squares`` the equation
        error. The attribute ``method`` is ``instrumental variables``.

    Raises
    ------
    IdentificationError
        Weak instruments, no noisy variable in the model, or as of `regress`.
    UnknownName
        A variable that the data or the instruments do not hold.
    SchemaError
        Constraints that cannot be read.
    """
    demand_choice("intercepts", intercepts, ("common", "separate"))
    problem = prepare_problem(
        model, data, name=name, intercepts=intercepts, needed=list(model.variables)
    )
    noisy = [variable for variable in model.variables if is_measured_with_noise(variable)]
    if not noisy:
        raise IdentificationError(
            f"{model} has no noisy variable, only controls; instrumental variables change "
            f"nothing, use least squares"
        )
    if instruments is None:
        replaced, source = simulate_states(problem.samples, noisy), "simulated response to controls"
    else:
        replaced = _interpolate(problem, noisy, list_manoeuvres(instruments))
        source = "given record"
    Z = _instrument_terms(problem, replaced)
    is_noisy_term = np.array([bool(_noisy_factors(term)) for term in problem.terms])

    def solve(elimination: ParameterElimination) -> LinearSolution:
        return _solve_two_stages(problem, elimination, Z=Z, is_noisy_term=is_noisy_term)

    fit = fit_problem(problem, solve, constraints=constraints)
    attributes = fit.estimates.attrs
    attributes["instruments"] = source
    attributes["noise_treatment"] = (
        f"instruments: {source}, smallest F of a first stage "
        f"{float(fit.estimates['weak_F'].min()):.4g} (weak below {WEAK:g})"
    )
    if text := describe_powers(problem.terms, noisy):
        attributes["nonlinear_noise"] = text
    return fit


def is_measured_with_noise(variable: str) -> bool:
    """Return whether a variable is a measured motion, and not a control or a configuration."""
    return not variable.startswith(CONTROLS) and variable not in EXACT and "." not in variable


def _noisy_factors(term: str) -> dict[str, int]:
    """Return the powers of the noisy variables in a term."""
    return {
        name: power
        for name, power in _variable_powers(term).items()
        if is_measured_with_noise(name)
    }


def _variable_powers(term: str) -> dict[str, int]:
    """Return the powers of all variables in a term."""
    if least_squares.intercept_mask([term])[0]:
        return {}
    powers: dict[str, int] = {}
    for factor, power in term_powers(term).items():
        variable = variable_of(factor)
        powers[variable] = powers.get(variable, 0) + power
    return powers


def describe_powers(
    terms: Sequence[str], noisy: Sequence[str], has_correlated_noise: bool = False
) -> str:
    """Return a remark on terms of noisy variables whose bias remains; empty without any.

    The noise n of x adds var(n) to the mean of x**2, which a constant takes up. In x**2*y it adds
    var(n)*y, in x**3 3*var(n)*x: the slope of y or x takes that up.

    Parameters
    ----------
    terms, noisy : sequence of str
    has_correlated_noise : bool
        Whether the noise of one variable is correlated with that of another; a product of two is
        then as a square.
    """
    has_constant = bool(least_squares.intercept_mask(list(terms)).any())
    found = []
    for term in terms:
        powers = _variable_powers(term)
        own = [powers[name] for name in noisy if name in powers]
        highest = sum(own) if has_correlated_noise else max(own, default=0)
        is_taken_up = has_constant and sum(powers.values()) < _TOO_NONLINEAR
        if highest >= 2 and not is_taken_up:
            found.append(term)
    if not found:
        return ""
    return (
        f"{', '.join(found)}: the noise of a squared variable changes the slope of the factor next "
        f"to the square by the variance of the noise times the slope of the term, three times that "
        f"in a third power; that part of the bias remains"
    )


def _interpolate(
    problem: RegressionProblem, noisy: Sequence[str], records: Sequence[xr.Dataset]
) -> dict[str, np.ndarray]:
    """Return the noisy variables of the given records at the samples."""
    data = problem.samples.data
    manoeuvre, time = data["manoeuvre"].values, data["time"].values
    if len(records) != len(problem.samples.steps):
        raise IdentificationError(
            f"{len(records)} records of instruments for {len(problem.samples.steps)} manoeuvres; "
            f"give one for each"
        )
    columns = {name: np.empty(len(time)) for name in noisy}
    for number, record in enumerate(records):
        mask = manoeuvre == number
        clock, own = record["time"].values.astype(float), time[mask]
        # np.interp would hold the end values without a word.
        if len(own) and not (clock[0] <= own[0] + 1e-6 and own[-1] <= clock[-1] + 1e-6):
            raise IdentificationError(
                f"instruments of manoeuvre {number} run from {time_text(clock[0])} to "
                f"{time_text(clock[-1])} s, its "
                f"samples from {time_text(own[0])} to {time_text(own[-1])} s; give instruments "
                "over all samples"
            )
        for name in noisy:
            if name not in record:
                raise UnknownName(
                    name, map(str, record.data_vars), "instrument", "the record does not hold it"
                )
            values = np.interp(own, clock, record[name].values.astype(float))
            if not np.isfinite(values).all():
                raise IdentificationError(f"instrument {name} of manoeuvre {number} has NaN")
            # An instrument with the same noise as the regressor removes no bias.
            if np.array_equal(values, data[name].values[mask]):
                raise IdentificationError(
                    f"instrument {name} of manoeuvre {number} equals the regressor, noise "
                    f"included; give another sensor or a simulated response"
                )
            columns[name][mask] = values
    return columns


def _instrument_terms(problem: RegressionProblem, replaced: dict[str, np.ndarray]) -> np.ndarray:
    """Return the terms of the instruments, (samples, terms)."""
    data = problem.samples.data
    columns = {name: ("sample", values) for name, values in replaced.items()}
    Z = problem.model.design(data.assign(columns))
    if problem.intercepts == "separate":
        Z, _ = separate_intercepts(Z, list(problem.model.terms), data["manoeuvre"].values)
    try:
        collinearity.demand_rank(Z, problem.terms)
        collinearity.demand_independence(Z, problem.is_constant, problem.terms)
    except IdentificationError as error:
        raise IdentificationError(
            f"{problem.model}: the instruments cannot distinguish the terms: {error}"
        ) from None
    return Z


def _solve_two_stages(
    problem: RegressionProblem,
    elimination: ParameterElimination,
    Z: np.ndarray,
    is_noisy_term: np.ndarray,
) -> LinearSolution:
    """Return the estimate by two-stage least squares; raise for weak instruments."""
    T = elimination.matrix
    X, z = problem.X @ T, problem.z - problem.X @ elimination.offset
    Q = np.linalg.qr(Z)[0]
    projected = Q @ (Q.T @ X)
    is_tested = (T[is_noisy_term] != 0.0).any(axis=0)
    strength = np.full(X.shape[1], np.nan)
    for k in np.flatnonzero(is_tested):
        strength[k] = _first_stage_F(problem, X, projected, int(k))
    weak = []
    for k in np.flatnonzero(strength < WEAK):
        weak.append(f"{problem.terms[elimination.free[k]]} (F {strength[k]:.3g})")
    if weak:
        raise IdentificationError(
            f"{problem.model}: weak instruments of {', '.join(weak)}, F of the first stage below "
            f"{WEAK:g}; the estimates would be biased: add a manoeuvre in which the controls move "
            f"these terms, give other instruments, or use total least squares with the noise"
        )
    phi, E = least_squares.solve_least_squares(projected, z)
    # what equation error returns, for comparison
    biased = elimination.expand(least_squares.solve_least_squares(X, z)[0])
    F = np.full(len(T), np.nan)
    F[elimination.free] = strength
    return LinearSolution(
        elimination,
        phi,
        E=E,
        design=E,
        carrier=E,
        X=projected,
        motion=projected,
        information=projected.T @ projected,
        root=np.ones(len(z)),
        added=np.zeros((len(phi), len(phi))),
        variables={
            "weak_F": ("term", F, {"long_name": "F of the first stage, coloured residuals"}),
            "least_squares": ("term", biased, {"long_name": "estimate by equation error"}),
        },
        attributes={"weights": "equal", "ridge": 0.0, "method": "instrumental variables"},
    )


def _first_stage_F(
    problem: RegressionProblem, X: np.ndarray, projected: np.ndarray, k: int
) -> float:
    """Return F of the first stage of one regressor, given the other regressors.

    delta is the estimate of the regressor from the others by two stages; the instruments must then
    explain X_k - X_-k delta, [Sanderson2016]_ eq. (13). One instrument is left for it.
    """
    others = np.delete(projected, k, axis=1)
    delta = np.zeros(others.shape[1])
    if others.shape[1]:
        delta = np.linalg.lstsq(others, projected[:, k], rcond=None)[0]
    # Part of the regressor that its instruments alone explain, and its error.
    explained = projected[:, k] - others @ delta
    left = X[:, k] - np.delete(X, k, axis=1) @ delta - explained
    if not explained.any():
        return 0.0
    # F of one slope: its square over its variance, with coloured residuals.
    scale = float(np.abs(explained).max())
    found = coloured_covariance_of(explained[:, None] / scale, left, *problem.samples.pieces())
    variance = float(found.covariance[0, 0])
    if not variance > 0.0:
        return np.inf
    return scale**2 / variance
