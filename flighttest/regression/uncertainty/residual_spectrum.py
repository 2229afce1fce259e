"""Spectrum of the disturbance behind the residuals of a regression.

A fit takes up part of the disturbance, most of all its slow part: read off the residual, the
variance of an intercept comes out several times too small.  What the fit takes from which frequency
is known from the regressors alone.  Of the discrete cosine transform of the disturbance, whose
values d_k are nearly uncorrelated for any colour [Ahmed1974]_, the fit leaves v = (I - QQ') d, with
the orthonormal transforms Q of the regressors.  For a spectrum S that is smooth over what the fit
mixes,

    E v_k^2 = (1 - h_k) S(f_k),    h_k = (QQ')_kk

S is found from the v_k^2 by Whittle's likelihood [Whittle1953]_, each weighted by the share 1 - h_k
of a degree of freedom that is left.  Frequencies that the fit has taken up contain no information;
there the prior speaks:

- ln S is a random walk over  u = asinh(f T),  T the longest stretch: in ln f above one cycle per record, flat below it.
  Its standard deviation per unit of u is one of `ROUGHNESS`, all equally probable beforehand
  [Kitagawa1985]_; below `CYCLES` cycles per record, where little is known, `SLOPE` at most.
- Of the variance of the disturbance over that of the residual, where above one, the logarithm is normal with the
  standard deviation ln `HIDDEN`.  ln S at one frequency is never more uncertain than ln `UNKNOWN`,
  which bounds the mean.

The negative logarithm of this posterior is strictly convex in ln S: level and power over S, sums of
squares, and the square of the positive part of a logarithm of a sum of exponentials are.  It has
one minimum, to which Newton's method leads from every start. About it the posterior is taken as
normal with the expected information, and the result is the posterior *mean* of S over spectrum and
roughness.  Nothing is selected, so that it is a smooth function of the data: errors of rounding
stay such.

References
----------
.. [Ahmed1974] Ahmed, Natarajan, Rao, Discrete cosine transform, IEEE Trans. Computers C-23, 1974.
.. [Whittle1953] Whittle, Estimation and information in stationary time series, Arkiv foer Matematik 2, 1953.
.. [Kitagawa1985] Kitagawa, Gersch, A smoothness priors time varying AR coefficient modeling of nonstationary covariance time
   series, IEEE Trans. Automatic Control 30, 1985.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy


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

    @classmethod
    def of_autocovariance(cls, r: np.ndarray) -> Disturbance:
        """Return the autoregression with the autocovariance `r` (order + 1,) at lags 0 ... order
        [Levinson1947]_.
        """
        a, reflections, variance = np.ones(1), [], float(r[0])
        for m in range(len(r) - 1 if variance > 0.0 else 0):
            k = -float(a @ r[m + 1 : 0 : -1]) / variance
            a = _longer(a, k)
            reflections.append(k)
            variance *= 1.0 - k * k
        return cls(np.array(reflections), variance)

    @cached_property
    def coefficients(self) -> np.ndarray:
        """1, a_1 ... a_p of the innovation e_t = v_t + a_1 v_(t-1) + ... + a_p v_(t-p)."""
        a = np.ones(1)
        for k in self.reflections:
            a = _longer(a, k)
        return a

    @cached_property
    def _whitening(self) -> np.ndarray:
        """Filters (order, order) that whiten the first samples, scaled to the variance of the
        innovation.
        """
        p = len(self.reflections)
        filters, a = np.zeros((p, p)), np.ones(1)
        for m, k in enumerate(self.reflections):
            filters[m, : m + 1] = a[::-1] * np.sqrt(np.prod(1.0 - self.reflections[m:] ** 2))
            a = _longer(a, k)
        return filters

    def autocovariance(self, lags: int) -> np.ndarray:
        """Return the autocovariance at lags 0 ... lags - 1."""
        p = len(self.reflections)
        r, a = np.zeros(p + 1), np.ones(1)
        r[0] = left = self.variance / np.prod(1.0 - self.reflections**2)
        for m, k in enumerate(self.reflections):
            r[m + 1] = -k * left - a[1:] @ r[m:0:-1]
            a, left = _longer(a, k), left * (1.0 - k * k)
        if lags <= p + 1:
            return r[:lags]
        later, _ = scipy.signal.lfilter([1.0], a, np.zeros(lags - p - 1), zi=_history(a, r))
        return np.concatenate([r, later])

    def innovations(self, v: np.ndarray) -> np.ndarray:
        """Return what the past of a signal (time,) does not predict; the first samples in units of
        the later ones.
        """
        p = len(self.reflections)
        first = self._whitening[: len(v), : len(v)] @ v[:p]
        return np.concatenate([first, scipy.signal.lfilter(self.coefficients, [1.0], v)[p:]])

    def sample(self, size: int, rng: np.random.Generator) -> np.ndarray:
        """Return one stretch of the disturbance, (size,), stationary from its first sample on."""
        a, p = self.coefficients, len(self.reflections)
        e = np.sqrt(self.variance) * rng.normal(size=max(size, p))
        first = scipy.linalg.solve_triangular(self._whitening, e[:p], lower=True) if p else e[:0]
        later = (
            scipy.signal.lfilter([1.0], a, e[p:], zi=_history(a, first))[0] if size > p else e[:0]
        )
        return np.concatenate([first, later])[:size]


def _longer(a: np.ndarray, k: float) -> np.ndarray:
    """Coefficients of the next order, with its reflection coefficient."""
    longer = np.zeros(len(a) + 1)
    longer[:-1] = a
    longer[1:] += k * a[::-1]
    return longer


def _history(a: np.ndarray, past: np.ndarray) -> np.ndarray:
    """State of the filter 1/a after given outputs."""
    p = len(a) - 1
    return -np.array([a[i + 1 :] @ past[::-1][: p - i] for i in range(p)])


OFFSETS = 3  # pieces from which on each has a constant of its own
ROUGHNESS = (18.0, 6.0, 2.0, 0.6)  # change of ln S per unit of u, one standard deviation
SLOPE, CYCLES = (
    1.5,
    2.0,
)  # the largest below so many cycles per record; an AR(1) disturbance has at most two
# variance of the disturbance over that of the residual that is one standard deviation from unity
HIDDEN = 3.0
UNKNOWN = (
    5.0  # factor on S of one standard deviation where neither data nor neighbours determine it
)
# white part added to the residual, of its variance: what a low-pass has removed is not looked up
FLOOR = 1e-4
ORDER = 32  # of the autoregression that has the autocovariance found
_KNOT = 0.35  # distance of the knots of ln S, in u
_VANISHED = 1e-6  # singular value of scaled regressors, over the largest, that is none
_LOST = 1e-6  # degree of freedom left at a frequency, that is none
_LONGEST, _STILL, _MOST = 3.0, 1e-6, 100  # step of ln S; last step; number of steps


class ResidualSpectrum(NamedTuple):
    """What was found of a disturbance.

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
        Uniform stretches without a gap, of one sampling interval, together all samples; independent
        of each other.  From three on, what differs between them as a constant is left out.
    """
    likelihood = _Likelihood(X, v, pieces)
    if not likelihood.power.any():
        white = float(v @ v) / max(1, len(v) - X.shape[1])
        return ResidualSpectrum(Disturbance(np.zeros(0), white), 1.0, 0.0)
    modes = [likelihood.mode(np.zeros(len(likelihood.knots)), ROUGHNESS[0])]
    for roughness in ROUGHNESS[1:]:
        modes.append(likelihood.mode(modes[-1].c, roughness))
    evidence = np.array([mode.evidence for mode in modes])
    share = np.exp(evidence - evidence.max())
    share /= share.sum()
    size = max(512, 1 << int(4 * likelihood.longest - 1).bit_length())
    grid = likelihood.hats(np.arange(size // 2 + 1) / size)
    S = sum(part * mode.mean(grid) for part, mode in zip(share, modes))
    r = np.fft.irfft(S)[: 1 + min(ORDER, likelihood.longest // 4)] * likelihood.scale
    return ResidualSpectrum(
        Disturbance.of_autocovariance(r), float(r[0] / likelihood.scale), float(share[0])
    )


class SpectrumMaximum(NamedTuple):
    """The maximum of the posterior of ln S at the knots, for one roughness."""

    c: np.ndarray
    covariance: np.ndarray
    evidence: float  # logarithm, but for a constant

    def mean(self, hats: RoofFunctions) -> np.ndarray:
        """Return the posterior mean of S at frequencies, that of a lognormal variable."""
        left, right = hats.left, 1.0 - hats.left
        own, neighbour = np.diag(self.covariance), np.diag(self.covariance, 1)
        variance = (
            left**2 * own[hats.cell]
            + 2.0 * left * right * neighbour[hats.cell]
            + right**2 * own[hats.cell + 1]
        )
        return np.exp(hats.at(self.c) + 0.5 / np.sqrt(variance**-2.0 + np.log(UNKNOWN) ** -4.0))


class RoofFunctions(NamedTuple):
    """Frequencies among the knots, between which ln S is linear: two knots act on each, so that
    sums of products are tridiagonal.
    """

    knots: int
    cell: np.ndarray  # the knot below
    left: np.ndarray  # share of that knot

    def at(self, c: np.ndarray) -> np.ndarray:
        """Return the function that has the values `c` at the knots."""
        return self.left * c[self.cell] + (1.0 - self.left) * c[self.cell + 1]

    def sums(self, weights: np.ndarray) -> np.ndarray:
        """Return the sum of the hat functions (knots,) over the frequencies, weighted."""
        below = np.bincount(self.cell, weights * self.left, self.knots)
        above = np.bincount(self.cell, weights * (1.0 - self.left), self.knots)
        below[1:] += above[:-1]
        return below

    def products(self, weights: np.ndarray) -> np.ndarray:
        """Return the sums of their products (knots, knots), weighted."""
        below, right = weights * self.left, 1.0 - self.left
        own = np.bincount(self.cell, below * self.left, self.knots)
        own[1:] += np.bincount(self.cell, weights * right**2, self.knots)[:-1]
        neighbour = np.bincount(self.cell, below * right, self.knots)[:-1]
        return np.diag(own) + np.diag(neighbour, 1) + np.diag(neighbour, -1)


class _TrialSpectrum(NamedTuple):
    """A spectrum under trial."""

    c: np.ndarray  # ln S at the knots
    cost: float
    S: np.ndarray
    ratio: np.ndarray  # power found over that expected
    # logarithm of hidden over visible variance in prior standard deviations, where above zero
    excess: float


class _Likelihood:
    """Whittle's likelihood of the spectrum of a disturbance of which a fit has left a part, with
    its prior.
    """

    def __init__(self, X: np.ndarray, v: np.ndarray, pieces: Sequence[slice]):
        own = len(pieces) >= OFFSETS  # constants are the first transforms
        self.longest = max(piece.stop - piece.start for piece in pieces)
        transforms, frequencies = [], []
        for piece in pieces:
            count = piece.stop - piece.start
            z = scipy.fft.dct(np.column_stack([X[piece], v[piece]]), type=2, norm="ortho", axis=0)
            f = np.arange(count) / (2.0 * count)
            f[0] = 0.25 / count  # middle of what a mean sees
            transforms.append(z[1:] if own else z)
            frequencies.append(f[1:] if own else f)
        z = np.concatenate(transforms)
        Q = _orthonormal(z[:, :-1])
        y = z[:, -1] - Q @ (Q.T @ z[:, -1])
        kept = 1.0 - np.einsum("ij,ij->i", Q, Q)
        self.scale = float(np.mean(y**2)) if len(y) else 0.0
        self.kept = np.where(kept > _LOST, kept, 0.0)
        used = self.kept > 0.0
        self.power = np.zeros(len(y))
        if self.scale > 0.0:
            self.power[used] = y[used] ** 2 / self.scale / self.kept[used] + FLOOR
        end = np.arcsinh(0.5 * self.longest)
        self.knots = np.linspace(0.0, end, 1 + max(1, int(np.ceil(end / _KNOT))))
        self.every = self.hats(np.concatenate(frequencies))

    def hats(self, f: np.ndarray) -> RoofFunctions:
        """Return frequencies in cycles per sample among the knots."""
        x = np.arcsinh(f * self.longest) / self.knots[1]
        cell = np.minimum(x.astype(int), len(self.knots) - 2)
        return RoofFunctions(len(self.knots), cell, 1.0 + cell - x)

    def mode(self, c: np.ndarray, roughness: float) -> SpectrumMaximum:
        """Return the maximum of the posterior from any start `c`, by Newton steps that never go
        down.
        """
        middle = np.sinh(0.5 * (self.knots[1:] + self.knots[:-1]))  # cycles per record
        step = np.where(middle < CYCLES, min(roughness, SLOPE), roughness) * np.sqrt(self.knots[1])
        D = np.diff(np.eye(len(c)), axis=0) / step[:, None]
        prior = D.T @ D
        at = self._at(c, prior)
        for _ in range(_MOST):
            change = -np.linalg.solve(*self._slopes(at, prior))
            size = float(np.abs(change).max())
            change *= min(1.0, _LONGEST / size)
            while (then := self._at(at.c + change, prior)).cost > at.cost + 1e-12 * abs(
                at.cost
            ) and np.abs(change).max() > _STILL:
                change = 0.5 * change
            at = then
            if size < _STILL:
                break
        information = 0.5 * self.every.products(self.kept) + prior + self._pull(at)[1]
        evidence = -at.cost - np.log(step).sum() - 0.5 * np.linalg.slogdet(information)[1]
        return SpectrumMaximum(at.c, np.linalg.inv(information), float(evidence))

    def _at(self, c: np.ndarray, prior: np.ndarray) -> _TrialSpectrum:
        """Return the negative logarithm of the posterior, and what it is made of."""
        level = self.every.at(c)
        S = np.exp(level)
        ratio = self.power / S
        excess = max(0.0, float(np.log(S.sum() / len(S)))) / np.log(HIDDEN)
        return _TrialSpectrum(
            c,
            0.5 * float(self.kept @ (level + ratio) + c @ prior @ c + excess**2),
            S,
            ratio,
            excess,
        )

    def _pull(self, at: _TrialSpectrum) -> tuple[np.ndarray, np.ndarray]:
        """Gradient and second derivatives of the prior on the hidden variance."""
        if at.excess == 0.0:
            return np.zeros(len(at.c)), np.zeros((len(at.c), len(at.c)))
        share, unit = at.S / at.S.sum(), 1.0 / np.log(HIDDEN)
        mean = self.every.sums(share)
        outer = np.outer(mean, mean)
        return at.excess * unit * mean, outer * unit**2 + at.excess * unit * (
            self.every.products(share) - outer
        )

    def _slopes(self, at: _TrialSpectrum, prior: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Second derivatives and gradient of the cost."""
        slope, bend = self._pull(at)
        found = self.kept * at.ratio
        return 0.5 * self.every.products(found) + prior + bend, 0.5 * self.every.sums(
            self.kept - found
        ) + prior @ at.c + slope


def _orthonormal(X: np.ndarray) -> np.ndarray:
    """Orthonormal columns that span the regressors; combinations that have vanished are left out."""
    size = np.linalg.norm(X, axis=0)
    X = X[:, size > 0.0] / size[size > 0.0]
    if not X.size:
        return np.zeros((len(X), 0))
    U, s, _ = np.linalg.svd(X, full_matrices=False)
    return U[:, s > _VANISHED * s[0]]
