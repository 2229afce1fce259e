"""Likelihood of the innovations of a filter, and its search from several starts.

    J = 1/2 sum_k (e_k' S_k^-1 e_k + ln |S_k|) + 1/2 (theta - theta_0)' P^-1 (theta - theta_0)

Fisher's scoring: M_ij = sum_k [e_i' S^-1 e_j + 1/2 tr(S^-1 S_i S^-1 S_j)], with the slopes e_i and
S_i of innovations and variance [Maine1981]_. A steady filter has one variance S for all samples.

References
----------
.. [Maine1981] Maine, Iliff, Formulation and implementation of a practical algorithm for parameter
   estimation with process and measurement noise, SIAM J. Appl. Math. 41, 1981.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple, Protocol

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flighttest.maximum_likelihood.constrained_unknowns import ConstrainedPiece
from flighttest.maximum_likelihood.innovations import whiteness_variables
from flighttest.maximum_likelihood.likelihood import LikelihoodMaximum
from flighttest.maximum_likelihood.linear.positive_unknowns import PositiveTransform
from flighttest.maximum_likelihood.residual_covariance import (
    coloured_likelihood_covariance,
    effect_on_motion,
)
from flighttest.maximum_likelihood.result import estimates_dataset, noise_dataset
from flighttest.maximum_likelihood.search import maximise_likelihood
from flighttest.maximum_likelihood.unknowns import UnknownVector

_INTENSITIES = ("process", "gust")
_LEAST = 1e-6  # smallest start of a noise, of the spread of the output
_LEAST_NOISE = 1e-12  # smallest start of a noise
_START_FACTORS = (1e-3, 1e3)  # of the variance of an intensity, for further starts of the search
SAME_COST = 0.01  # ends of a search that differ by less are one maximum


class InnovationSlopes(NamedTuple):
    """Slopes of innovations and of their variance.

    Attributes
    ----------
    e : array (time, output, unknown)
    S : array (unknown, time or 1, output, output)
    """

    e: np.ndarray
    S: np.ndarray


class FilteredPiece(Protocol):
    """One manoeuvre and the filter of its readings."""

    z: np.ndarray  # readings (time, output)
    step: float  # sampling interval [s]

    def predict(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return innovations (time, output), and their variance (time or 1, output, output).

        A missing reading has the innovation zero and the variance one. The result is NaN without a
        filter.
        """

    def slopes(self, values: np.ndarray, steps: np.ndarray) -> InnovationSlopes:
        """Return the slopes by the unknowns of this manoeuvre; NaN without a filter."""


class Innovations(NamedTuple):
    """Innovations (time, output) and variances (time or 1, output, output) of each record.

    They are the residuals of `maximise_likelihood`.
    """

    parts: list[np.ndarray]
    variances: list[np.ndarray]


class InnovationLikelihood:
    """J of the innovations, the target of `maximise_likelihood`."""

    def __init__(self, pieces: Sequence[FilteredPiece], layout: UnknownVector):
        self.pieces, self.layout = pieces, layout

    def residuals(self, theta: np.ndarray) -> Innovations:
        """Return innovations and their variances."""
        innovations = Innovations([], [])
        for piece, columns in zip(self.pieces, self.layout.columns):
            e, S = piece.predict(theta[columns])
            innovations.parts.append(e)
            innovations.variances.append(S)
        return innovations

    def scatter(self, innovations: Innovations) -> np.ndarray:
        """Return the mean variances of the innovations (manoeuvre, output)."""
        return np.array([np.diag(S.mean(axis=0)) for S in innovations.variances])

    def cost(self, theta: np.ndarray, innovations: Innovations) -> float:
        """Return J; infinite without a filter, or if a covariance S is not positive definite."""
        total = 0.5 * float((((theta - self.layout.start) / self.layout.sigma) ** 2).sum())
        for e, S in zip(innovations.parts, innovations.variances):
            if not np.isfinite(S).all() or not np.isfinite(e).all():
                return np.inf
            # S must be positive definite. Its determinant is also positive with two negative
            # variances, and `normal` would fail at the accepted parameters.
            try:
                root = np.linalg.cholesky(S)
            except np.linalg.LinAlgError:
                return np.inf
            share = len(e) / len(S)
            log_det = 2.0 * float(np.log(np.diagonal(root, axis1=1, axis2=2)).sum())
            total += 0.5 * float((_solve_each(root, e) ** 2).sum()) + 0.5 * share * log_det
        return total

    def expect(self, steps: np.ndarray, central: bool) -> None:
        """Do nothing: a filter does not simulate slopes together with a prediction."""

    def slopes(self, theta: np.ndarray, steps: np.ndarray, central: bool) -> list[InnovationSlopes]:
        """Return slopes by central differences."""
        slopes = []
        for piece, columns in zip(self.pieces, self.layout.columns):
            slopes.append(piece.slopes(theta[columns], steps[columns]))
        return slopes

    def normal(
        self, theta: np.ndarray, innovations: Innovations, slopes: Sequence[InnovationSlopes]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return Fisher's information and the downhill gradient."""
        M = np.diag(self.layout.sigma**-2.0)
        g = -(theta - self.layout.start) / self.layout.sigma**2
        for columns, e, S, slope in zip(
            self.layout.columns, innovations.parts, innovations.variances, slopes
        ):
            # With S = L L': X = L^-1 e_i, w = L^-1 e and T_i = L^-1 S_i L^-T, so that
            # M_ij = sum X_i' X_j + 1/2 sum tr(T_i T_j).
            root, share = np.linalg.cholesky(S), len(e) / len(S)
            X = np.linalg.solve(root, slope.e).reshape(-1, len(columns))
            w = _solve_each(root, e)
            T = np.linalg.solve(root, np.linalg.solve(root, slope.S).swapaxes(-1, -2))
            flat = T.reshape(len(columns), -1)
            if len(S) == 1:
                products = (w.T @ w)[None]
            else:
                products = w[:, :, None] * w[:, None, :]
            excess = (share * np.eye(S.shape[-1]) - products).ravel()
            M[np.ix_(columns, columns)] += X.T @ X + 0.5 * share * flat @ flat.T
            g[columns] -= X.T @ w.ravel() + 0.5 * flat @ excess
        return M, g


class ConstrainedFilter(ConstrainedPiece):
    """A filtered manoeuvre as a function of its free unknowns."""

    def slopes(self, values: np.ndarray, steps: np.ndarray, *central: bool) -> InnovationSlopes:
        """Return slopes by the free unknowns."""
        slopes = self.piece.slopes(self.T @ values + self.t, self.all_steps(steps))
        return InnovationSlopes(slopes.e @ self.T, np.tensordot(self.T.T, slopes.S, axes=1))


def _solve_each(matrices: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return the solution (time, output) of one system for each row, or of one for all."""
    if len(matrices) == 1:
        return np.linalg.solve(matrices[0], rows.T).T
    return np.linalg.solve(matrices, rows[:, :, None])[:, :, 0]


def whiten_innovations(maximum: LikelihoodMaximum) -> LikelihoodMaximum:
    """Return innovations and slopes transformed to unit variance."""
    e, slopes = [], []
    for part, S, slope in zip(maximum.residuals.parts, maximum.residuals.variances, maximum.slopes):
        root = np.linalg.cholesky(S)
        e.append(_solve_each(root, part))
        slopes.append(np.linalg.solve(root, slope.e))
    return replace(maximum, residuals=e, slopes=slopes, noise=np.ones_like(maximum.noise))


def intensity_starts(layout: UnknownVector) -> list[np.ndarray]:
    """Return starts of a search: the given one, and a small and a large value of each intensity.

    The cost of the intensities has several minima: motion can be explained by a disturbance of one
    state or of another, or by noise.
    """
    starts = [layout.start]
    is_intensity = np.array([name.split(".")[0] in _INTENSITIES for name in layout.names])
    for k in np.flatnonzero(is_intensity):
        for factor in _START_FACTORS:
            start = layout.start.copy()
            start[k] = np.clip(factor * start[k], layout.low[k], layout.high[k])
            starts.append(start)
    return starts


def search_from_starts(
    likelihood: InnovationLikelihood, starts: Sequence[np.ndarray], iterations: int
) -> tuple[LikelihoodMaximum, int]:
    """Return the lowest cost of several starts, and the number of starts that ended above it.

    Raises
    ------
    IdentificationError
        Of the first start. Another start may have no filter.
    """
    ends = []
    for number, start in enumerate(starts):
        try:
            ends.append(maximise_likelihood(likelihood, iterations, start=start))
        except IdentificationError:
            if not number:
                raise
    best = min(ends, key=lambda end: end.cost)
    # Of equal ends a proven one is taken.
    for end in ends:
        if end.converged and end.cost < best.cost + SAME_COST:
            best = end
            break
    return best, sum(end.cost > best.cost + SAME_COST for end in ends)


def noise_starts(measured: Sequence[np.ndarray]) -> np.ndarray:
    """Return the noise of each output from second differences, in which smooth motion is small.

    Parameters
    ----------
    measured : sequence of array (time, output)
        NaN for a missing reading.
    """
    bends = np.concatenate([np.diff(z, 2, axis=0) for z in measured])
    centred = np.concatenate([z - np.nanmean(z, axis=0) for z in measured])
    spread = np.nanstd(centred, axis=0)
    # The second difference of white noise has six times its variance: 1 + 4 + 1.
    noise = np.sqrt(np.nanmean(bends**2, axis=0) / 6.0)
    return np.maximum(noise, np.maximum(_LEAST * spread, _LEAST_NOISE))


def filtered_datasets(
    maximum: LikelihoodMaximum,
    transformed: PositiveTransform,
    pieces: Sequence[FilteredPiece],
    outputs: Sequence[str],
    about: dict[str, str | float | int],
) -> tuple[xr.Dataset, xr.Dataset]:
    """Return the Datasets of estimates and noise of a filter error.

    Parameters
    ----------
    maximum : LikelihoodMaximum
        Of an `InnovationLikelihood` over the unknowns of `transformed`.
    transformed : PositiveTransform
    pieces : sequence of FilteredPiece
    outputs : sequence of str
    about : dict
        Attributes of the estimates.
    """
    columns, steps = transformed.layout.columns, [piece.step for piece in pieces]
    white = whiten_innovations(maximum)
    covariance, colours = coloured_likelihood_covariance(white, columns, steps)
    theta, scale = transformed.back(maximum.theta)
    size = np.outer(scale, scale)
    # The steps that remain are those of the natural unknowns too.
    in_deviations = replace(
        white,
        theta=theta,
        information=maximum.information / size,
        remaining=maximum.remaining * scale,
    )
    estimates = estimates_dataset(
        in_deviations, transformed.natural, covariance=covariance * size, about=about
    )
    # The noise is reported in the unit of the outputs, the effect in white units.
    innovations, measured = maximum.residuals.parts, [piece.z for piece in pieces]
    scaled = [piece.z / np.sqrt(R) for piece, R in zip(pieces, maximum.noise)]
    scatter = noise_dataset(
        replace(white, residuals=innovations, noise=maximum.noise),
        list(outputs),
        colours=colours,
        measured=measured,
        effect=effect_on_motion(white, columns, covariance=covariance, measured=scaled),
    )
    return estimates, scatter.merge(whiteness_variables(innovations, steps, measured))
