"""The minimum of a separable problem, with the weights of its quantities and priors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flightmech.errors import IdentificationError
from flighttest.regression.equation_error.samples import RegressionSamples, Response
from flighttest.regression.expression_functions import Pieces
from flighttest.regression.separable.projection import (
    LinearBlock,
    Projection,
    minimise_projection,
    project_blocks,
    spread_starts,
)
from flighttest.regression.separable_model import SeparableModel, ShapeParameter
from flighttest.regression.uncertainty import collinearity
from flighttest.regression.uncertainty.coloured_residuals import coloured_covariance_of
from flighttest.remarks import Convergence

SAMPLES_PER_PARAMETER = 5
_ROUNDS = 4  # of the weights of several quantities, and of a prior against coloured residuals
# Change of an estimate by the last round at which the weights have converged, and above which the
# fit must not be used. [standard errors]
SAME, WRONG = 0.1, 1.0
_RELATIVE = 1e-6  # smallest tolerance of an estimate, by its effect on the fit
_AT_BOUND = 1e-9  # distance from a bound over the range
_RANK = 1e-10  # smallest singular value of the scaled regressors, over the largest
_LEAST_RMS = np.finfo(float).tiny  # keeps the weight of an exact fit finite


class QuantityDesign(NamedTuple):
    """Regressors of one quantity for given shape parameters.

    Attributes
    ----------
    A : array (samples, terms)
    slopes : list of (parameter, term, array (samples,))
        Derivatives of single regressors by single shape parameters; all others are zero.
    """

    A: np.ndarray
    slopes: list[tuple[int, int, np.ndarray]]


class SeparableProblem:
    """Models and their samples: the least-squares problem for given shapes and weights.

    Attributes
    ----------
    models, samples, pieces, z, terms : lists
        One item per measured quantity; `z` are arrays (samples,).
    shape : dict of str to ShapeParameter
        All shape parameters.
    names : list of str
        Their names.
    weights : array (quantities,)
        One over the standard deviation of the residual of each quantity.
    """

    def __init__(self, models: Sequence[SeparableModel], samples: Sequence[RegressionSamples]):
        self.models, self.samples = models, samples
        self.pieces = [Pieces(*item.pieces()) for item in samples]
        self.quantities: list[dict[str, np.ndarray]] = []
        self.z: list[np.ndarray] = []
        self.terms: list[list[str]] = []
        self.shape: dict[str, ShapeParameter] = {}
        for model, item in zip(models, samples):
            self.quantities.append({name: item.data[name].values for name in model.variables})
            self.z.append(item.data[model.target].values)
            prefix = f"{model.target}: " if len(models) > 1 else ""
            self.terms.append([f"{prefix}{term}" for term in model.terms])
            self.shape.update(model.parameters)
        self.names = list(self.shape)
        self.weights = np.ones(len(models))
        for model, z, pieces in zip(models, self.z, self.pieces):
            count = len(model.terms) + len(model.parameters)
            if len(z) < SAMPLES_PER_PARAMETER * count:
                raise IdentificationError(
                    f"{len(z)} samples for {count} parameters of {model}; at least "
                    f"{SAMPLES_PER_PARAMETER} each"
                )
            if not model.parameters:
                collinearity.demand_rank(model.design(samples[0].data, {}, pieces)[0], model.terms)

    def designs(self, s: np.ndarray) -> list[QuantityDesign]:
        """Return the regressors of each quantity for shape parameters `s`, (parameters,)."""
        values = dict(zip(self.names, s))
        designs = []
        for model, quantities, z, pieces in zip(self.models, self.quantities, self.z, self.pieces):
            parameters = {name: values[name] for name in model.parameters}
            A, by_name = model.columns(quantities, len(z), parameters=parameters, pieces=pieces)
            slopes = [(self.names.index(name), term, slope) for name, term, slope in by_name]
            designs.append(QuantityDesign(A, slopes))
        return designs

    def project(self, s: np.ndarray, prior: np.ndarray) -> Projection | None:
        """Return the weighted projection.

        Parameters
        ----------
        s : array (parameters,)
            Shape parameters.
        prior : array (parameters,)
            Root of the weight of the a-priori value of each parameter.
        """
        blocks = []
        for z, weight, design in zip(self.z, self.weights, self.designs(s)):
            slopes = [(m, j, slope * weight) for m, j, slope in design.slopes]
            blocks.append(LinearBlock(z * weight, design.A * weight, slopes))
        fixed = None
        if prior.any():
            means = np.array([self.shape[name].start or 0.0 for name in self.names])
            fixed = (prior * (s - means), np.diag(prior))
        return project_blocks(blocks, len(s), fixed)

    def residuals(self, s: np.ndarray, coefficients: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Return measured minus fitted, per quantity."""
        residuals = []
        for z, design, c in zip(self.z, self.designs(s), coefficients):
            residuals.append(z - design.A @ c)
        return residuals

    def response(self, j: int, s: np.ndarray, coefficients: np.ndarray) -> Response:
        """Return the response of model `j` to its variables, for `RegressionSamples.errors`."""
        model, values = self.models[j], dict(zip(self.names, s))
        parameters = {name: values[name] for name in model.parameters}
        return lambda data: model.design(data, parameters, self.pieces[j])[0] @ coefficients


@dataclass(frozen=True)
class SeparableSolution:
    """Minimum of a separable problem, and the parts of its covariance.

    The matrices are over all coefficients and shape parameters, weighted.

    Attributes
    ----------
    values : array (m,)
        Shape parameters.
    coefficients : list of array (n,)
        Coefficients of each quantity.
    prior : array (parameters,)
        Weight of the a-priori values, on the diagonal of the normal matrix.
    products : array (parameters, parameters)
        Normal matrix X'X without prior.
    spread : array (parameters, parameters)
        X'RX of the coloured disturbance.
    white : array (parameters, parameters)
        s^2 X'X.
    regressors : list of array (samples, parameters of the quantity)
    free : array of bool (parameters,)
        Parameters that are not at a bound.
    offset : float
        Largest standard deviation of a constant between stretches.
    """

    values: np.ndarray
    coefficients: list[np.ndarray]
    prior: np.ndarray
    products: np.ndarray
    spread: np.ndarray
    white: np.ndarray
    regressors: list[np.ndarray]
    free: np.ndarray
    offset: float


class WeightedSolutions(NamedTuple):
    """End of the rounds of weights.

    Attributes
    ----------
    last : SeparableSolution
    before : SeparableSolution or None
        Minimum of the round before; None if the weights need no rounds.
    rounds : int
    """

    last: SeparableSolution
    before: SeparableSolution | None
    rounds: int

    def convergence(self, problem: SeparableProblem, stderr: np.ndarray) -> Convergence:
        """Return whether the last round moved the estimates within their tolerance.

        Parameters
        ----------
        problem : SeparableProblem
            With the weights of the last round.
        stderr : array (parameters,)
            Standard errors; NaN for a parameter at a bound.
        """
        if self.before is None:
            return Convergence(True, 0, 0.0)
        now, earlier = self.last, self.before
        change = np.abs(
            np.concatenate([*now.coefficients, now.values])
            - np.concatenate([*earlier.coefficients, earlier.values])
        )
        # Without noise the standard errors are those of rounding. The floor is the change of an
        # estimate that changes the fit by `_RELATIVE` of the measured values.
        weighted = [w * np.linalg.norm(z) for w, z in zip(problem.weights, problem.z)]
        length = np.sqrt(np.diag(now.products))
        floor = _RELATIVE * np.linalg.norm(weighted) / np.maximum(length, _LEAST_RMS)
        tolerance = np.fmax(SAME * stderr, floor)
        ratio = float(np.max(change / tolerance))
        return Convergence(ratio <= 1.0, self.rounds, ratio)


class WeightedMinimum:
    """The minimum of a separable problem, and the weights that belong to it."""

    def __init__(self, problem: SeparableProblem):
        self.problem = problem
        items = [problem.shape[name] for name in problem.names]
        self.low = np.array([item.low for item in items])
        self.high = np.array([item.high for item in items])
        self.sigma = np.array([item.sigma for item in items])
        # None becomes NaN: a parameter without start value
        self.start = np.array([item.start for item in items], dtype=float)

    def iterate_weights(self, lag: float | None) -> WeightedSolutions:
        """Return the minima of the last two rounds of the weights of quantities and priors."""
        problem, has_prior = self.problem, np.isfinite(self.sigma)
        weight = np.zeros(len(self.low))
        starts = spread_starts(self.low, self.high, self.start)
        problem.weights = _inverse_deviations([float(np.std(z)) for z in problem.z])
        is_several = len(problem.models) > 1
        rounds = _ROUNDS if is_several or has_prior.any() else 0
        solution = self.solve(weight, starts, lag)
        before = None
        for _ in range(rounds):
            before = solution
            starts = solution.values[None, :]
            if is_several:
                residuals = problem.residuals(solution.values, solution.coefficients)
                deviations = [float(np.sqrt(v @ v / len(v))) for v in residuals]
                problem.weights = _inverse_deviations(deviations)
            if has_prior.any():
                # A prior counts as one measurement with the noise variance of the data.
                noise = np.sqrt(self.equivalent_noise_variance(solution))
                weight = np.where(has_prior, noise / self.sigma, 0.0)
            solution = self.solve(weight, starts, lag)
        return WeightedSolutions(solution, before, rounds)

    def solve(self, prior: np.ndarray, starts: np.ndarray, lag: float | None) -> SeparableSolution:
        """Return the minimum for given weights, from the best of the starts (starts, m)."""
        return self.evaluate_covariance(self.search(prior, starts), prior, lag)

    def search(self, prior: np.ndarray, starts: np.ndarray | None = None) -> np.ndarray:
        """Return the shape parameters of the minimum, (m,); by default from spread starts."""
        if not self.problem.names:
            return np.zeros(0)
        if starts is None:
            starts = spread_starts(self.low, self.high, self.start)
        return minimise_projection(
            lambda trial: self.problem.project(trial, prior),
            self.low,
            high=self.high,
            starts=starts,
        )

    def equivalent_noise_variance(self, solution: SeparableSolution) -> np.ndarray:
        """Return the white-noise variance that reproduces the standard error of each shape, (m,).

        A parameter at a bound gets the mean ratio of coloured to white products.
        """
        # Sandwich covariance N^-1 S N^-1 of the free parameters, with the normal matrix N. Rows of
        # parameters at a bound are replaced by the identity, so that they do not take part.
        inverse = np.linalg.inv(solution.products + np.diag(np.where(solution.free, 0.0, 1.0)))
        m = len(self.low)
        variance = np.diag(inverse @ solution.spread @ inverse)[-m:]
        mean_ratio = np.trace(solution.spread) / np.trace(solution.products)
        return np.where(solution.free[-m:], variance / np.diag(inverse)[-m:], mean_ratio)

    def evaluate_covariance(
        self, s: np.ndarray, prior: np.ndarray, lag: float | None
    ) -> SeparableSolution:
        """Return coefficients and the parts of the covariance at shape parameters `s`."""
        problem = self.problem
        projection = problem.project(s, np.zeros_like(prior))
        if projection is None:
            collinearity.demand_rank(problem.designs(s)[0].A, problem.terms[0])
            raise IdentificationError(f"the coefficients of {problem.models[0]} are not determined")
        coefficients, m = [np.asarray(c) for c in projection.coefficients], len(s)
        edges = np.cumsum([0, *map(len, coefficients)])
        size = int(edges[-1]) + m
        products, spread = np.zeros((size, size)), np.zeros((size, size))
        white = np.zeros((size, size))
        regressors, offsets = [], []
        for j, design in enumerate(problem.designs(s)):
            # Columns of this quantity: its coefficients, and all shape parameters at the end.
            columns = [*range(edges[j], edges[j + 1]), *range(size - m, size)]
            block = np.ix_(columns, columns)
            z, w = problem.z[j], problem.weights[j]
            X = _linearised_regressors(design, coefficients[j], w, m)
            v = w * (z - design.A @ coefficients[j])
            inner, offset = _coloured_products(X, v, pieces=problem.pieces[j], lag=lag)
            XX = X.T @ X
            products[block] += XX
            spread[block] += inner
            white[block] += XX * float(v @ v) / (len(z) - X.shape[1])
            regressors.append(X)
            offsets.append(offset / w)
        margin = _AT_BOUND * (self.high - self.low)
        is_inside = (s - self.low > margin) & (self.high - s > margin)
        is_idle = np.diag(products)[size - m :] == 0.0
        return SeparableSolution(
            values=s,
            coefficients=coefficients,
            prior=np.concatenate([np.zeros(size - m), prior**2]),
            products=products,
            spread=spread,
            white=white,
            regressors=regressors,
            free=np.concatenate([np.ones(size - m, bool), is_inside & ~is_idle]),
            offset=float(max(offsets)),
        )


def _inverse_deviations(deviations: Sequence[float]) -> np.ndarray:
    return np.array([1.0 / max(deviation, _LEAST_RMS) for deviation in deviations])


def _linearised_regressors(
    design: QuantityDesign, c: np.ndarray, weight: float, parameters: int
) -> np.ndarray:
    """Return the weighted regressors [A, (dA/ds) c] of the problem linearised at its solution."""
    A = design.A
    X = weight * np.hstack([A, np.zeros((len(A), parameters))])
    for parameter, term, slope in design.slopes:
        X[:, A.shape[1] + parameter] += weight * slope * c[term]
    return X


def _coloured_products(
    X: np.ndarray, v: np.ndarray, pieces: Pieces, lag: float | None
) -> tuple[np.ndarray, float]:
    """Return X'RX of a coloured disturbance, and the constant between stretches."""
    # X may be short of full rank. With X = U s V' the orthonormal U has full rank, and
    # X'RX = (s V')' cov(U) (s V').
    length = np.linalg.norm(X, axis=0)
    U, s, Vt = np.linalg.svd(X / np.where(length > 0, length, 1.0), full_matrices=False)
    is_seen = s > _RANK * s[0]
    coloured = coloured_covariance_of(
        U[:, is_seen], v, pieces=pieces.slices, steps=pieces.steps, lag=lag
    )
    to_basis = (s[:, None] * Vt)[is_seen] * length
    return to_basis.T @ coloured.covariance @ to_basis, coloured.offset
