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

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flightmech.support.arrays import rms
from flighttest.parameter_constraints import (
    choose_active,
    eliminate,
    parse_constraints,
    rate_constraints,
)
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.fit_remarks import unsettled_attributes
from flighttest.regression.equation_error.frequency.frequency_slopes import (
    FrequencyProblem,
    SlopeEstimate,
    SlopeFit,
    fit_slopes,
)
from flighttest.regression.equation_error.frequency.transformed_stretches import (
    select_stretches,
)
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.problem import (
    demand_choice,
    demand_determined,
    separate_intercepts,
)
from flighttest.regression.equation_error.samples import Response, slopes_of, stack_samples
from flighttest.regression.uncertainty import significance
from flighttest.regression.uncertainty.coloured_residuals import coloured_covariance_of

WEIGHTS = ("equal", "spectrum")


def regress_frequency(
    model: RegressionModel,
    data: xr.Dataset | Sequence[xr.Dataset],
    band: tuple[float, float],
    name: str = "",
    intercepts: str = "common",
    spacing: float | None = None,
    ridge: float | str = 0.0,
    weights: str = "equal",
    constraints: Sequence[str] = (),
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
    constraints : sequence of str
        Linear constraints among the slopes, as in `regress`. The constant is estimated afterwards
        and cannot be in a constraint.

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
    SchemaError
        Constraints that cannot be read, that contradict each other, or that hold a constant.

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
    parts = select_stretches(samples, band, spacing)
    problem = FrequencyProblem(model, samples, X=X, terms=terms, parts=parts)
    slope_fit, stored = _fit_constrained(problem, name, constraints, ridge=ridge, weights=weights)
    estimates, estimator, errors = _describe_fit(problem, slope_fit, weights=weights)
    estimates.attrs.update(
        name=name,
        intercepts=intercepts,
        band=f"{band[0]:g} ... {band[1]:g}",
        frequencies=sum(len(part.frequencies) for part in parts),
    )
    if constraints:
        estimates.attrs["constraints"] = stored
    design = np.linalg.pinv(estimator)
    if slope_fit.elimination.is_free.all():
        design = least_squares.equivalent_regressors(estimator)
    return Fit(
        name=name,
        model=model,
        estimates=estimates,
        data=samples.for_fit(model.coefficient, errors),
        design=least_squares.label_terms(design, terms),
        regressors=least_squares.label_terms(X, terms),
    )


def _fit_constrained(
    problem: FrequencyProblem,
    name: str,
    constraints: Sequence[str],
    *,
    ridge: float | str,
    weights: str,
) -> tuple[SlopeFit, str]:
    """Return the slopes under constraints, and the rated constraints as in `fit_problem`."""
    slopes = problem.slopes
    if not slopes:
        raise IdentificationError(
            f"{problem.model} has no slope; a spectrum without its mean contains no information "
            f"about a constant"
        )
    parsed = parse_constraints(constraints, slopes, problem.spell)
    equalities = [constraint for constraint in parsed if constraint.is_equality]
    limits = [constraint for constraint in parsed if not constraint.is_equality]
    held, active = eliminate(equalities, len(slopes)), equalities
    free = [*problem.terms_of_constants, *(slopes[k] for k in held.free)]
    X = np.hstack(
        [problem.X[:, problem.is_constant], problem.X[:, ~problem.is_constant] @ held.matrix]
    )
    demand_determined(name, problem.model, z=problem.z, X=X, terms=free)
    found = fit_slopes(problem, name, held, ridge=ridge, weights=weights)
    if limits:
        violated = choose_active(limits, held, found.phi, found.information)
        if violated:
            active = [*equalities, *violated]
            # one ridge parameter for all choices of inequalities
            found = fit_slopes(
                problem, name, eliminate(active, len(slopes)), ridge=found.ridge, weights=weights
            )
    if not parsed:
        return found, ""
    theta, covariance = np.full(len(slopes), np.nan), np.zeros((len(slopes), len(slopes)))
    try:
        # without any constraint and without a ridge: what the data alone state about them
        alone = fit_slopes(problem, name, eliminate([], len(slopes)), ridge=0.0, weights=weights)
        A, samples = alone.estimate.A, problem.samples
        _, errors = samples.errors(
            problem.model.coefficient, problem.model.variables, _responses(problem, alone)
        )
        D = A @ errors.T
        theta, covariance = alone.estimate.theta, alone.estimate.covariance + D @ D.T
    except IdentificationError:
        pass
    return found, rate_constraints(parsed, active, theta, covariance)


def _responses(problem: FrequencyProblem, fit: SlopeFit) -> Response:
    """Return the slopes of a fit for the errors of the samples; constants do not enter them."""
    theta = np.zeros(len(problem.terms))
    theta[~problem.is_constant] = fit.estimate.theta
    return slopes_of(problem.model, theta)


def _describe_fit(
    problem: FrequencyProblem, slope_fit: SlopeFit, *, weights: str
) -> tuple[xr.Dataset, np.ndarray, np.ndarray]:
    """Return estimates, their linear map (terms, samples), and the common errors of the samples."""
    model, samples, z, is_constant = problem.model, problem.samples, problem.z, problem.is_constant
    free = int(is_constant.sum()) + len(slope_fit.phi)
    estimate = _add_constants(problem, slope_fit.estimate, free)
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
    # The F test is that of the free slopes; the others follow them.
    untested, is_fixed = is_constant.copy(), np.zeros(len(is_constant), bool)
    untested[~is_constant] = ~slope_fit.elimination.is_free
    is_fixed[~is_constant] = slope_fit.elimination.is_fixed
    estimates = significance.add_tests(estimates, untested, dof=dof, inflated=factor)
    for key in ("t", "p_value"):
        estimates[key] = estimates[key].where(~is_fixed)
    return estimates, estimate.A, errors


def _add_constants(problem: FrequencyProblem, slopes: SlopeEstimate, free: int) -> SlopeEstimate:
    """Return slopes and constants together; the constants are the mean residuals in time.

    `free` is the number of free parameters.
    """
    X, z, is_constant = problem.X, problem.z, problem.is_constant
    n = len(is_constant)
    theta, white, C, A = np.zeros(n), np.zeros(n), np.zeros((n, n)), np.zeros((n, len(z)))
    theta[~is_constant], white[~is_constant] = slopes.theta, slopes.white
    # Slopes come from the frequencies; their rows and columns are those without constants.
    A[~is_constant] = slopes.A
    C[np.ix_(~is_constant, ~is_constant)] = slopes.covariance
    if not is_constant.any():
        return SlopeEstimate(theta, C, white=white, A=A, offset=0.0)
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
        (v @ v) / (len(v) - free) * (P**2).sum(axis=1) + means**2 @ slopes.white**2
    )
    return SlopeEstimate(theta, C, white=white, A=A, offset=scatter.offset)
