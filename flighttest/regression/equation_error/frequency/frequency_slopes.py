"""Slopes in the frequency domain: the transformed equations of a model, under an elimination.

`flighttest.regression.equation_error.frequency.frequency_domain` describes the method.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from flightmech.errors import IdentificationError
from flighttest.parameter_constraints import ParameterElimination
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.frequency.slope_errors import (
    SlopeErrors,
    estimate_slope_errors,
    map_samples_to_slopes,
)
from flighttest.regression.equation_error.frequency.spectral_weights import (
    equal_weights,
    whitening_weights,
)
from flighttest.regression.equation_error.frequency.transformed_stretches import (
    TransformedStretch,
    fill_rows,
    stack_complex,
    transform_columns,
)
from flighttest.regression.equation_error.least_squares import ridge_penalty
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.problem import spell_term
from flighttest.regression.equation_error.samples import RegressionSamples
from flighttest.regression.uncertainty import collinearity
from flighttest.remarks import Convergence

# least rms of a regressor inside the band, over its largest value: below, only rounding moves it
_EXCITED = 1e-6
_NO_WINDOW = "standard error by a lag window; none in frequency"


def demand_frequencies(
    label: str,
    rows: np.ndarray,
    X: np.ndarray,
    parts: Sequence[TransformedStretch],
    terms: Sequence[str],
) -> None:
    """Raise when the transformed equations cannot determine the terms.

    Parameters
    ----------
    label : str
        Start of the error message.
    rows : complex array (rows, terms)
        Transformed regressors.
    X : array (samples, terms)
        Regressors in time.
    parts : sequence of TransformedStretch
    terms : sequence of str

    Raises
    ------
    IdentificationError
        Too few frequencies, a term without excitation in the band, or combinations that vanish
        there.
    """
    if len(rows) < 2 * len(terms):
        raise IdentificationError(
            f"{label}: {len(rows)} frequencies for {len(terms)} slopes; at least two per "
            f"slope are needed: widen the band"
        )
    # rms of each regressor inside the band, by Parseval's theorem: the rows are over root(T)
    duration = fill_rows(parts, [part.duration for part in parts])
    inside = np.sqrt(2.0 * (np.abs(rows) ** 2 / duration[:, None]).sum(axis=0) / len(parts))
    is_idle = inside < _EXCITED * np.abs(X).max(axis=0)
    idle = [term for term, flag in zip(terms, is_idle) if flag]
    if idle:
        verb = "is" if len(idle) == 1 else "are"
        raise IdentificationError(
            f"{label}: {', '.join(idle)} {verb} not excited inside the band; leave the term out, "
            f"add a manoeuvre, or work in time"
        )
    try:
        collinearity.demand_rank(stack_complex(rows), terms)
        collinearity.demand_independence(stack_complex(rows), np.zeros(len(terms), bool), terms)
    except IdentificationError as error:
        raise IdentificationError(f"{label}: inside the band {error}") from None


@dataclass(frozen=True)
class FrequencyProblem:
    """Samples, regressors in time (samples, terms), and the stretches to transform."""

    model: RegressionModel
    samples: RegressionSamples
    X: np.ndarray
    terms: list[str]
    parts: list[TransformedStretch]

    @property
    def z(self) -> np.ndarray:
        """Measured coefficient, (samples,)."""
        return self.samples.data[self.model.coefficient].values

    @cached_property
    def is_constant(self) -> np.ndarray:
        """Mask of the intercepts, (terms,)."""
        return least_squares.intercept_mask(self.terms)

    def spell(self, name: str) -> str:
        """Return the spelling of a term in a constraint."""
        return spell_term(name, self.model.coefficient)

    @property
    def terms_of_constants(self) -> list[str]:
        """Intercepts."""
        return [term for term, flag in zip(self.terms, self.is_constant) if flag]

    @property
    def slopes(self) -> list[str]:
        """Terms that are not intercepts."""
        return [term for term, flag in zip(self.terms, self.is_constant) if not flag]


@dataclass(frozen=True)
class SlopeEstimate:
    """Estimates theta = A z of some terms, with their errors.

    Attributes
    ----------
    theta : array (terms,)
    covariance : array (terms, terms)
    white : array (terms,)
        Standard errors for a white residual.
    A : array (terms, samples)
        Linear map from the measured coefficient to the estimates.
    offset : float
        Standard deviation of a constant between stretches.
    """

    theta: np.ndarray
    covariance: np.ndarray
    white: np.ndarray
    A: np.ndarray
    offset: float


@dataclass(frozen=True)
class SlopeFit:
    """Fit of the slopes in the frequency domain.

    Attributes
    ----------
    estimate : SlopeEstimate
        Slopes only.
    errors : SlopeErrors
    R2 : float
        Coefficient of determination inside the band, without weights.
    variables : dict
        Diagnostics of all terms, as variables of a Dataset.
    ridge : float
        Ridge parameter, zero without ridge.
    weighting : Convergence
        End of the alternation of weights and fit.
    elimination : ParameterElimination
        Slopes as a function of the free ones.
    phi : array (free slopes,)
    information : array (free slopes, free slopes)
        Matrix of the quadratic cost.
    """

    estimate: SlopeEstimate
    errors: SlopeErrors
    R2: float
    variables: dict[str, Any]
    ridge: float
    weighting: Convergence
    elimination: ParameterElimination
    phi: np.ndarray
    information: np.ndarray


def fit_slopes(
    problem: FrequencyProblem,
    name: str,
    elimination: ParameterElimination,
    *,
    ridge: float | str,
    weights: str,
) -> SlopeFit:
    """Return the slopes from the transformed equations: theta = T phi + t."""
    model, z, parts = problem.model, problem.z, problem.parts
    is_constant, slopes = problem.is_constant, problem.slopes
    T, offset = elimination.matrix, elimination.offset
    free = [slopes[k] for k in elimination.free]
    X_all = problem.X[:, ~is_constant]
    X_slopes, rest = X_all @ T, z - X_all @ offset
    Xf, zf = transform_columns(X_slopes, parts), transform_columns(rest[:, None], parts)[:, 0]
    label = str(model)
    if name:
        label = f"{name}: {model}"
    demand_frequencies(label, Xf, X=X_slopes, parts=parts, terms=free)
    if weights == "spectrum":
        whitened = whitening_weights(Xf, zf, parts)
    else:
        whitened = equal_weights(len(zf))

    # Real equations, two per frequency: [Klein2006] chapter 7, with weights and a ridge.
    X2, z2 = whitened.equations(Xf), whitened.equations(zf[:, None])[:, 0]
    no_constant = np.zeros(len(free), bool)
    penalty, parameter = ridge_penalty(ridge, X2, z=z2, fixed=no_constant)
    phi, E = least_squares.solve_least_squares(X2, z2, penalty)
    v = whitened.residual(zf, Xf, phi)
    D = least_squares.estimator_matrix(E) * np.tile(whitened.root, 2)
    errors = estimate_slope_errors(v, E, D=D, whitened=whitened, parts=parts)

    # The contribution of a term is its share in the rms of the coefficient inside the band.
    variables = least_squares.regressor_diagnostics(X2, no_constant)
    is_missing = is_constant.copy()
    is_missing[~is_constant] = ~elimination.is_free
    variables = least_squares.spread_diagnostics(variables, is_missing)
    theta = elimination.expand(phi)
    Xa = transform_columns(np.column_stack([z, X_all]), parts)
    total = float((np.abs(Xa[:, 0]) ** 2).sum())
    share = np.sqrt((np.abs(Xa[:, 1:]) ** 2).sum(axis=0) / total)
    variables["contribution"] = "term", _fill_terms(is_constant, share * np.abs(theta))
    variables["stderr_window"] = (
        "term",
        np.full(len(is_constant), np.nan),
        {"long_name": _NO_WINDOW},
    )
    if parameter:
        bias = _fill_terms(is_constant, T @ least_squares.ridge_bias(X2, z2, penalty))
        variables["shrinkage"] = "term", bias, {"long_name": least_squares.RIDGE_BIAS}
    A = T @ map_samples_to_slopes(D, parts, samples=len(z))
    errors = _expand_errors(errors, elimination, D)
    return SlopeFit(
        estimate=SlopeEstimate(theta, errors.covariance, white=errors.white, A=A, offset=0.0),
        errors=errors,
        R2=1.0 - float((np.abs(v) ** 2).sum()) / total,
        variables=variables,
        ridge=parameter,
        weighting=whitened.convergence,
        elimination=elimination,
        phi=phi,
        information=X2.T @ X2 + np.diag(penalty),
    )


def _expand_errors(
    errors: SlopeErrors, elimination: ParameterElimination, D: np.ndarray
) -> SlopeErrors:
    """Return the errors of all slopes from those of the free ones, phi = D [Re z; Im z].

    A slope has the fewest degrees of freedom of the free slopes that it follows.
    """
    T = elimination.matrix
    if elimination.is_free.all():
        return errors
    own = np.sqrt((D**2).sum(axis=1))
    correlation = (D @ D.T) / np.outer(own, own)
    white = T @ (correlation * np.outer(errors.white, errors.white)) @ T.T
    follows = T != 0.0
    freedom = np.where(follows, errors.freedom, np.inf).min(axis=1)
    freedom[~follows.any(axis=1)] = errors.freedom.max()
    factor = np.where(follows, errors.factor, 1.0).max(axis=1)
    return replace(
        errors,
        covariance=elimination.expand_covariance(errors.covariance),
        white=np.sqrt(np.maximum(np.diag(white), 0.0)),
        freedom=freedom,
        factor=factor,
    )


def _fill_terms(is_constant: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return values of the slopes at the positions of all terms; zero for constants."""
    filled = np.zeros(len(is_constant))
    filled[~is_constant] = values
    return filled
