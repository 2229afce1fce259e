"""Least squares over samples of driven manoeuvres and windows of free motion together, with noise
in the regressors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from flightmech.errors import IdentificationError
from flighttest.regression.equation_error import least_squares
from flighttest.regression.uncertainty import collinearity
from flighttest.regression.uncertainty.coloured_residuals import coloured_covariance_of

_PASSES = 5  # of the weights
_LEAST = 0.1  # of the mean square of the residuals: what the noise of the regressors never explains
_SAFE = 0.5
_NOISY = 0.9  # share of noise in what distinguishes a regressor from the others


@dataclass(frozen=True)
class RecordEquations:
    """Equations of one record.

    Attributes
    ----------
    X : array (rows, terms)
    z : array (rows,)
    noise : array (rows, terms)
        Variance of the noise in every regressor.
    lengths : tuple of int
        Rows of every stretch without a gap.
    step : float
        Sampling interval. [s]
    """

    X: np.ndarray
    z: np.ndarray
    noise: np.ndarray
    lengths: tuple[int, ...]
    step: float


@dataclass(frozen=True)
class PriorConstraint:
    """What is known of the estimates from elsewhere: ``row @ theta`` is `value` within `stderr`."""

    row: np.ndarray
    value: float
    stderr: float


@dataclass(frozen=True)
class JointFit:
    """Estimates of both together.

    Attributes
    ----------
    theta : array (terms,)
    X : array (rows, terms)
        Weighted regressors.
    estimator : array (terms, rows)
        What turns a change of the response, samples before windows before what is known, into one
        of theta.
    residual : array (rows,)
    samples, windows : int
        Rows of either.
    variances : array (rows,)
        Of the residuals.
    lengths : tuple of int
        Samples of every stretch without a gap.
    steps : tuple of float
        Sampling interval of each. [s]
    """

    theta: np.ndarray
    X: np.ndarray
    estimator: np.ndarray
    residual: np.ndarray
    samples: int
    windows: int
    variances: np.ndarray
    lengths: tuple[int, ...]
    steps: tuple[float, ...]

    @cached_property
    def covariance(self) -> np.ndarray:
        """Covariance of theta, (terms, terms): residuals of the samples coloured, those of the
        windows independent.
        """
        ends = np.cumsum(self.lengths)
        pieces = [slice(int(b) - a, int(b)) for a, b in zip(self.lengths, ends)]
        A, rest = self.estimator[:, : self.samples], self.estimator[:, self.samples :]
        found = coloured_covariance_of(
            least_squares.equivalent_regressors(A),
            self.residual[: self.samples],
            pieces,
            self.steps,
        ).covariance
        return found + rest * self.variances[self.samples :] @ rest.T


def stretch_lengths(use: np.ndarray) -> tuple[int, ...]:
    """Return how many samples every stretch without a gap holds."""
    own = np.flatnonzero(use)
    edges = [0, *(np.flatnonzero(np.diff(own) > 1) + 1).tolist(), len(own)]
    return tuple(b - a for a, b in pairwise(edges))


def joint_fit(
    samples: Sequence[RecordEquations],
    windows: Sequence[RecordEquations],
    names: Sequence[str],
    cutoff: float,
    known: Sequence[PriorConstraint] = (),
) -> JointFit:
    """Fit both by weighted least squares, corrected for the noise in the regressors.

    Parameters
    ----------
    samples, windows : sequence of Rows
        Of driven manoeuvres behind a low-pass; of free motion, see `modulation`.
    names : sequence of str
        Of the terms.
    cutoff : float
        Of the low-pass, which gives how many samples are worth an independent one. [Hz]
    known : sequence of Known, optional
        One equation more each.

    Raises
    ------
    IdentificationError
        A regressor that is mostly noise.

    Notes
    -----
    X'X exceeds that of the true regressors by the noise, whose size is known from the pick-ups, and is reduced by it.  Weights are the
    residuals' own variances.

    References
    ----------
    .. [Fuller1987] Fuller, Measurement Error Models, 1987, section 2.2.
    """
    n = len(samples)
    sizes = np.array([len(one.z) for one in (*samples, *windows)])
    source = np.concatenate(
        [np.repeat((np.arange(len(sizes)) >= n).astype(int), sizes), np.full(len(known), 2)]
    )  # samples, windows, known
    more = np.array([one.row for one in known]).reshape(len(known), len(names))
    X = np.concatenate([*(one.X for one in (*samples, *windows)), more])
    z = np.concatenate([*(one.z for one in (*samples, *windows)), [one.value for one in known]])
    noise = np.concatenate([*(one.noise for one in (*samples, *windows)), np.zeros(more.shape)])
    fixed = np.array([one.stderr**2 for one in known])
    worth = np.array(
        [min(1.0, 2.0 * cutoff * float(np.median([one.step for one in samples]))), 1.0, 1.0]
    )[source]
    weight = worth.copy()
    weight[source == 2] /= fixed
    for number in range(_PASSES):
        root = np.sqrt(weight)
        theta, equivalent = _without_noise(
            root[:, None] * X, root * z, weight @ noise, names, final=number + 1 == _PASSES
        )
        v = z - X @ theta
        weight = worth / _variances(v, noise @ theta**2, source, fixed)
    estimator = least_squares.estimator_matrix(equivalent) * root
    counts = [int((source == k).sum()) for k in (0, 1)]
    lengths = tuple(length for one in samples for length in one.lengths)
    steps = tuple(one.step for one in samples for _ in one.lengths)
    variances = _variances(v, noise @ theta**2, source, fixed)
    return JointFit(
        theta, root[:, None] * X, estimator, v, counts[0], counts[1], variances, lengths, steps
    )


def _variances(
    v: np.ndarray, by_noise: np.ndarray, source: np.ndarray, fixed: np.ndarray
) -> np.ndarray:
    """Variance of every residual: what the noise of the regressors explains, and of each source one
    more that is common to its rows.
    """
    found = by_noise.copy()
    found[source == 2] = fixed
    for k in np.unique(source[source < 2]):
        own = source == k
        total = float(np.mean(v[own] ** 2))
        found[own] += max(total - float(np.mean(by_noise[own])), _LEAST * total)
    return found


def _without_noise(
    X: np.ndarray, z: np.ndarray, noise: np.ndarray, names: Sequence[str], final: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Estimate whose regressors carry noise, and the regressors of which it is the ordinary one.

    Before weights are known, noise may exceed the regressor; so much of it is then taken off as is
    safe.
    """
    collinearity.demand_rank(X, names)
    R = np.linalg.qr(X, mode="r")
    share = noise * np.sum(np.linalg.inv(R) ** 2, axis=1)
    worst = float(share.max())
    if final and worst > _NOISY:
        text = (
            f"{worst:.0%} of what distinguishes it from the other terms is noise; give faster "
            f"motion or leave it out"
        )
        raise IdentificationError(f"{names[int(np.argmax(share))]}: {text}")
    return least_squares.solve_least_squares(
        X, z, -noise * min(1.0, _SAFE / worst if worst > 0.0 else 1.0) if not final else -noise
    )
