"""The minimum of a separable problem, with the weights of its quantities and priors that belong to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flightmech.errors import IdentificationError

from ..expressions.functions import Pieces
from ..uncertainty import collinearity
from ..uncertainty.coloured_residuals import coloured
from .problem import Problem
from .projection import minimise, spread_starts

_ROUNDS = 4  # of the weights of several quantities, and of a prior against coloured residuals
_AT_BOUND = 1e-9  # distance from a bound over the range


@dataclass(frozen=True)
class Found:
    """Where the search ended: shape parameters, coefficients, and what belongs to the covariance.

    ``products`` (X'X), ``spread`` (X'RX) and ``white`` (s2 X'X) are over all coefficients and shape parameters, weighted;
    ``prior`` is added to the diagonal.
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


class Search:
    """The minimum for given weights, and the weights that belong to it."""

    def __init__(self, problem: Problem):
        self.problem = problem
        items = [problem.shape[name] for name in problem.names]
        self.low, self.high = np.array([i.low for i in items]), np.array([i.high for i in items])
        self.sigma = np.array([i.sigma for i in items])
        self.given = np.array([np.nan if i.start is None else i.start for i in items])

    def settled(self, lag: float | None) -> Found:
        """The minimum once the weights of quantities and priors no longer change."""
        problem, known = self.problem, np.isfinite(self.sigma)
        weight, starts = np.zeros(len(self.low)), spread_starts(self.low, self.high, self.given)
        problem.weights = np.array([1.0 / max(float(np.std(z)), np.finfo(float).tiny) for z in problem.z])
        rounds = 1 + (_ROUNDS if len(problem.models) > 1 or known.any() else 0)
        for turn in range(rounds):
            s = self.minimum(weight, starts)
            found = self.around(s, weight, lag)
            if turn == rounds - 1:
                break
            starts = s[None, :]
            if len(problem.models) > 1:
                residuals = problem.residuals(s, found.coefficients)
                problem.weights = np.array([1.0 / max(float(np.sqrt(v @ v / len(v))), np.finfo(float).tiny) for v in residuals])
            if known.any():
                weight = np.where(known, np.sqrt(self.colour(found)) / self.sigma, 0.0)
        return found

    def minimum(self, prior: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """Shape parameters of the least cost."""
        if not self.problem.names:
            return np.zeros(0)
        return minimise(lambda s: self.problem.project(s, prior), self.low, self.high, starts)

    def colour(self, found: Found) -> np.ndarray:
        """Variance that a white disturbance would need, to give each shape parameter its standard error."""
        M = found.products + np.diag(np.where(found.free, 0.0, 1.0))
        D = np.linalg.inv(M)
        m = len(self.low)
        wide = np.diag(D @ found.spread @ D)[-m:]
        return np.where(found.free[-m:], wide / np.diag(D)[-m:], np.trace(found.spread) / np.trace(found.products))

    def around(self, s: np.ndarray, prior: np.ndarray, lag: float | None) -> Found:
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
        products, spread, white, regressors, offsets = np.zeros((size, size)), np.zeros((size, size)), np.zeros((size, size)), [], []
        for j, (z, w, (A, slopes), pieces) in enumerate(zip(problem.z, problem.weights, problem.designs(s), problem.pieces)):
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
        inside = (s - self.low > _AT_BOUND * (self.high - self.low)) & (self.high - s > _AT_BOUND * (self.high - self.low))
        idle = np.diag(products)[size - m :] == 0.0
        free = np.concatenate([np.ones(size - m, bool), inside & ~idle])
        extra = np.concatenate([np.zeros(size - m), prior**2])
        return Found(s, c, extra, products, spread, white, regressors, free, float(max(offsets)))


def _spread(X: np.ndarray, v: np.ndarray, pieces: Pieces, lag: float | None) -> tuple[np.ndarray, float]:
    """X'RX of a coloured disturbance, by way of an orthonormal basis: X itself may be short of full rank."""
    length = np.linalg.norm(X, axis=0)
    U, s, Vt = np.linalg.svd(X / np.where(length > 0, length, 1.0), full_matrices=False)
    seen = s > 1e-10 * s[0]
    found = coloured(U[:, seen], v, pieces.slices, pieces.steps, lag)
    back = (s[:, None] * Vt)[seen] * length
    return back.T @ found.covariance @ back, found.offset
