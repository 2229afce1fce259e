"""Likelihood of several pieces with a prior: its value, gradient and information."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np

from flighttest.maximum_likelihood.unknowns import UnknownVector

FLOOR = 1e-7  # smallest residual that counts, of the rms of a measured output about its mean
_LEAST_RMS = 1e-12  # smallest rms of an output for this floor
# why a search ended
CONVERGED, STALLED, EXHAUSTED = "converged", "stalled", "iterations"
# it stalled where the cost itself shows that no lower place is near
STATIONARY = "stationary"


class Piece(Protocol):
    """One manoeuvre."""

    measured: np.ndarray  # (samples, outputs), NaN without a reading

    def predict(self, values: np.ndarray) -> np.ndarray:
        """Return the outputs (samples, outputs) for the unknowns of this manoeuvre.

        The outputs are NaN if the manoeuvre cannot be simulated.
        """

    def slopes(self, values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
        """Return the slopes (samples, outputs, unknowns); central differences if requested."""


@runtime_checkable
class PrefetchedRuns(Protocol):
    """A manoeuvre that simulates the slopes of its next prediction together with it."""

    def expect(self, steps: np.ndarray, central: bool) -> None:
        """Announce the slopes that follow unless the next prediction is discarded."""


@dataclass(frozen=True)
class LikelihoodMaximum:
    """Maximum of a likelihood.

    Attributes
    ----------
    theta : array (unknown,)
    residuals : list of array (samples, outputs)
        Per manoeuvre measured minus predicted, 0 without a reading.
    slopes : list of array (samples, outputs, unknowns of the manoeuvre)
    noise : array (manoeuvre, output)
        Variance R.
    information : array (unknown, unknown)
        M, prior included.
    active : array of bool (unknown,)
        Unknowns at a bound against which the likelihood pushes.
    cost : float
        J.
    iterations : int
    stop : str
        Why the search ended: `CONVERGED`, `STALLED`, `EXHAUSTED` or `STATIONARY`.
    remaining : array (unknown,)
        Step without damping at the end; zero for the unknowns at a bound, and without equations of
        central differences.
    width : array (unknown,)
        Of a stationary end, the distance of each unknown within which the cost does not differ, in
        standard errors; else empty.
    """

    theta: np.ndarray
    residuals: Any
    slopes: Any
    noise: np.ndarray
    information: np.ndarray
    active: np.ndarray
    cost: float
    iterations: int
    stop: str
    remaining: np.ndarray
    width: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def converged(self) -> bool:
        """Whether gradient and step prove the maximum."""
        return self.stop == CONVERGED

    @property
    def is_proven(self) -> bool:
        """Whether the search converged, or the cost around its end shows a maximum."""
        return self.stop in (CONVERGED, STATIONARY)


class Target(Protocol):
    """A cost to minimise. The types of its residuals and slopes are private to it."""

    layout: UnknownVector

    def residuals(self, theta: np.ndarray) -> Any:
        """Return the residuals, from which cost and normal equations follow."""

    def scatter(self, residuals: Any) -> np.ndarray:
        """Return the variance of the residuals (manoeuvre, output)."""

    def cost(self, theta: np.ndarray, residuals: Any) -> float:
        """Return J; infinite if the manoeuvres cannot be simulated."""

    def expect(self, steps: np.ndarray, central: bool) -> None:
        """Announce the slopes that follow the next residuals, unless the cost rises."""

    def slopes(self, theta: np.ndarray, steps: np.ndarray, central: bool) -> Any:
        """Return the derivatives of the residuals; one-sided ones suffice if not `central`."""

    def normal(
        self, theta: np.ndarray, residuals: Any, slopes: Any
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the information M and the downhill gradient."""


class Likelihood:
    """J over pieces.

    Parameters
    ----------
    pieces : sequence of Piece
    layout : UnknownVector
    groups : array of int (manoeuvre,)
        Manoeuvres of one group have one noise covariance.
    """

    def __init__(self, pieces: Sequence[Piece], layout: UnknownVector, groups: np.ndarray):
        self.pieces, self.layout, self.groups = pieces, layout, groups
        self.has_reading = [np.isfinite(piece.measured) for piece in pieces]
        self.counts = self._sum_groups([mask.sum(axis=0) for mask in self.has_reading])
        # A noise-free output would have the logarithm of zero: its variance has a floor.
        centred = []
        for piece in pieces:
            centred.append(piece.measured - np.nanmean(piece.measured, axis=0))
        rms = np.sqrt(np.nanmean(np.concatenate(centred) ** 2, axis=0))
        self.floor = (FLOOR * np.maximum(rms, _LEAST_RMS)) ** 2
        is_simulated = all(isinstance(piece, PrefetchedRuns) for piece in pieces)
        self.in_parallel = len(pieces) > 1 and is_simulated

    def _sum_groups(self, rows: Sequence[np.ndarray]) -> np.ndarray:
        """Return the sums of rows (manoeuvre, output) over the groups, (group, output)."""
        total = np.zeros((self.groups.max() + 1, len(rows[0])))
        for group, row in zip(self.groups, rows):
            total[group] += row
        return total

    def _map_pieces(self, evaluate: Callable[[Any, np.ndarray], np.ndarray]) -> list[np.ndarray]:
        """Evaluate every piece with the columns of its unknowns.

        Simulated pieces are evaluated in parallel: a batch of one uses few processors.
        """
        if not self.in_parallel:
            return list(map(evaluate, self.pieces, self.layout.columns))
        with ThreadPoolExecutor(min(len(self.pieces), os.cpu_count() or 1)) as pool:
            return list(pool.map(evaluate, self.pieces, self.layout.columns))

    def residuals(self, theta: np.ndarray) -> list[np.ndarray]:
        """Return measured minus predicted per piece."""
        predicted = self._map_pieces(lambda piece, columns: piece.predict(theta[columns]))
        residuals = []
        for piece, y, mask in zip(self.pieces, predicted, self.has_reading):
            residuals.append(np.where(mask, piece.measured - y, 0.0))
        return residuals

    def noise(self, residuals: Sequence[np.ndarray]) -> np.ndarray:
        """Return R (group, output)."""
        squares = self._sum_groups([(v**2).sum(axis=0) for v in residuals])
        return np.maximum(squares / np.maximum(self.counts, 1), self.floor)

    def scatter(self, residuals: Sequence[np.ndarray]) -> np.ndarray:
        """Return R (manoeuvre, output)."""
        return self.noise(residuals)[self.groups]

    def cost(self, theta: np.ndarray, residuals: Sequence[np.ndarray]) -> float:
        """Return J; infinite if a piece cannot be simulated."""
        # J with the best variance: sum N/2 ln R, and the distance from the prior.
        by_noise = 0.5 * float((self.counts * np.log(self.noise(residuals))).sum())
        by_prior = 0.5 * float((self._prior_distance(theta) ** 2).sum())
        total = by_noise + by_prior
        if not np.isfinite(total):
            return np.inf
        return total

    def _prior_distance(self, theta: np.ndarray) -> np.ndarray:
        return (theta - self.layout.start) / self.layout.sigma

    def expect(self, steps: np.ndarray, central: bool) -> None:
        """Announce the slopes to those pieces that simulate them with a prediction."""
        for piece, columns in zip(self.pieces, self.layout.columns):
            if isinstance(piece, PrefetchedRuns):
                piece.expect(steps[columns], central)

    def slopes(self, theta: np.ndarray, steps: np.ndarray, central: bool) -> list[np.ndarray]:
        """Return S per piece."""
        slopes = self._map_pieces(
            lambda piece, columns: piece.slopes(theta[columns], steps[columns], central)
        )
        for S, mask in zip(slopes, self.has_reading):
            # A missing reading has no slope, as its residual is zero.
            if not mask.all():
                S[~mask] = 0.0
        return slopes

    def normal(
        self, theta: np.ndarray, residuals: Sequence[np.ndarray], slopes: Sequence[np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the information M and the downhill gradient."""
        # M = sum S'R^-1 S + P^-1, gradient sum S'R^-1 v - P^-1 (theta - theta_0)
        M = np.diag(self.layout.sigma**-2.0)
        g = -self._prior_distance(theta) / self.layout.sigma
        noise = self.noise(residuals)
        for columns, group, v, S in zip(self.layout.columns, self.groups, residuals, slopes):
            # Weighted slopes of all readings in one column per unknown.
            root = 1.0 / np.sqrt(noise[group])
            X = (S * root[None, :, None]).reshape(-1, S.shape[2])
            M[np.ix_(columns, columns)] += X.T @ X
            g[columns] += X.T @ (v * root).ravel()
        return M, g
