"""Spectrum of the disturbance behind the residuals of a regression.

A fit absorbs part of the disturbance, most of all its slow part. If the variance of an intercept is
taken from the residual, it is several times too small. The regressors alone determine what the fit
absorbs at which frequency. The discrete cosine transform of the disturbance has values d_k that are
nearly uncorrelated for any colour [Ahmed1974]_. The fit leaves v = (I - QQ') d, with the
orthonormal transforms Q of the regressors. For a spectrum S that is smooth over the frequencies
that the fit mixes,

    E v_k^2 = (1 - h_k) S(f_k),    h_k = (QQ')_kk

S is estimated from the v_k^2 by Whittle's likelihood [Whittle1953]_. Each v_k^2 has the weight
1 - h_k, the share of a degree of freedom that the fit leaves. Frequencies that the fit has absorbed
contain no information. The prior determines S there:

- ln S is a random walk over u = asinh(f T), with T the longest stretch. It is a walk in ln f above
  one cycle per record and flat below. Its standard deviation per unit of u is one of `ROUGHNESS`,
  all equally probable beforehand [Kitagawa1985]_. Below `CYCLES` cycles per record, where the data
  contain little information, it is `SLOPE` at most.
- The ratio of the variance of the disturbance to that of the residual has a prior where it is above
  one: its logarithm is normal with the standard deviation ln `HIDDEN`.
- The standard deviation of ln S at one frequency is at most ln `UNKNOWN`, which bounds the mean.

The negative logarithm of this posterior is strictly convex in ln S. Its parts are convex: the level
and the power over S, sums of squares, and the square of the positive part of a logarithm of a sum
of exponentials. It has one minimum, and Newton's method reaches it from every start. Near the
minimum the posterior is approximated as normal with the expected information. The result is the
posterior *mean* of S over spectrum and roughness. No model is selected, so the result is a smooth
function of the data, and rounding errors stay small.

References
----------
.. [Ahmed1974] Ahmed, Natarajan, Rao, Discrete cosine transform, IEEE Trans. Computers C-23, 1974.
.. [Whittle1953] Whittle, Estimation and information in stationary time series, Arkiv foer
   Matematik 2, 1953.
.. [Kitagawa1985] Kitagawa, Gersch, A smoothness priors time varying AR coefficient modeling of
   nonstationary covariance time series, IEEE Trans. Automatic Control 30, 1985.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy

from flighttest.regression.uncertainty.disturbance import Disturbance

OFFSETS = 3  # pieces from which on each has a constant of its own
ROUGHNESS = (18.0, 6.0, 2.0, 0.6)  # change of ln S per unit of u, one standard deviation
# largest roughness below so many cycles per record; an AR(1) disturbance has at most two
SLOPE, CYCLES = 1.5, 2.0
# variance of the disturbance over that of the residual that is one standard deviation from unity
HIDDEN = 3.0
# factor on S of one standard deviation where neither data nor neighbours determine it
UNKNOWN = 5.0
# white part added to the residual, of its variance: stands for the band that a low-pass has emptied
FLOOR = 1e-4
ORDER = 32  # of the autoregression with the estimated autocovariance
_KNOT = 0.35  # distance of the knots of ln S, in u
_VANISHED = 1e-6  # singular value of scaled regressors, over the largest, that counts as zero
_LOST = 1e-6  # share of a degree of freedom that counts as zero
_LONGEST = 3.0  # longest step of ln S
_STILL = 1e-6  # step of ln S that ends the search
_MOST = 100  # steps of the search
_ROUNDING = 1e-12  # increase of the cost, of its size, that may be rounding
_LEAST_GRID = 512  # frequencies of the grid on which the autocovariance is computed, at least


class ResidualSpectrum(NamedTuple):
    """Disturbance behind the residuals of a regression.

    Attributes
    ----------
    model : Disturbance
        Autoregression with the autocovariance of the spectrum, per sample.
    hidden : float
        Variance of the disturbance over that of the residual.
    edge : float
        Posterior probability of the largest roughness.
    """

    model: Disturbance
    hidden: float
    edge: float


def residual_spectrum(X: np.ndarray, v: np.ndarray, pieces: Sequence[slice]) -> ResidualSpectrum:
    """Return the disturbance behind the residuals of least squares.

    Parameters
    ----------
    X : array (samples, terms)
        Regressors.
    v : array (samples,)
        Residuals of least squares on them.
    pieces : sequence of slice
        Uniform stretches without a gap, of one sampling interval, together all samples. They are
        independent of each other. From three stretches on, a constant per stretch is removed.
    """
    likelihood = _Likelihood(X, v, pieces)
    if not likelihood.power.any():
        white = float(v @ v) / max(1, len(v) - X.shape[1])
        return ResidualSpectrum(Disturbance(np.zeros(0), white), 1.0, 0.0)
    # Each roughness starts from the maximum of the next rougher one.
    modes = [likelihood.mode(np.zeros(len(likelihood.knots)), ROUGHNESS[0])]
    for roughness in ROUGHNESS[1:]:
        modes.append(likelihood.mode(modes[-1].c, roughness))
    evidence = np.array([mode.evidence for mode in modes])
    probability = np.exp(evidence - evidence.max())
    probability /= probability.sum()
    # Posterior mean of S on a uniform grid, twice as fine as the longest stretch resolves.
    size = max(_LEAST_GRID, 1 << int(4 * likelihood.longest - 1).bit_length())
    grid = likelihood.hats(np.arange(size // 2 + 1) / size)
    S = sum(weight * mode.mean(grid) for weight, mode in zip(probability, modes))
    # The autocovariance is the inverse transform of the spectrum.
    lags = 1 + min(ORDER, likelihood.longest // 4)
    r = np.fft.irfft(S)[:lags] * likelihood.scale
    return ResidualSpectrum(
        model=Disturbance.of_autocovariance(r),
        hidden=float(r[0] / likelihood.scale),
        edge=float(probability[0]),
    )


class SpectrumMaximum(NamedTuple):
    """Maximum of the posterior of ln S at the knots, for one roughness.

    Attributes
    ----------
    c : array (knots,)
        ln S.
    covariance : array (knots, knots)
    evidence : float
        Logarithm of the evidence, but for a constant.
    """

    c: np.ndarray
    covariance: np.ndarray
    evidence: float

    def mean(self, hats: RoofFunctions) -> np.ndarray:
        """Return the posterior mean of S at frequencies, the mean of a lognormal variable."""
        below, above = hats.below, 1.0 - hats.below
        # Variance of a linear interpolation between two neighbouring knots.
        variances, covariances = np.diag(self.covariance), np.diag(self.covariance, 1)
        variance = (
            below**2 * variances[hats.cell]
            + 2.0 * below * above * covariances[hats.cell]
            + above**2 * variances[hats.cell + 1]
        )
        # The variance is bounded by ln(UNKNOWN)^2: harmonic sum of the squared variances.
        return np.exp(
            hats.interpolate(self.c) + 0.5 / np.sqrt(variance**-2.0 + np.log(UNKNOWN) ** -4.0)
        )


class RoofFunctions(NamedTuple):
    """Frequencies among the knots of ln S, which is linear between two knots.

    Two knots act on each frequency, so that sums of products are tridiagonal.

    Attributes
    ----------
    knots : int
        Number of knots.
    cell : array of int (frequencies,)
        Index of the knot below.
    below : array (frequencies,)
        Share of that knot.
    """

    knots: int
    cell: np.ndarray
    below: np.ndarray

    def interpolate(self, c: np.ndarray) -> np.ndarray:
        """Return the function that has the values `c` at the knots."""
        return self.below * c[self.cell] + (1.0 - self.below) * c[self.cell + 1]

    def sums(self, weights: np.ndarray) -> np.ndarray:
        """Return the weighted sums of the hat functions over the frequencies, (knots,)."""
        sums = np.bincount(self.cell, weights * self.below, self.knots)
        above = np.bincount(self.cell, weights * (1.0 - self.below), self.knots)
        sums[1:] += above[:-1]
        return sums

    def products(self, weights: np.ndarray) -> np.ndarray:
        """Return the weighted sums of products of two hat functions, (knots, knots)."""
        below_weights, above = weights * self.below, 1.0 - self.below
        diagonal = np.bincount(self.cell, below_weights * self.below, self.knots)
        diagonal[1:] += np.bincount(self.cell, weights * above**2, self.knots)[:-1]
        neighbour = np.bincount(self.cell, below_weights * above, self.knots)[:-1]
        return np.diag(diagonal) + np.diag(neighbour, 1) + np.diag(neighbour, -1)


class _TrialSpectrum(NamedTuple):
    """A trial spectrum and the negative logarithm of its posterior.

    Attributes
    ----------
    c : array (knots,)
        ln S at the knots.
    cost : float
    S : array (frequencies,)
    ratio : array (frequencies,)
        Measured over expected power.
    excess : float
        Logarithm of disturbance variance over residual variance in prior standard deviations;
        zero where it would be negative.
    """

    c: np.ndarray
    cost: float
    S: np.ndarray
    ratio: np.ndarray
    excess: float


class _Likelihood:
    """Whittle's likelihood of the spectrum behind a residual, with its prior.

    Attributes
    ----------
    longest : int
        Samples of the longest piece.
    scale : float
        Mean square of the transformed residual.
    free : array (frequencies,)
        Share 1 - h_k of a degree of freedom that the fit leaves.
    power : array (frequencies,)
        v_k^2 over `scale` and `free`.
    knots : array (knots,)
        Knots of ln S, in u.
    frequencies : RoofFunctions
        All frequencies of all pieces.
    """

    def __init__(self, X: np.ndarray, v: np.ndarray, pieces: Sequence[slice]):
        # Piece constants are the first transforms: without them, the transforms start at one.
        first = 1 if len(pieces) >= OFFSETS else 0
        self.longest = max(piece.stop - piece.start for piece in pieces)
        transforms, frequencies = [], []
        for piece in pieces:
            count = piece.stop - piece.start
            columns = np.column_stack([X[piece], v[piece]])
            z = scipy.fft.dct(columns, type=2, norm="ortho", axis=0)
            f = np.arange(count) / (2.0 * count)
            f[0] = 0.25 / count  # middle of the band of a mean
            transforms.append(z[first:])
            frequencies.append(f[first:])
        z = np.concatenate(transforms)
        Q = _orthonormal_basis(z[:, :-1])
        y = z[:, -1] - Q @ (Q.T @ z[:, -1])
        free = 1.0 - np.einsum("ij,ij->i", Q, Q)
        self.scale = 0.0
        if len(y):
            self.scale = float(np.mean(y**2))
        self.free = np.where(free > _LOST, free, 0.0)
        used = self.free > 0.0
        self.power = np.zeros(len(y))
        if self.scale > 0.0:
            self.power[used] = y[used] ** 2 / self.scale / self.free[used] + FLOOR
        end = np.arcsinh(0.5 * self.longest)
        self.knots = np.linspace(0.0, end, 1 + max(1, int(np.ceil(end / _KNOT))))
        self.frequencies = self.hats(np.concatenate(frequencies))

    def hats(self, f: np.ndarray) -> RoofFunctions:
        """Return frequencies in cycles per sample among the knots."""
        x = np.arcsinh(f * self.longest) / self.knots[1]
        cell = np.minimum(x.astype(int), len(self.knots) - 2)
        return RoofFunctions(len(self.knots), cell, 1.0 + cell - x)

    def mode(self, c: np.ndarray, roughness: float) -> SpectrumMaximum:
        """Return the maximum of the posterior, by damped Newton steps from any start `c`."""
        # Random walk: differences of ln S between knots, over their standard deviations.
        middle = np.sinh(0.5 * (self.knots[1:] + self.knots[:-1]))  # cycles per record
        by_cell = np.where(middle < CYCLES, min(roughness, SLOPE), roughness)
        step = by_cell * np.sqrt(self.knots[1])
        D = np.diff(np.eye(len(c)), axis=0) / step[:, None]
        prior = D.T @ D
        trial = self._evaluate(c, prior)
        for _ in range(_MOST):
            change = -np.linalg.solve(*self._derivatives(trial, prior))
            size = float(np.abs(change).max())
            change *= min(1.0, _LONGEST / size)
            trial = self._search_line(trial, change, prior)
            if size < _STILL:
                break
        information = (
            0.5 * self.frequencies.products(self.free) + prior + self._hidden_prior(trial)[1]
        )
        # Laplace's approximation of the evidence.
        evidence = -trial.cost - np.log(step).sum() - 0.5 * np.linalg.slogdet(information)[1]
        return SpectrumMaximum(trial.c, np.linalg.inv(information), float(evidence))

    def _search_line(
        self, trial: _TrialSpectrum, change: np.ndarray, prior: np.ndarray
    ) -> _TrialSpectrum:
        """Return the spectrum after a step, which is halved until the cost does not rise."""
        changed = self._evaluate(trial.c + change, prior)
        limit = trial.cost + _ROUNDING * abs(trial.cost)
        while changed.cost > limit and np.abs(change).max() > _STILL:
            change = 0.5 * change
            changed = self._evaluate(trial.c + change, prior)
        return changed

    def _evaluate(self, c: np.ndarray, prior: np.ndarray) -> _TrialSpectrum:
        """Return the negative logarithm of the posterior and its parts."""
        level = self.frequencies.interpolate(c)
        S = np.exp(level)
        ratio = self.power / S
        excess = max(0.0, float(np.log(S.sum() / len(S)))) / np.log(HIDDEN)
        # Whittle: sum of (1 - h) (ln S + v^2/S) / 2; then random walk and hidden variance.
        cost = 0.5 * float(self.free @ (level + ratio) + c @ prior @ c + excess**2)
        return _TrialSpectrum(c, cost, S=S, ratio=ratio, excess=excess)

    def _hidden_prior(self, trial: _TrialSpectrum) -> tuple[np.ndarray, np.ndarray]:
        """Return gradient and second derivatives of the prior on the hidden variance."""
        if trial.excess == 0.0:
            return np.zeros(len(trial.c)), np.zeros((len(trial.c), len(trial.c)))
        share, unit = trial.S / trial.S.sum(), 1.0 / np.log(HIDDEN)
        mean = self.frequencies.sums(share)
        outer = np.outer(mean, mean)
        curvature = trial.excess * unit * (self.frequencies.products(share) - outer)
        return trial.excess * unit * mean, outer * unit**2 + curvature

    def _derivatives(
        self, trial: _TrialSpectrum, prior: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return second derivatives and gradient of the cost."""
        hidden_gradient, hidden_curvature = self._hidden_prior(trial)
        power = self.free * trial.ratio
        curvature = 0.5 * self.frequencies.products(power) + prior + hidden_curvature
        gradient = 0.5 * self.frequencies.sums(self.free - power) + prior @ trial.c
        return curvature, gradient + hidden_gradient


def _orthonormal_basis(X: np.ndarray) -> np.ndarray:
    """Return orthonormal columns that span the regressors, without vanished combinations."""
    size = np.linalg.norm(X, axis=0)
    X = X[:, size > 0.0] / size[size > 0.0]
    if not X.size:
        return np.zeros((len(X), 0))
    U, s, _ = np.linalg.svd(X, full_matrices=False)
    return U[:, s > _VANISHED * s[0]]
