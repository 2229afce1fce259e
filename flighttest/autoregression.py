"""Autocovariance of a disturbance from the residuals of a regression, by restricted maximum likelihood.

A fit takes up part of the disturbance, most of all its slow part, so that the residual is quieter at low frequencies
than the disturbance was: read off the residual, the variance of an intercept comes out up to six times too small.
Restricted likelihood looks only at what no regressor can take up and is free of that loss.  The disturbance is modelled
as an autoregression, whose spectrum can follow noise of any colour; its order is chosen by Akaike's criterion.  Of a
smooth residual the likelihood alone would believe in any amount of slow disturbance that the regressors happened to take
up: a weak prior holds its variance near that of the residual, and memories end at half of the record.

References
----------
.. [Patterson1971] Patterson, Thompson, Recovery of inter-block information when block sizes are unequal, Biometrika 58, 1971.
.. [Akaike1974] Akaike, A new look at the statistical model identification, IEEE Trans. Automatic Control 19, 1974.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import minimize
from scipy.signal import lfilter

ORDER = 8  # highest order tried
FLOOR = 1e-4  # white part added to the residual, of its variance: what a low-pass has removed is not to be looked up
HIDDEN = 5.0  # variance of the disturbance over that of the residual that is as far from one as one standard deviation
MEMORY = 0.5  # longest memory, of the longest stretch: what lasts longer cannot be told from a constant
_STEEPEST = 5.0  # bound of atanh of a reflection coefficient
OFFSETS = 3  # pieces from which on each has a constant of its own
_REFUSED = 1e3
_INSIDE = 0.9  # of the start, for a second try
_TOLERANCE = 1e-6  # of the log-likelihood per sample


@dataclass(frozen=True)
class Disturbance:
    """A stationary disturbance as an autoregression.

    Attributes
    ----------
    reflections : array (order,)
        Reflection coefficients, all between -1 and 1.
    variance : float
        Of the innovation.
    """

    reflections: np.ndarray
    variance: float

    @property
    def coefficients(self) -> np.ndarray:
        """1, a_1 ... a_p of the innovation e_t = v_t + a_1 v_(t-1) + ... + a_p v_(t-p)."""
        return _polynomial(self.reflections)

    def autocovariance(self, lags: int) -> np.ndarray:
        """Return the autocovariance at lags 0 ... lags - 1."""
        a, p = self.coefficients, len(self.reflections)
        equations = np.zeros((p + 1, p + 1))
        for k in range(p + 1):  # Yule and Walker
            np.add.at(equations[k], np.abs(k - np.arange(p + 1)), a)
        r = np.linalg.solve(equations, self.variance * np.eye(p + 1)[0])
        if lags <= p + 1:
            return r[:lags]
        state = _history(a, r)
        later, _ = lfilter([1.0], a, np.zeros(lags - p - 1), zi=state)
        return np.concatenate([r, later])

    def innovations(self, v: np.ndarray) -> np.ndarray:
        """Return what the past of a signal (time,) does not foretell, after the first samples of its order."""
        return lfilter(self.coefficients, [1.0], v)[len(self.reflections) :]

    def sample(self, size: int, rng: np.random.Generator) -> np.ndarray:
        """Return one stretch of the disturbance, (size,), stationary from its first sample on."""
        a, p = self.coefficients, len(self.reflections)
        e = np.sqrt(self.variance) * rng.normal(size=max(size, p))
        first = solve_triangular(_start(self.reflections)[0], e[:p], lower=True) if p else e[:0]
        state = _history(a, first)
        later = lfilter([1.0], a, e[p:], zi=state)[0] if size > p else e[:0]
        return np.concatenate([first, later])[:size]


def disturbance(X: np.ndarray, v: np.ndarray, pieces: Sequence[slice], order: int = ORDER) -> Disturbance:
    """Return the disturbance whose restricted likelihood is largest.

    Parameters
    ----------
    X : array (samples, terms)
        Regressors.
    v : array (samples,)
        Residuals of least squares on them.
    pieces : sequence of slice
        Uniform stretches without a gap; independent of each other.
    order : int
        Highest order tried.
    """
    order = max(0, min(order, max(p.stop - p.start for p in pieces) // 4))
    parts = [v[piece] - (v[piece].mean() if len(pieces) >= OFFSETS else 0.0) for piece in pieces]
    steps, innovations = _levinson(parts, order)
    if order == 0 or innovations[0] <= 0.0:
        return Disturbance(np.zeros(0), float(v @ v) / max(1, len(v) - X.shape[1]))
    orders = np.arange(order + 1)
    criterion = len(v) * (np.log(innovations) + 2.0 * (orders + 1) / np.maximum(1, len(v) - X.shape[1] - orders - 2))
    p = max(1, int(np.argmin(criterion)))
    used = [piece for piece in pieces if piece.stop - piece.start > 2 * p]
    rows = np.concatenate([np.arange(piece.start, piece.stop) for piece in used])
    ends = np.cumsum([piece.stop - piece.start for piece in used])
    places = [slice(int(end) - (piece.stop - piece.start), int(end)) for piece, end in zip(used, ends)]
    return _Likelihood(X[rows], v[rows], places, p).largest(steps[:p])


class _Likelihood:
    """Restricted likelihood of an autoregression of order p, from lagged products of regressors and residual.

    From three pieces on each has a constant of its own, which is eliminated piece by piece: what differs between pieces as
    a constant shall not pass for a slow disturbance.
    """

    def __init__(self, X: np.ndarray, v: np.ndarray, pieces: Sequence[slice], p: int):
        self.scale = float(np.std(v)) or 1.0
        self.offsets = len(pieces) >= OFFSETS
        self.memory = MEMORY * max(piece.stop - piece.start for piece in pieces)
        Q = _basis(_centred(X, pieces) if self.offsets else X)
        W = np.column_stack([np.ones(len(v)), Q * np.sqrt(len(v)), v / self.scale])[:, 0 if self.offsets else 1 :]
        self.size, self.pieces = W.shape[1], len(pieces)
        self.samples = sum(piece.stop - piece.start for piece in pieces)
        self.free = self.samples - (self.size - 1) - (self.pieces - 1) * self.offsets
        later, first = (np.zeros((len(pieces), k, k, self.size, self.size)) for k in (p + 1, p))
        for m, piece in enumerate(pieces):
            w = W[piece]
            lagged = np.lib.stride_tricks.sliding_window_view(w, p + 1, axis=0)[..., ::-1]  # (samples - p, size, lag)
            columns = lagged.transpose(0, 2, 1).reshape(len(lagged), -1)
            later[m] = (columns.T @ columns).reshape(p + 1, self.size, p + 1, self.size).transpose(0, 2, 1, 3)
            first[m] = np.einsum("ik,jl->ijkl", w[:p], w[:p])
            later[m, range(p + 1), range(p + 1), -1, -1] += FLOOR * (len(w) - p)
            first[m, range(p), range(p), -1, -1] += FLOOR
        if not self.offsets:
            later, first = later.sum(axis=0, keepdims=True), first.sum(axis=0, keepdims=True)
        self.later, self.first = later.reshape(len(later), (p + 1) ** 2, -1), first.reshape(len(first), p * p, -1)

    def largest(self, reflections: np.ndarray) -> Disturbance:
        """Climb from given reflection coefficients."""
        found = self._climbed(reflections)
        if not found.success:  # lost at the edge, where a regressor vanishes in rounding: once more from further inside
            found = min(found, self._climbed(_INSIDE * reflections), key=lambda one: one.fun)
        reflections = _forgetful(np.tanh(found.x), self.memory)
        root, _ = self._whitened(reflections)
        return Disturbance(reflections, root[-1] ** 2 / self.free * self.scale**2)

    def _climbed(self, reflections: np.ndarray):
        """What the optimiser finds from given reflection coefficients."""
        start = np.arctanh(np.clip(reflections, -np.tanh(_STEEPEST), np.tanh(_STEEPEST)))
        return minimize(self._cost, start, method="L-BFGS-B", bounds=[(-_STEEPEST, _STEEPEST)] * len(start), options={"ftol": _TOLERANCE})

    def _cost(self, t: np.ndarray) -> float:
        reflections = _forgetful(np.tanh(t), self.memory)
        try:
            root, determinant = self._whitened(reflections)
        except np.linalg.LinAlgError:  # a regressor lost in rounding: too steep a filter
            return _REFUSED
        # all of the disturbance over what the residual shows of it; its size is unity here
        excess = np.log(root[-1] ** 2 / self.free) - np.log1p(-(reflections**2)).sum()
        hidden = 0.5 * (max(0.0, excess) / np.log(HIDDEN)) ** 2
        return float(self.free * np.log(root[-1]) + np.log(root[:-1]).sum() + 0.5 * determinant + hidden) / self.samples

    def _whitened(self, reflections: np.ndarray) -> tuple[np.ndarray, float]:
        """Diagonal of the Cholesky factor of the whitened products, and log-determinant of starts and offsets."""
        filters, start = _start(reflections)
        a = _polynomial(reflections)
        products = np.outer(a, a).ravel() @ self.later + (filters.T @ filters).ravel() @ self.first
        G = products.reshape(-1, self.size, self.size)
        determinant = self.pieces * start
        if self.offsets:
            determinant += float(np.log(G[:, 0, 0]).sum())
            G = G[:, 1:, 1:] - G[:, 1:, :1] * G[:, :1, 1:] / G[:, :1, :1]
        total = G.sum(axis=0)
        return np.diag(np.linalg.cholesky(0.5 * (total + total.T) + np.diag(1e-11 * np.diag(total)))), determinant


def _centred(X: np.ndarray, pieces: Sequence[slice]) -> np.ndarray:
    return np.vstack([X[piece] - X[piece].mean(axis=0) for piece in pieces])


def _basis(X: np.ndarray) -> np.ndarray:
    """Orthonormal columns that span the regressors; those that have vanished are left out."""
    U, s, _ = np.linalg.svd(X / np.maximum(np.linalg.norm(X, axis=0), np.finfo(float).tiny), full_matrices=False)
    return U[:, s > 1e-8 * s[0]]


def _levinson(parts: Sequence[np.ndarray], order: int) -> tuple[np.ndarray, np.ndarray]:
    """Reflection coefficients and variances of the innovation for all orders, from the residual as it is."""
    r = np.array([sum(float(x[: len(x) - k] @ x[k:]) for x in parts if len(x) > k) for k in range(order + 1)])
    r /= sum(map(len, parts))
    r[0] *= 1.0 + FLOOR
    a, reflections, variances = np.ones(1), [], [r[0]]
    for m in range(order if r[0] > 0 else 0):
        k = -float(a @ r[m + 1 : 0 : -1]) / variances[-1]
        a = np.append(a, 0.0)
        a = a + k * a[::-1]
        reflections.append(k)
        variances.append(variances[-1] * (1.0 - k * k))
    return np.array(reflections), np.array(variances)


def _polynomial(reflections: np.ndarray) -> np.ndarray:
    a = np.ones(1)
    for k in reflections:
        a = np.append(a, 0.0)
        a = a + k * a[::-1]
    return a


def _forgetful(reflections: np.ndarray, memory: float) -> np.ndarray:
    """Reflection coefficients with every pole drawn inwards, so that none remembers longer than `memory` samples."""
    a = _polynomial(reflections) * np.exp(-np.arange(len(reflections) + 1) / memory)
    found = np.empty(len(reflections))
    for m in range(len(found) - 1, -1, -1):
        found[m] = a[-1]
        a = (a[:-1] - a[-1] * a[:0:-1]) / (1.0 - a[-1] ** 2)
    return found


def _history(a: np.ndarray, past: np.ndarray) -> np.ndarray:
    """State of the filter 1/a after given outputs."""
    p = len(a) - 1
    return -np.array([a[i + 1 :] @ past[::-1][: p - i] for i in range(p)])


def _start(reflections: np.ndarray) -> tuple[np.ndarray, float]:
    """Filters (order, order) that whiten the first samples, and the log-determinant of their covariance over the innovation's."""
    p = len(reflections)
    filters, determinant, a = np.zeros((p, p)), np.zeros(p), np.ones(1)
    for m, k in enumerate(reflections):
        filters[m, : m + 1] = a[::-1]
        determinant[m] = -np.log1p(-(reflections[m:] ** 2)).sum()
        a = np.append(a, 0.0)
        a = a + k * a[::-1]
    return filters * np.exp(-0.5 * determinant)[:, None], float(determinant.sum())
