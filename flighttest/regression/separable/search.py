"""The minimum of a separable problem, with the weights of its quantities and priors that belong to
it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flightmech.errors import IdentificationError
from flighttest.regression.equation_error.samples import RegressionSamples
from flighttest.regression.expressions import Pieces
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

# least coefficient over standard error of a term whose shape was searched: the search takes the
# largest of many
T_SHAPED = 3.0
NARROWED = 0.5  # largest standard error of a shape parameter over that before the flights


def assess_identifiability(
    models: Sequence[SeparableModel],
    shape: Mapping[str, ShapeParameter],
    names: Sequence[str],
    theta: np.ndarray,
    covariance: np.ndarray,
    found: Any,
) -> dict[str, tuple]:
    """Return what is known of every parameter, as variables of a Dataset.

    Parameters
    ----------
    models : sequence of SeparableModel
    shape : mapping of str to ShapeParameter
    names : sequence of str
        Coefficients of all models, then shape parameters.
    theta, covariance : array (names,), (names, names)
    found : object
        ``products`` and ``spread`` of the fit, ``free``.

    Returns
    -------
    dict
        ``t`` (of a coefficient: over its standard error for given shapes; of a shape parameter:
        NaN), ``narrowed`` (standard error of a shape parameter over that before the flights),
        ``identified`` (bool), ``why`` (text), ``condition_index`` (component), ``proportion``
        (component, term).
    """
    count = len(names) - len(shape)
    D = np.linalg.pinv(found.products[:count, :count], rcond=1e-14, hermitian=True)
    given = np.sqrt(np.maximum(np.diag(D @ found.spread[:count, :count] @ D), 0.0))
    with np.errstate(divide="ignore"):
        t = np.concatenate([np.abs(theta[:count]) / given, np.full(len(shape), np.nan)])
    stderr = np.sqrt(np.diag(covariance))
    narrowed = np.concatenate(
        [
            np.full(count, np.nan),
            [stderr[count + m] / item.spread for m, item in enumerate(shape.values())],
        ]
    )
    shapes = [own for model in models for own in model.shapes.values()]
    why = [_coefficient(t[j], shapes[j]) for j in range(count)]
    for m, name in enumerate(shape):
        users = [j for j in range(count) if name in shapes[j]]
        why.append(
            _shape(
                name,
                shape[name],
                theta[count + m],
                narrowed[count + m],
                max(t[j] for j in users),
                found.free[count + m],
            )
        )
    index, proportion = _decomposed(found)
    return {
        "t": ("term", t, {"long_name": "coefficient over its standard error, shapes as they are"}),
        "narrowed": (
            "term",
            narrowed,
            {"long_name": "standard error over that before the flights"},
        ),
        "identified": ("term", np.array([not text for text in why])),
        "why": ("term", np.array(why, dtype=str)),
        "condition_index": ("component", index),
        "proportion": (("component", "term"), proportion),
    }


def _coefficient(t: float, shapes: Sequence[str]) -> str:
    """A term of known form may well be zero; one whose form was searched must be seen, or its form
    means nothing.
    """
    return (
        ""
        if t >= T_SHAPED or not shapes
        else f"{t:.1f} standard errors from zero, {T_SHAPED:g} are needed"
    )


def _shape(
    name: str, item: ShapeParameter, value: float, narrowed: float, t: float, free: bool
) -> str:
    if t < T_SHAPED:
        return f"its term is {t:.1f} standard errors from zero, {T_SHAPED:g} are needed"
    if not free:
        return f"at its bound {value:g}"
    if narrowed > NARROWED:
        before = (
            f"its a-priori standard error {item.sigma:g}"
            if item.sigma == item.spread
            else f"its bounds {item.low:g} ... {item.high:g}"
        )
        return f"standard error {100 * narrowed:.0f} % of that of {before}"
    return ""


def _decomposed(found: Any) -> tuple[np.ndarray, np.ndarray]:
    """Condition indexes and variance proportions over all parameters; zero for those at a bound."""
    free, size = found.free, len(found.free)
    M = found.products[np.ix_(free, free)]
    root = np.linalg.cholesky(M + 1e-15 * np.diag(np.diag(M))).T
    index, share = collinearity.variance_decomposition(root)
    whole_index, whole = np.full(size, np.inf), np.zeros((size, size))
    whole_index[: len(index)] = index
    whole[: len(index), free] = share
    return whole_index, whole


SAMPLES_PER_PARAMETER = 5


class SeparableProblem:
    """Models and their samples: the least-squares problem for given shape parameters and weights."""

    def __init__(self, models: Sequence[SeparableModel], samples: Sequence[RegressionSamples]):
        self.models, self.samples = models, samples
        self.pieces = [Pieces(*one.pieces()) for one in samples]
        self.quantities = [
            {name: one.data[name].values for name in model.variables}
            for model, one in zip(models, samples)
        ]
        self.z = [one.data[model.target].values for model, one in zip(models, samples)]
        self.shape: dict[str, ShapeParameter] = {
            name: item for model in models for name, item in model.parameters.items()
        }
        self.names = list(self.shape)
        several = len(models) > 1
        self.terms = [
            [f"{model.target}: {term}" if several else term for term in model.terms]
            for model in models
        ]
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

    def designs(self, s: np.ndarray) -> list[tuple[np.ndarray, list[tuple[int, int, np.ndarray]]]]:
        """Regressors (samples, terms) of each quantity, and (parameter, term, derivative) where
        they change.
        """
        values = dict(zip(self.names, s))
        found = []
        for model, quantities, z, pieces in zip(self.models, self.quantities, self.z, self.pieces):
            A, slopes = model.columns(
                quantities, len(z), {name: values[name] for name in model.parameters}, pieces
            )
            found.append((A, [(self.names.index(name), j, slope) for name, j, slope in slopes]))
        return found

    def project(self, s: np.ndarray, prior: np.ndarray) -> Projection | None:
        """The weighted projection; `prior` holds the weight of the a-priori value of each
        parameter.
        """
        blocks = [
            LinearBlock(z * w, A * w, [(m, j, slope * w) for m, j, slope in slopes])
            for z, w, (A, slopes) in zip(self.z, self.weights, self.designs(s))
        ]
        means = np.array([self.shape[name].start or 0.0 for name in self.names])
        fixed = (prior * (s - means), np.diag(prior)) if prior.any() else None
        return project_blocks(blocks, len(s), fixed)

    def residuals(self, s: np.ndarray, coefficients: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Measured minus fitted, per quantity."""
        return [z - A @ c for z, (A, _), c in zip(self.z, self.designs(s), coefficients)]

    def fitted(
        self, j: int, s: np.ndarray, coefficients: np.ndarray
    ) -> Callable[[Mapping[str, np.ndarray]], np.ndarray]:
        """Return what model `j` makes of values of its variables, for `RegressionSamples.errors`."""
        model, values = self.models[j], dict(zip(self.names, s))
        parameters = {name: values[name] for name in model.parameters}
        return lambda data: model.design(data, parameters, self.pieces[j])[0] @ coefficients


_ROUNDS = 4  # of the weights of several quantities, and of a prior against coloured residuals
_AT_BOUND = 1e-9  # distance from a bound over the range


@dataclass(frozen=True)
class SeparableSolution:
    """Where the search ended: shape parameters, coefficients, and what belongs to the covariance.

    ``products`` (X'X), ``spread`` (X'RX) and ``white`` (s2 X'X) are over all coefficients and shape
    parameters, weighted; ``prior`` is added to the diagonal.
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


class WeightedMinimum:
    """The minimum for given weights, and the weights that belong to it."""

    def __init__(self, problem: SeparableProblem):
        self.problem = problem
        items = [problem.shape[name] for name in problem.names]
        self.low, self.high = np.array([i.low for i in items]), np.array([i.high for i in items])
        self.sigma = np.array([i.sigma for i in items])
        self.given = np.array([np.nan if i.start is None else i.start for i in items])

    def settled(self, lag: float | None) -> SeparableSolution:
        """The minimum once the weights of quantities and priors no longer change."""
        problem, known = self.problem, np.isfinite(self.sigma)
        weight, starts = np.zeros(len(self.low)), spread_starts(self.low, self.high, self.given)
        problem.weights = np.array(
            [1.0 / max(float(np.std(z)), np.finfo(float).tiny) for z in problem.z]
        )
        rounds = 1 + (_ROUNDS if len(problem.models) > 1 or known.any() else 0)
        for turn in range(rounds):
            s = self.minimum(weight, starts)
            found = self.around(s, weight, lag)
            if turn == rounds - 1:
                break
            starts = s[None, :]
            if len(problem.models) > 1:
                residuals = problem.residuals(s, found.coefficients)
                problem.weights = np.array(
                    [
                        1.0 / max(float(np.sqrt(v @ v / len(v))), np.finfo(float).tiny)
                        for v in residuals
                    ]
                )
            if known.any():
                weight = np.where(known, np.sqrt(self.colour(found)) / self.sigma, 0.0)
        return found

    def minimum(self, prior: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """Shape parameters of the least cost."""
        if not self.problem.names:
            return np.zeros(0)
        return minimise_projection(
            lambda s: self.problem.project(s, prior), self.low, self.high, starts
        )

    def colour(self, found: SeparableSolution) -> np.ndarray:
        """Variance that a white disturbance would need, to give each shape parameter its standard
        error.
        """
        M = found.products + np.diag(np.where(found.free, 0.0, 1.0))
        D = np.linalg.inv(M)
        m = len(self.low)
        wide = np.diag(D @ found.spread @ D)[-m:]
        return np.where(
            found.free[-m:],
            wide / np.diag(D)[-m:],
            np.trace(found.spread) / np.trace(found.products),
        )

    def around(self, s: np.ndarray, prior: np.ndarray, lag: float | None) -> SeparableSolution:
        """Coefficients and what their covariance is made of."""
        problem = self.problem
        projection = problem.project(s, np.zeros_like(prior))
        if projection is None:
            A, terms = problem.designs(s)[0][0], problem.terms[0]
            collinearity.demand_rank(A, terms)
            raise IdentificationError(f"the coefficients of {problem.models[0]} are not determined")
        c, m = [np.asarray(one) for one in projection.coefficients], len(s)
        places = np.cumsum([0, *map(len, c)])
        size = int(places[-1]) + m
        products, spread, white, regressors, offsets = (
            np.zeros((size, size)),
            np.zeros((size, size)),
            np.zeros((size, size)),
            [],
            [],
        )
        for j, (z, w, (A, slopes), pieces) in enumerate(
            zip(problem.z, problem.weights, problem.designs(s), problem.pieces)
        ):
            at = [*range(places[j], places[j + 1]), *range(size - m, size)]
            X = w * np.hstack([A, np.zeros((len(z), m))])
            for parameter, term, slope in slopes:
                X[:, A.shape[1] + parameter] += w * slope * c[j][term]
            v = w * (z - A @ c[j])
            inner, offset = _spread(X, v, pieces, lag)
            XX = X.T @ X
            products[np.ix_(at, at)] += XX
            spread[np.ix_(at, at)] += inner
            white[np.ix_(at, at)] += XX * float(v @ v) / (len(z) - X.shape[1])
            regressors.append(X)
            offsets.append(offset / w)
        inside = (s - self.low > _AT_BOUND * (self.high - self.low)) & (
            self.high - s > _AT_BOUND * (self.high - self.low)
        )
        idle = np.diag(products)[size - m :] == 0.0
        free = np.concatenate([np.ones(size - m, bool), inside & ~idle])
        extra = np.concatenate([np.zeros(size - m), prior**2])
        return SeparableSolution(
            s, c, extra, products, spread, white, regressors, free, float(max(offsets))
        )


def _spread(
    X: np.ndarray, v: np.ndarray, pieces: Pieces, lag: float | None
) -> tuple[np.ndarray, float]:
    """X'RX of a coloured disturbance, by way of an orthonormal basis: X itself may be short of full
    rank.
    """
    length = np.linalg.norm(X, axis=0)
    U, s, Vt = np.linalg.svd(X / np.where(length > 0, length, 1.0), full_matrices=False)
    seen = s > 1e-10 * s[0]
    found = coloured_covariance_of(U[:, seen], v, pieces.slices, pieces.steps, lag)
    back = (s[:, None] * Vt)[seen] * length
    return back.T @ found.covariance @ back, found.offset
