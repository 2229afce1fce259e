"""Equation error in time: a linear model of a coefficient fitted to measured coefficients by least
squares.

Errors of the regressors bias the slopes towards zero by about var(noise)/var(signal): reconstruct
the states first. Standard errors are those of coloured residuals; the errors of mass, inertia,
thrust, surface pick-ups and reconstructed states, which are common to many samples, are kept apart
as systematic ones.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flightmech.names import lookup
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.least_squares import WEIGHTS, ridge_penalty, weight_roots
from flighttest.regression.equation_error.model import RegressionModel, term_powers, variable_of
from flighttest.regression.equation_error.samples import RegressionSamples, slopes_of, stack_samples
from flighttest.regression.uncertainty import collinearity, significance
from flighttest.regression.uncertainty.coloured_residuals import coloured_covariance_of

SAMPLES_PER_TERM = 5
# smallest rms excursion that counts as movement, by unit; a reduced rate of 1e-5 is 0.1 deg/s on a
# small jet
LEAST_MOVEMENT = {"rad": 2e-4, "1": 2e-6}


def regress(
    model: RegressionModel,
    data: xr.Dataset | Sequence[xr.Dataset],
    name: str = "",
    intercepts: str = "common",
    lag: float | None = None,
    weights: str = "equal",
    ridge: float | str = 0.0,
) -> Fit:
    """Fit a model to measured coefficients by least squares.

    Parameters
    ----------
    model : Model
        Coefficient and terms.
    data : Dataset (time,) or list of them
        Manoeuvres, as `coefficients` returns them; samples with NaN in the coefficient or a
        regressor are left out.
    name : str
        For reports and provenance.
    intercepts : {"common", "separate"}
        ``separate`` gives each manoeuvre its own constant, in place of the term ``1``: terms
        ``1[0]``, ``1[1]`` ...
    lag : float, optional
        Take the residual's own autocorrelation over this window, in place of the autoregression;
        see `coloured_covariance_of`. [s]
    weights : str
        ``equal``; ``manoeuvre``, by the inverse variance of each manoeuvre's residual; ``robust``,
        Huber's weights against spikes; or a variable of the data with the standard error of the
        coefficient, sample by sample.
    ridge : float or "auto"
        Ridge parameter on standardised regressors, intercepts left out; ``auto`` takes that of
        Hoerl, Kennard and Baldwin.  The estimates are biased towards zero then: variable
        ``shrinkage``.

    Returns
    -------
    Fit

    Raises
    ------
    IdentificationError
        Too few samples, a term without movement, terms that the data cannot distinguish, or weights
        that are none.
    UnknownName
        A variable that the data do not hold.

    References
    ----------
    .. [Huber1981] Huber, Robust Statistics, Wiley 1981.
    .. [Hoerl1975] Hoerl, Kennard, Baldwin, Ridge regression: some simulations, Communications in Statistics 4, 1975.
    """
    demand_choice("intercepts", intercepts, ("common", "separate"))
    extra = [] if weights in WEIGHTS else [weights]
    samples = stack_samples(model.coefficient, [*model.variables, *extra], data, model)
    X, terms = model.design(samples.data), list(model.terms)
    if intercepts == "separate":
        X, terms = separate_intercepts(X, terms, samples.data["manoeuvre"].values)
    demand_determined(name, model, samples.data[model.coefficient].values, X, terms)
    found, design, change = _solve(model, samples, X, terms, lag, weights, ridge)
    found.attrs.update(name=name, intercepts=intercepts)
    data = samples.kept(model.coefficient, change)
    return Fit(
        name,
        model,
        found,
        data,
        least_squares.label_terms(design, terms),
        least_squares.label_terms(X, terms),
    )


def demand_choice(what: str, given: str, allowed: Sequence[str]) -> None:
    """Raise ValueError when a word is not among those allowed."""
    if given not in allowed:
        raise ValueError(f"{what} is {given!r}; allowed: {', '.join(allowed)}")


def demand_determined(
    name: str, model: object, z: np.ndarray, X: np.ndarray, terms: Sequence[str]
) -> None:
    """Raise when the samples cannot determine the terms.

    Raises
    ------
    IdentificationError
        Too few samples, a variable that stays where it is, or combinations that vanish; the message
        states which.
    """
    label = f"{name}: " if name else ""
    if len(X) < SAMPLES_PER_TERM * len(terms):
        raise IdentificationError(
            f"{label}{len(X)} samples for {len(terms)} terms of {model}; at least "
            f"{SAMPLES_PER_TERM} per term are needed"
        )
    try:
        _demand_movement(z, X, terms)
        collinearity.demand_rank(X, terms)
        collinearity.demand_independence(X, least_squares.intercept_mask(terms), terms)
    except IdentificationError as error:
        raise IdentificationError(f"{label}{model}: {error}") from None


def separate_intercepts(
    X: np.ndarray, terms: list[str], manoeuvre: np.ndarray
) -> tuple[np.ndarray, list[str]]:
    """Return regressors and terms with one intercept per manoeuvre in place of the term ``1``."""
    if "1" not in terms:
        raise IdentificationError("intercepts='separate' needs the term 1 in the model")
    numbers = np.unique(manoeuvre)
    columns = (manoeuvre[:, None] == numbers).astype(float)
    at = terms.index("1")
    return np.hstack([X[:, :at], columns, X[:, at + 1 :]]), [
        *terms[:at],
        *(f"1[{k}]" for k in numbers),
        *terms[at + 1 :],
    ]


def _demand_movement(z: np.ndarray, X: np.ndarray, terms: Sequence[str]) -> None:
    """A single variable that stays where it is cannot carry a slope next to a constant."""
    if np.ptp(z) == 0.0:
        raise IdentificationError("the coefficient is constant; look at its accelerations")
    fixed = least_squares.intercept_mask(terms)
    if not fixed.any():
        return
    for column, term, constant in zip(X.T, terms, fixed):
        factors = {} if constant else term_powers(term)
        if list(factors.values()) != [1]:
            continue
        name = variable_of(next(iter(factors)))
        least = LEAST_MOVEMENT.get(lookup(name).units, 0.0)
        if np.std(column) < least:
            raise IdentificationError(
                f"{term} does not move: rms {np.std(column):.2g} about its mean, {least:.2g} "
                f"is needed; leave it out or add a manoeuvre"
            )


def _solve(
    model: RegressionModel,
    samples: RegressionSamples,
    X: np.ndarray,
    terms: list[str],
    lag,
    weights: str,
    ridge,
) -> tuple[xr.Dataset, np.ndarray, np.ndarray]:
    """The estimates, the regressors of which they are the ordinary least squares, and what the
    common errors change.
    """
    z, fixed = samples.data[model.coefficient].values, least_squares.intercept_mask(terms)
    root = weight_roots(weights, X, z, samples.data)
    Xw, zw = X * root[:, None], z * root
    penalty, parameter = ridge_penalty(ridge, Xw, zw, fixed)
    theta, E = least_squares.solve_least_squares(Xw, zw, penalty)
    v = z - X @ theta
    s2 = float(v * root @ (v * root)) / (len(z) - len(terms))
    pieces, steps = samples.pieces()
    C = coloured_covariance_of(E, v * root, pieces, steps, lag)
    A = least_squares.estimator_matrix(E) * root
    sources, errors = samples.errors(model.coefficient, model.variables, slopes_of(model, theta))
    spread = float(np.std(z))
    more = least_squares.regressor_diagnostics(Xw, fixed)
    more["contribution"] = "term", np.std(X, axis=0) * np.abs(theta) / spread
    if parameter:
        shrinkage = -np.linalg.solve(
            Xw.T @ Xw + np.diag(penalty), penalty * least_squares.solve_least_squares(Xw, zw)[0]
        )
        more["shrinkage"] = (
            "term",
            shrinkage,
            {"long_name": "bias of the ridge, from the estimates without it"},
        )
    more["stderr_window"] = (
        "term",
        C.windowed,
        {"long_name": "standard error by a lag window, for comparison"},
    )
    white = np.sqrt(s2 * ((A / root) ** 2).sum(axis=1))
    found = least_squares.regression_estimates(
        terms, theta, C.covariance, white, (sources, A @ errors.T), more
    )
    found.attrs = {
        "coefficient": model.coefficient,
        "domain": "time",
        "R2": 1.0 - float(v @ v) / float(((z - z.mean()) ** 2).sum()),
        "residual_rms": float(np.sqrt(v @ v / len(v))),
        "samples": len(z),
        "manoeuvres": len(samples.steps),
        "offset": C.offset,
        "hidden": C.hidden,
        "edge": C.edge,
        "weights": weights,
        "ridge": parameter,
        **significance.residual_whiteness(v * root, pieces, steps),
    }
    dof = significance.of_slopes(A, v, pieces, fixed)
    found = significance.add_tests(found, fixed, dof, np.ones(len(terms)))
    return found, E if weights == "equal" else least_squares.equivalent_regressors(A), errors
