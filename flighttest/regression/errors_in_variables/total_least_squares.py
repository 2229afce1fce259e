"""Total least squares with a known covariance of the noise of the regressors.

The noise of the regressors adds N S to X'X, with the covariance S of the noise of one sample. The
estimate subtracts it:

    theta = (X'X - N S)^-1 X'z

Under constraints theta = T phi + t it is the minimum of theta'(X'X - N S) theta - 2 theta'X'z.

It is the generalised total least squares of [VanHuffel1991]_ for exact and noisy columns, at the
generalised singular value that the stated noise has. The noise of the coefficient stays unknown, as
disturbances of a flight are [Fuller1987]_ 2.2 and 3.1. S of products and powers follows from their
derivatives by the noisy variables, averaged over the samples.

The covariance of the estimate is that of [Gleser1981]_ and [Fuller1987]_ (2.2.20),

    (X'X - N S)^-1 [Y'R Y + 2 N c S theta theta' S] (X'X - N S)^-1

with the autocovariance R of a coloured residual, the regressors Y without the part that the
residual v explains (x + S theta v/var(v)), and the samples c per independent square. For white
residuals it is theirs, with Y'Y = X'X - N S theta theta' S/var(v).

References
----------
.. [VanHuffel1991] Van Huffel, Vandewalle, The total least squares problem, SIAM 1991, chapter 10.
.. [Fuller1987] Fuller, Measurement error models, Wiley 1987.
.. [Gleser1981] Gleser, Estimation in a multivariate errors in variables regression model: large
   sample results, Annals of Statistics 9, 1981.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, UnknownName
from flightmech.names import lookup
from flighttest.parameter_constraints import ParameterElimination
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.problem import (
    LinearSolution,
    RegressionProblem,
    demand_choice,
    prepare_problem,
)
from flighttest.regression.equation_error.samples import RegressionSamples
from flighttest.regression.equation_error.time_domain import fit_problem
from flighttest.regression.errors_in_variables.instrumental_variables import describe_powers
from flighttest.regression.uncertainty.growing_residuals import memory_of_squares

# Share of the noise in the movement of the worst combination of terms above which the difference
# X'X - N S is badly determined.
MOST_NOISE = 0.75
_SYMMETRIC = 1e-9  # difference of two correlations that is rounding
_SEEN = 1.5  # ratio of stated noise and scatter from sample to sample from which on it is remarked
_NEGLIGIBLE = 1e-4  # share of noise below which a wrong statement of it changes nothing


def regress_total(
    model: RegressionModel,
    data: xr.Dataset | Sequence[xr.Dataset],
    noise: Mapping[str, float] | xr.DataArray,
    name: str = "",
    intercepts: str = "common",
    constraints: Sequence[str] = (),
) -> Fit:
    """Fit a model to measured coefficients by total least squares.

    Parameters
    ----------
    model, data, name, intercepts, constraints
        As of `regress`.
    noise : mapping of str to float, or DataArray (variable, variable_)
        Standard deviation of the noise of model variables, independent of each other, or their
        covariance. Other variables are exact. [SI]

    Returns
    -------
    Fit
        ``least_squares`` is the equation error. The attribute ``method`` is ``total least
        squares``, ``noise_share`` the share of the noise in the worst combination of terms.

    Raises
    ------
    IdentificationError
        No stated noise, a noise that is not positive, noise as large as the motion, or as of
        `regress`.
    UnknownName
        A variable that the model or the data do not hold.
    SchemaError
        Constraints that cannot be read.
    """
    demand_choice("intercepts", intercepts, ("common", "separate"))
    covariance = _noise_covariance(model, noise)
    problem = prepare_problem(
        model, data, name=name, intercepts=intercepts, needed=list(model.variables)
    )
    noisy = list(covariance["variable"].values)
    S = _term_noise(problem, noisy, covariance.values)

    def solve(elimination: ParameterElimination) -> LinearSolution:
        return _solve_total(problem, elimination, S)

    fit = fit_problem(problem, solve, constraints=constraints)
    attributes, share = fit.estimates.attrs, fit.estimates.attrs["noise_share"]
    sizes = np.sqrt(np.diag(covariance.values))
    stated = ", ".join(
        f"{name} {size:.3g} {lookup(name).units}" for name, size in zip(noisy, sizes)
    )
    attributes["noise_treatment"] = (
        f"stated noise: {stated}; at most {share:.1%} of the movement of a combination of terms"
    )
    has_correlated_noise = bool(covariance.values[~np.eye(len(noisy), dtype=bool)].any())
    if text := describe_powers(problem.terms, noisy, has_correlated_noise=has_correlated_noise):
        attributes["nonlinear_noise"] = text
    if share > _NEGLIGIBLE and (text := _compare_with_scatter(problem.samples, noisy, sizes)):
        attributes["stated_noise"] = text
    return fit


def _noise_covariance(
    model: RegressionModel, noise: Mapping[str, float] | xr.DataArray
) -> xr.DataArray:
    """Return the covariance (variable, variable_) of the noise of the variables."""
    if isinstance(noise, xr.DataArray):
        names, matrix = _named_covariance(noise)
    else:
        names = list(noise)
        matrix = np.diag(np.array([float(size) for size in noise.values()]) ** 2)
    if not names:
        raise IdentificationError(
            "total least squares needs the noise of the regressors; state the standard deviation "
            "of each noisy variable, or use instrumental variables"
        )
    for name in names:
        if name not in model.variables:
            raise UnknownName(name, model.variables, "noisy variable", "the model does not hold it")
    if not _is_covariance(matrix, len(names)):
        raise IdentificationError(
            f"the noise of {', '.join(names)} is not a positive standard deviation of each, or not "
            f"a covariance; leave out variables without noise"
        )
    return xr.DataArray(
        matrix, {"variable": names, "variable_": names}, dims=("variable", "variable_")
    )


def _named_covariance(noise: xr.DataArray) -> tuple[list[str], np.ndarray]:
    """Return the variables of a covariance, and its matrix with columns in their order."""
    if set(noise.dims) != {"variable", "variable_"}:
        raise IdentificationError(
            f"the covariance of the noise has the dimensions {', '.join(map(str, noise.dims))}; "
            f"give variable and variable_"
        )
    noise = noise.transpose("variable", "variable_")
    names = [str(name) for name in noise["variable"].values]
    if "variable_" in noise.coords:
        columns = [str(name) for name in noise["variable_"].values]
        if sorted(columns) != sorted(names) or len(set(names)) < len(names):
            raise IdentificationError(
                f"the covariance of the noise has the rows {', '.join(names)} and the columns "
                f"{', '.join(columns)}; give each variable once in both"
            )
        noise = noise.isel(variable_=[columns.index(name) for name in names])
    return names, np.asarray(noise.values, dtype=float)


def _is_covariance(matrix: np.ndarray, count: int) -> bool:
    """Return whether a matrix (count, count) is symmetric and positive definite.

    Its elements are compared as correlations: those of small angles are near 1e-8.
    """
    if matrix.shape != (count, count) or not np.isfinite(matrix).all():
        return False
    variances = np.diag(matrix)
    if not (variances > 0.0).all():
        return False
    correlation = matrix / np.sqrt(np.outer(variances, variances))
    is_symmetric = np.allclose(correlation, correlation.T, rtol=0.0, atol=_SYMMETRIC)
    return is_symmetric and bool(np.linalg.eigvalsh(correlation)[0] > 0.0)


def _term_noise(problem: RegressionProblem, noisy: list[str], covariance: np.ndarray) -> np.ndarray:
    """Return the mean covariance of the noise of the terms, (terms, terms)."""
    model, data = problem.model, problem.samples.data
    slopes = []
    for name, size in zip(noisy, np.sqrt(np.diag(covariance))):
        # Differences over the noise itself: exact for squares, and they round the kink of a ramp.
        up = model.design(data.assign({name: data[name] + size}))
        down = model.design(data.assign({name: data[name] - size}))
        slopes.append((up - down) / (2.0 * size))
    # J of every sample, (variable, samples, terms); S = mean of J'CJ
    J = np.stack(slopes)
    S = np.einsum("ant,ab,bnu->tu", J, covariance, J, optimize=True) / J.shape[1]
    if len(problem.terms) == len(model.terms):
        return S
    # Constants of manoeuvres stand in place of the term 1, without noise.
    place, more = list(model.terms).index("1"), len(problem.terms) - len(model.terms)
    order = [*range(place + 1), *[place] * more, *range(place + 1, len(model.terms))]
    return S[np.ix_(order, order)]


def _solve_total(
    problem: RegressionProblem, elimination: ParameterElimination, S: np.ndarray
) -> LinearSolution:
    """Return the estimate; raise if the noise is as large as the motion."""
    T = elimination.matrix
    X, z = problem.X @ T, problem.z - problem.X @ elimination.offset
    count = len(z)
    added_noise = count * T.T @ S @ T
    Q, R = np.linalg.qr(X)
    # With X = QR: X'X - N S = R'(I - B)R, and the eigenvalues of B are the shares of noise.
    half = np.linalg.solve(R.T, added_noise)
    B = np.linalg.solve(R.T, half.T)
    shares, vectors = np.linalg.eigh(0.5 * (B + B.T))
    if shares[-1] > MOST_NOISE:
        worst = np.linalg.solve(R, vectors[:, -1]) * np.linalg.norm(X, axis=0)
        k = elimination.free[int(np.abs(worst).argmax())]
        raise IdentificationError(
            f"{problem.model}: the stated noise is {shares[-1]:.0%} of the movement of "
            f"{problem.terms[k]} and what moves with it, at most {MOST_NOISE:.0%} is allowed; "
            f"check the noise, add a manoeuvre, or use instrumental variables"
        )
    # E with pinv(E) = (X'X - N S)^-1 X': E = Q (I - B) R
    reduced = (vectors * (1.0 - shares)) @ vectors.T
    E = Q @ (reduced @ R)
    # A constant in a constraint holds part of theta, t. The noise of X t in z - X t is that of X T:
    # T'(X'X - N S) T phi = T'X'(z - X t) + N T'S t
    held = np.linalg.solve(R.T, count * T.T @ S @ elimination.offset)
    phi = np.linalg.solve(R, (vectors / (1.0 - shares)) @ (vectors.T @ (Q.T @ z + held)))
    theta = elimination.expand(phi)
    v = problem.z - problem.X @ theta
    memory = memory_of_squares(v, problem.samples.pieces()[0]) if v.any() else 1.0
    # The noise n of the regressors is part of the residual, cov(n, v) = -S theta. The regressors
    # x + S theta v/var(v) are orthogonal to v. With them the covariance of white residuals is
    # var(v) X'X - N S theta theta' S; twice this last part is added.
    push = T.T @ S @ theta
    variance = max(float(v @ v) / count, np.finfo(float).tiny)
    motion = X + np.outer(v, push / variance)
    information = R.T @ reduced @ R
    basis, corner = np.linalg.qr(motion)
    carrier = basis @ np.linalg.solve(corner.T, information)
    left = np.linalg.solve(information, push)
    biased = elimination.expand(least_squares.solve_least_squares(X, z)[0])
    return LinearSolution(
        elimination,
        phi,
        E=E,
        # Samples X theta return theta by least squares. (X'X - N S)^-1 X' would return more: it
        # expects noise in X, which tables at the same samples share.
        design=X,
        carrier=carrier,
        X=X,
        motion=motion,
        information=0.5 * (information + information.T),
        root=np.ones(count),
        added=2.0 * count * memory * np.outer(left, left),
        variables={
            "least_squares": ("term", biased, {"long_name": "estimate by equation error"}),
        },
        attributes={
            "weights": "equal",
            "ridge": 0.0,
            "method": "total least squares",
            "noise_share": float(max(0.0, shares[-1])),
        },
    )


def _compare_with_scatter(samples: RegressionSamples, noisy: list[str], sizes: np.ndarray) -> str:
    """Return a remark on stated noise that differs from the scatter from sample to sample."""
    texts = []
    for name, size in zip(noisy, sizes):
        differences = []
        for piece in samples.pieces()[0]:
            if piece.stop - piece.start > 4:
                differences.append(np.diff(samples.data[name].values[piece], 4))
        if not differences:
            continue
        # The fourth difference of white noise has 70 times its variance; motion hardly has any.
        scatter = float(np.sqrt(np.mean(np.concatenate(differences) ** 2) / 70.0))
        if not 1.0 / _SEEN <= size / max(scatter, np.finfo(float).tiny) <= _SEEN:
            texts.append(f"{name} {size:.3g} stated, {scatter:.3g} seen")
    if not texts:
        return ""
    return (
        f"stated noise against the scatter from sample to sample: {'; '.join(texts)}; is it that "
        f"of these samples? Filtered or slow noise scatters less, fast motion more"
    )
