"""Equation error in the frequency domain: a linear model fitted to finite Fourier transforms.

The method is that of [Klein2006]_ and [Morelli2006]_. The fit uses only the band with excitation.
Drift, trim and the noise above the band do not enter, and no lag window has to be chosen.

- The mean and the trend of every stretch are removed. The stretch is transformed at the multiples
  of one over its duration and divided by the root of the duration. Long and short stretches then
  have the weight of their information.
- Parameters are real, so every frequency gives two real equations.
- The noise may vary through the band. The noise of accelerations from positions grows with the
  fourth power of the frequency. The equations are then weighted by the spectrum of the residual
  [Whittle1953]_. Without weights the noisiest frequencies determine the estimates.
- Such noise leaks from its loud frequencies into the quiet ones. The leakage of each stretch is a
  constant plus multiples of j omega and of 1/(j omega): the differences of the integrals of the
  noise between the ends, and the removed trend. These multiples are estimated with the terms.
- The constant of the model is estimated afterwards in time.

References
----------
.. [Morelli2006] Morelli, Practical aspects of the equation-error method for aircraft parameter
   estimation, AIAA 2006-6144.
.. [Klein2006] Klein, Morelli, Aircraft System Identification, AIAA 2006, chapter 7.
.. [Whittle1953] Whittle, Estimation and information in stationary time series, Arkiv foer
   Matematik 2, 1953.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flightmech.support.arrays import rms
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.fit_remarks import unsettled_attributes
from flighttest.regression.equation_error.least_squares import ridge_penalty
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.samples import RegressionSamples, slopes_of, stack_samples
from flighttest.regression.equation_error.slope_errors import (
    SlopeErrors,
    estimate_slope_errors,
    map_samples_to_slopes,
)
from flighttest.regression.equation_error.spectral_weights import (
    equal_weights,
    whitening_weights,
)
from flighttest.regression.equation_error.time_domain import (
    demand_choice,
    demand_determined,
    separate_intercepts,
)
from flighttest.regression.equation_error.transformed_stretches import (
    TransformedStretch,
    fill_rows,
    select_stretches,
    stack_complex,
    transform_columns,
)
from flighttest.regression.uncertainty import collinearity, significance
from flighttest.regression.uncertainty.coloured_residuals import coloured_covariance_of
from flighttest.remarks import Convergence

# least rms of a regressor inside the band, over its largest value: below, only rounding moves it
_EXCITED = 1e-6
WEIGHTS = ("equal", "spectrum")
_NO_WINDOW = "standard error by a lag window; none in frequency"


def regress_frequency(
    model: RegressionModel,
    data: xr.Dataset | Sequence[xr.Dataset],
    band: tuple[float, float],
    name: str = "",
    intercepts: str = "common",
    spacing: float | None = None,
    ridge: float | str = 0.0,
    weights: str = "equal",
) -> Fit:
    """Fit a model to measured coefficients by least squares over the frequencies of a band.

    Parameters
    ----------
    model : RegressionModel
        Coefficient and terms; ``1`` is the constant, which is estimated in time.
    data : Dataset (time,) or list of them
        Manoeuvres, as `coefficients` returns them.
    band : (low, high)
        Band of the excitation: 0.1 to 2 Hz for a small aeroplane, 0.05 to 1.5 Hz for a jet. [Hz]
    name : str
        Name of the fit in reports and in the provenance.
    intercepts : {"common", "separate"}
        One constant, or one per manoeuvre. The slopes do not depend on this choice, because the
        mean of every stretch is removed.
    spacing : float, optional
        Spacing of the frequencies; default one over the duration. Closer frequencies are not
        independent; the standard errors account for it. [Hz]
    ridge : float or "auto"
        Ridge parameter, as in `regress`.
    weights : {"equal", "spectrum"}
        ``spectrum`` weights every frequency by the inverse of the residual's spectrum and removes
        the leakage of the ends of the stretches. It is meant for noise that grows with frequency,
        such as that of coefficients from measured positions.

    Returns
    -------
    Fit
        ``stderr`` follows the spectrum of the residual through the band. It is multiplied by
        Student's t if the frequencies are few. ``stderr_white`` assumes a flat spectrum.
        Attributes ``R2`` inside the band, without weights, ``R2_time`` over the samples, ``band``,
        ``frequencies``.

    Raises
    ------
    IdentificationError
        No stretch reaches down to the band, too few frequencies, or terms that the data cannot
        distinguish.
    UnknownName
        A variable that the data do not hold.

    Notes
    -----
    theta = [Re(X* X)]^-1 Re(X* z), covariance 1/2 s^2 [Re(X* X)]^-1 with s^2 = 2 v* v/(2 M - n).
    Each of the M frequencies is two real equations. A white disturbance therefore gets the same
    standard errors as in time. [Klein2006]_ divides by M - n without the half, which makes the
    standard errors larger by the root of two. Frequencies at a spacing df below 1/T multiply the
    covariance by 1/(T df).
    """
    demand_choice("intercepts", intercepts, ("common", "separate"))
    demand_choice("weights", weights, WEIGHTS)
    samples = stack_samples(model.coefficient, model.variables, data, model)
    X, terms = model.design(samples.data), list(model.terms)
    if intercepts == "separate":
        X, terms = separate_intercepts(X, terms, samples.data["manoeuvre"].values)
    demand_determined(name, model, z=samples.data[model.coefficient].values, X=X, terms=terms)
    parts = select_stretches(samples, band, spacing)
    problem = _FrequencyProblem(model, samples, X=X, terms=terms, parts=parts)
    estimates, estimator, errors = _solve(problem, name, ridge=ridge, weights=weights)
    estimates.attrs.update(
        name=name,
        intercepts=intercepts,
        band=f"{band[0]:g} ... {band[1]:g}",
        frequencies=sum(len(part.frequencies) for part in parts),
    )
    return Fit(
        name=name,
        model=model,
        estimates=estimates,
        data=samples.for_fit(model.coefficient, errors),
        design=least_squares.label_terms(least_squares.equivalent_regressors(estimator), terms),
        regressors=least_squares.label_terms(X, terms),
    )


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
class _FrequencyProblem:
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

    @property
    def slopes(self) -> list[str]:
        """Terms that are not intercepts."""
        return [term for term, flag in zip(self.terms, self.is_constant) if not flag]


@dataclass(frozen=True)
class _LinearEstimate:
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
class _SlopeFit:
    """Fit of the slopes in the frequency domain.

    Attributes
    ----------
    estimate : _LinearEstimate
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
    """

    estimate: _LinearEstimate
    errors: SlopeErrors
    R2: float
    variables: dict[str, Any]
    ridge: float
    weighting: Convergence


def _fit_slopes(
    problem: _FrequencyProblem, name: str, ridge: float | str, weights: str
) -> _SlopeFit:
    """Return the slopes from the transformed equations."""
    model, z, parts = problem.model, problem.z, problem.parts
    is_constant, slopes = problem.is_constant, problem.slopes
    if not slopes:
        raise IdentificationError(
            f"{model} has no slope; a spectrum without its mean contains no information "
            f"about a constant"
        )
    X_slopes = problem.X[:, ~is_constant]
    Xf, zf = transform_columns(X_slopes, parts), transform_columns(z[:, None], parts)[:, 0]
    label = str(model)
    if name:
        label = f"{name}: {model}"
    demand_frequencies(label, Xf, X=X_slopes, parts=parts, terms=slopes)
    if weights == "spectrum":
        whitened = whitening_weights(Xf, zf, parts)
    else:
        whitened = equal_weights(len(zf))

    # Real equations, two per frequency: [Klein2006] chapter 7, with weights and a ridge.
    X2, z2 = whitened.equations(Xf), whitened.equations(zf[:, None])[:, 0]
    no_constant = np.zeros(len(slopes), bool)
    penalty, parameter = ridge_penalty(ridge, X2, z=z2, fixed=no_constant)
    theta, E = least_squares.solve_least_squares(X2, z2, penalty)
    v = whitened.residual(zf, Xf, theta)
    D = least_squares.estimator_matrix(E) * np.tile(whitened.root, 2)
    errors = estimate_slope_errors(v, E, D=D, whitened=whitened, parts=parts)

    # The contribution of a term is its share in the rms of the coefficient inside the band.
    variables = least_squares.regressor_diagnostics(X2, no_constant)
    variables = least_squares.spread_diagnostics(variables, is_constant)
    share = np.sqrt((np.abs(Xf) ** 2).sum(axis=0) / (np.abs(zf) ** 2).sum())
    variables["contribution"] = "term", _fill_terms(is_constant, share * np.abs(theta))
    variables["stderr_window"] = (
        "term",
        np.full(len(is_constant), np.nan),
        {"long_name": _NO_WINDOW},
    )
    if parameter:
        bias = _fill_terms(is_constant, least_squares.ridge_bias(X2, z2, penalty))
        variables["shrinkage"] = "term", bias, {"long_name": least_squares.RIDGE_BIAS}
    A = map_samples_to_slopes(D, parts, samples=len(z))
    return _SlopeFit(
        estimate=_LinearEstimate(theta, errors.covariance, white=errors.white, A=A, offset=0.0),
        errors=errors,
        R2=1.0 - float((np.abs(v) ** 2).sum() / (np.abs(zf) ** 2).sum()),
        variables=variables,
        ridge=parameter,
        weighting=whitened.convergence,
    )


def _solve(
    problem: _FrequencyProblem, name: str, ridge: float | str, weights: str
) -> tuple[xr.Dataset, np.ndarray, np.ndarray]:
    """Return estimates, their linear map (terms, samples), and the common errors of the samples."""
    model, samples, z, is_constant = problem.model, problem.samples, problem.z, problem.is_constant
    slope_fit = _fit_slopes(problem, name, ridge=ridge, weights=weights)
    estimate = _add_constants(problem, slope_fit.estimate)
    response = slopes_of(model, estimate.theta)
    sources, errors = samples.errors(model.coefficient, model.variables, response)
    estimates = least_squares.regression_estimates(
        problem.terms,
        estimate.theta,
        covariance=estimate.covariance,
        white=estimate.white,
        systematic=(sources, estimate.A @ errors.T),
        extra=slope_fit.variables,
    )
    residual = z - problem.X @ estimate.theta
    estimates.attrs = {
        "coefficient": model.coefficient,
        "domain": "frequency",
        "R2": slope_fit.R2,
        "R2_time": 1.0 - float(residual @ residual) / float(((z - z.mean()) ** 2).sum()),
        "residual_rms": rms(residual),
        "samples": len(z),
        "manoeuvres": len(samples.steps),
        "offset": estimate.offset,
        "weights": weights,
        "ridge": slope_fit.ridge,
        **significance.residual_whiteness(residual, *samples.pieces()),
        **unsettled_attributes("weights", slope_fit.weighting),
        **unsettled_attributes("spectrum", slope_fit.errors.convergence),
    }
    # A constant has the fewest degrees of freedom of all slopes, and no Student's factor.
    dof = np.full(len(is_constant), slope_fit.errors.freedom.min())
    factor = np.ones(len(is_constant))
    dof[~is_constant], factor[~is_constant] = slope_fit.errors.freedom, slope_fit.errors.factor
    estimates = significance.add_tests(estimates, is_constant, dof=dof, inflated=factor)
    return estimates, estimate.A, errors


def _add_constants(problem: _FrequencyProblem, slopes: _LinearEstimate) -> _LinearEstimate:
    """Return slopes and constants together; the constants are the mean residuals in time."""
    X, z, is_constant = problem.X, problem.z, problem.is_constant
    n = len(is_constant)
    theta, white, C, A = np.zeros(n), np.zeros(n), np.zeros((n, n)), np.zeros((n, len(z)))
    theta[~is_constant], white[~is_constant] = slopes.theta, slopes.white
    # Slopes come from the frequencies; their rows and columns are those without constants.
    A[~is_constant] = slopes.A
    C[np.ix_(~is_constant, ~is_constant)] = slopes.covariance
    if not is_constant.any():
        return _LinearEstimate(theta, C, white=white, A=A, offset=0.0)
    # Means over the samples of each constant, as a linear map P of the residual.
    P = least_squares.estimator_matrix(X[:, is_constant])
    theta[is_constant] = P @ (z - X[:, ~is_constant] @ slopes.theta)
    v = z - X @ theta
    scatter = coloured_covariance_of(X[:, is_constant], v, *problem.samples.pieces())
    # A constant depends on the slopes through the mean regressors: its estimate is
    # P (z - X theta), so its covariance is that of the residual plus the propagated one.
    means = P @ X[:, ~is_constant]
    A[is_constant] = P - means @ slopes.A
    C[np.ix_(is_constant, is_constant)] = scatter.covariance + means @ slopes.covariance @ means.T
    C[np.ix_(is_constant, ~is_constant)] = -means @ slopes.covariance
    C[np.ix_(~is_constant, is_constant)] = C[np.ix_(is_constant, ~is_constant)].T
    white[is_constant] = np.sqrt(
        (v @ v) / (len(v) - n) * (P**2).sum(axis=1) + means**2 @ slopes.white**2
    )
    return _LinearEstimate(theta, C, white=white, A=A, offset=scatter.offset)


def _fill_terms(is_constant: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return values of the slopes at the positions of all terms; zero for constants."""
    filled = np.zeros(len(is_constant))
    filled[~is_constant] = values
    return filled
