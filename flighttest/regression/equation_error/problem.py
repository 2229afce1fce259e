"""Samples, regressors and linear solutions of a regression, and the conditions of a solution."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, ParseError, UnknownName
from flightmech.names import lookup
from flighttest.parameter_constraints import (
    ParameterElimination,
)
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.model import (
    RegressionModel,
    term_powers,
    term_text,
    variable_of,
)
from flighttest.regression.equation_error.samples import RegressionSamples, stack_samples
from flighttest.regression.uncertainty import collinearity

SAMPLES_PER_TERM = 5
# smallest rms excursion that counts as movement, by unit; a reduced rate of 1e-5 is 0.1 deg/s on a
# small jet
LEAST_MOVEMENT = {"rad": 2e-4, "1": 2e-6}


@dataclass(frozen=True)
class RegressionProblem:
    """Samples and regressors of one model.

    Attributes
    ----------
    name : str
    model : RegressionModel
    samples : RegressionSamples
    X : array (samples, terms)
    terms : list of str
        One constant per manoeuvre may replace the term ``1``.
    intercepts : {"common", "separate"}
    """

    name: str
    model: RegressionModel
    samples: RegressionSamples
    X: np.ndarray
    terms: list[str]
    intercepts: str

    @property
    def z(self) -> np.ndarray:
        """Measured coefficient, (samples,)."""
        return self.samples.data[self.model.coefficient].values

    @property
    def is_constant(self) -> np.ndarray:
        """Mask of the intercepts, (terms,)."""
        return least_squares.intercept_mask(self.terms)

    def spell(self, name: str) -> str:
        """Return the spelling of a term in a constraint."""
        return spell_term(name, self.model.coefficient)


def spell_term(name: str, coefficient: str) -> str:
    """Return the spelling of a term in a constraint: ``CL_qhat`` is the term ``qhat``."""
    own = name.removeprefix(f"{coefficient}_")
    try:
        return term_text(term_powers(own))
    except (ParseError, UnknownName):
        return own


@dataclass(frozen=True)
class LinearSolution:
    """Estimate that is linear in the measurements, theta = T A (z - X t) + t.

    Attributes
    ----------
    elimination : ParameterElimination
        T and t.
    phi : array (free,)
        Free parameters.
    E : array (samples, free)
        Equivalent regressors of the weighted measurements, A = pinv(E).
    design : array (samples, free)
        Equivalent regressors that return the parameters of a model without error from its samples;
        with them tables are compared.
    carrier : array (samples, free)
        As E, with regressors that are orthogonal to the weighted residual: they carry the
        disturbance into the estimate.
    X : array (samples, free)
        Regressors whose collinearity counts, with weights.
    motion : array (samples, free)
        Regressors with whose size a disturbance may grow: without the noise that the residual has.
    information : array (free, free)
        Matrix of the quadratic cost.
    root : array (samples,)
        Roots of the weights.
    added : array (free, free)
        Covariance beyond that of a disturbance that is independent of the regressors.
    variables, attributes : dict
        Further variables of the free parameters, and attributes.
    influence : callable, optional
        From the residual (samples,) without weights to that whose least squares with `carrier` have
        the standard errors of the estimate. Default: the weighted residual.
    """

    elimination: ParameterElimination
    phi: np.ndarray
    E: np.ndarray
    design: np.ndarray
    carrier: np.ndarray
    X: np.ndarray
    motion: np.ndarray
    information: np.ndarray
    root: np.ndarray
    added: np.ndarray
    variables: dict[str, Any]
    attributes: dict[str, Any]
    influence: Callable[[np.ndarray], np.ndarray] | None = None


Solve = Callable[[ParameterElimination], LinearSolution]


def prepare_problem(
    model: RegressionModel,
    data: xr.Dataset | Sequence[xr.Dataset],
    name: str,
    intercepts: str,
    needed: Sequence[str],
) -> RegressionProblem:
    """Return the samples and regressors of a model; arguments as of `regress`.

    Parameters
    ----------
    model, data, name, intercepts
    needed : sequence of str
        Variables without which a sample is ignored.
    """
    samples = stack_samples(model.coefficient, needed, data, purpose=model)
    X, terms = model.design(samples.data), list(model.terms)
    if intercepts == "separate":
        X, terms = separate_intercepts(X, terms, samples.data["manoeuvre"].values)
    return RegressionProblem(name, model, samples, X=X, terms=terms, intercepts=intercepts)


def demand_choice(what: str, choice: str, allowed: Sequence[str]) -> None:
    """Raise ValueError when a word is not among the allowed words."""
    if choice not in allowed:
        raise ValueError(f"{what} is {choice!r}; allowed: {', '.join(allowed)}")


def demand_determined(
    name: str, model: object, z: np.ndarray, X: np.ndarray, terms: Sequence[str]
) -> None:
    """Raise when the samples cannot determine the terms.

    Parameters
    ----------
    name : str
        Name of the fit, for the error message.
    model : object
        Model, for the error message.
    z : array (samples,)
        Measured coefficient.
    X : array (samples, terms)
        Regressors.
    terms : sequence of str

    Raises
    ------
    IdentificationError
        Too few samples, a variable that does not move, or combinations that vanish.
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
    """Return regressors and terms with one intercept per manoeuvre in place of the term ``1``.

    Parameters
    ----------
    X : array (samples, terms)
    terms : list of str
    manoeuvre : array of int (samples,)
        Number of the manoeuvre of each sample.

    Raises
    ------
    IdentificationError
        The model has no term ``1``.
    """
    if "1" not in terms:
        raise IdentificationError("intercepts='separate' needs the term 1 in the model")
    numbers = np.unique(manoeuvre)
    columns = (manoeuvre[:, None] == numbers).astype(float)
    position = terms.index("1")
    constants = [f"1[{number}]" for number in numbers]
    X_separate = np.hstack([X[:, :position], columns, X[:, position + 1 :]])
    return X_separate, [*terms[:position], *constants, *terms[position + 1 :]]


def _demand_movement(z: np.ndarray, X: np.ndarray, terms: Sequence[str]) -> None:
    """Raise when a single variable does not move: next to a constant it cannot have a slope."""
    if np.ptp(z) == 0.0:
        raise IdentificationError("the coefficient is constant; look at its accelerations")
    is_constant = least_squares.intercept_mask(terms)
    if not is_constant.any():
        return
    for column, term, constant in zip(X.T, terms, is_constant):
        if constant:
            continue
        factors = term_powers(term)
        if list(factors.values()) != [1]:
            continue  # the limits are those of single variables, not of products and powers
        name = variable_of(next(iter(factors)))
        least = LEAST_MOVEMENT.get(lookup(name).units, 0.0)
        if np.std(column) < least:
            raise IdentificationError(
                f"{term} does not move: rms {np.std(column):.2g} about its mean, {least:.2g} "
                f"is needed; leave it out or add a manoeuvre"
            )
