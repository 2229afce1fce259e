"""Covariance of a least-squares estimate whose residuals are correlated in time.

The textbook formula takes residuals for white and is two to five times too small on flight data.
Here the spectrum of the disturbance behind the residuals is found, what the fit has taken up
included (`residual_spectrum`); or, where a lag window is given, the residual's own autocorrelation
is used, tapered and cut.  Between manoeuvres nothing is correlated.  What differs from manoeuvre to
manoeuvre as a constant is a variance of its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy

from flighttest.regression.uncertainty.residual_spectrum import (
    OFFSETS,
    Disturbance,
    ResidualSpectrum,
    residual_spectrum,
)

BLOCK = 0.08  # residuals are averaged over so long at most before their colour is looked at [s]
# part of what forms an estimate that may lie within the blocks; of the residual, above what they
# resolve
UNRESOLVED = 0.1
WINDOW = 0.1  # lag window that standard errors are compared with, of the longest piece
_OWN = 25  # blocks from which on a manoeuvre has a disturbance of its own size


class Coloured(NamedTuple):
    """Covariance of a least-squares estimate, and what it rests on.

    Attributes
    ----------
    covariance : array (terms, terms)
    offset : float
        Standard deviation of a constant that differs from piece to piece, beyond what the
        disturbance explains; in the covariance.
    windowed : array (terms,)
        Standard errors by a lag window: the one given, or of a tenth of the longest piece, for
        comparison.
    hidden, edge : float
        Largest over the clocks of what `ResidualSpectrum` holds; 1 and 0 with a lag window.
    """

    covariance: np.ndarray
    offset: float
    windowed: np.ndarray
    hidden: float = 1.0
    edge: float = 0.0


def coloured_covariance_of(
    X: np.ndarray,
    v: np.ndarray,
    pieces: Sequence[slice],
    steps: Sequence[float],
    lag: float | None = None,
) -> Coloured:
    """Return the covariance of a least-squares estimate whose residuals are correlated in time.

    Parameters
    ----------
    X : array (samples, terms)
        Regressors.
    v : array (samples,)
        Residuals.
    pieces : sequence of slice
        Contiguous stretches of samples, in order.
    steps : sequence of float
        Sampling interval of each piece. [s]
    lag : float, optional
        Length of a lag window: the residual's biased autocorrelation with Bartlett's taper is used
        then. [s]

    Returns
    -------
    Coloured

    Notes
    -----
    cov = D [sum over pieces, i, j of x_i R(i - j) x_j'] D with D = (X'X)^-1 and R the autocovariance of the disturbance.
    With a lag window R(k) = w_k (1/N) sum v_i v_(i+k) of the piece, w_k = max(0, 1 - |k|/L), and the whole times
    N/(N - n).

    The window follows [Morelli1997] and [Newey1987].  It sees only what the fit has left of the
    disturbance and is too small for slow terms: of intercepts fitted to 10 s, two standard errors
    cover 77 %, against 92 % by default.

    References
    ----------
    .. [Morelli1997] Morelli, Klein, J. Guidance 20, 1997.
    .. [Newey1987] Newey, West, Econometrica 55, 1987.
    """
    window = (
        WINDOW * max((piece.stop - piece.start) * step for piece, step in zip(pieces, steps))
        if lag is None
        else lag
    )
    by_window, offset = _covariance(X, v, pieces, _windowed(X, v, pieces, steps, window))
    windowed = np.sqrt(np.diag(by_window))
    if lag is not None:
        return Coloured(by_window, offset, windowed)
    found = estimate_disturbances(X, v, pieces, steps)
    covariance, offset = _covariance(
        X, v, pieces, [colour.spread(X[piece]) for colour, piece in zip(found, pieces)]
    )
    hidden, edge = (
        max(getattr(colour.spectrum, name) for colour in found) for name in ("hidden", "edge")
    )
    return Coloured(covariance, offset, windowed, hidden, edge)


def _covariance(
    X, v, pieces, parts: Sequence[tuple[np.ndarray, float]]
) -> tuple[np.ndarray, float]:
    """Covariance and offset between pieces, from X'RX and the variance of the mean per piece."""
    means, sizes = (
        np.array([v[piece].mean() for piece in pieces]),
        np.array([piece.stop - piece.start for piece in pieces]),
    )
    offset2 = _between(means, np.array([mean for _, mean in parts]), sizes)
    sums = np.array([X[piece].sum(axis=0) for piece in pieces])
    inner = np.sum([product for product, _ in parts], axis=0) + offset2 * sums.T @ sums
    _, R = np.linalg.qr(X)
    half = np.linalg.solve(R, np.linalg.solve(R.T, inner))
    covariance = np.linalg.solve(R, np.linalg.solve(R.T, half.T))
    return 0.5 * (covariance + covariance.T), float(np.sqrt(offset2))


def _windowed(X, v, pieces, steps, lag: float) -> list[tuple[np.ndarray, float]]:
    """Per piece X'RX and the variance of the mean, by the tapered autocorrelation of its residual."""
    grow = len(X) / (len(X) - X.shape[1])
    windows = [
        int(np.clip(round(lag / step), 1, piece.stop - piece.start))
        for piece, step in zip(pieces, steps)
    ]
    return [
        _spread(X[piece], grow * _tapered(v[piece], window))
        for piece, window in zip(pieces, windows)
    ]


@dataclass(frozen=True)
class PieceDisturbance:
    """The disturbance of one piece: that of block means, and white noise within the blocks.

    Averaging takes out the part of the spectrum that a low-pass has emptied, and lets an
    autoregression reach far back.  Where motion is faster than the blocks, the noise at its
    frequency would not be known: they are halved until what forms the estimates, theta = A z, lies
    between them, and the residual below half their rate, so that none of it appears at a wrong
    frequency.

    Attributes
    ----------
    spectrum : ResidualSpectrum
        Of block means; common to all pieces of one clock.
    size : float
        Variance of this piece over that of the model.
    length : int
        Samples per block.
    white : float
        Variance within blocks.
    """

    spectrum: ResidualSpectrum
    size: float
    length: int
    white: float

    @property
    def model(self) -> Disturbance:
        """The disturbance of block means as an autoregression."""
        return self.spectrum.model

    def spread(self, X: np.ndarray) -> tuple[np.ndarray, float]:
        """Return X'RX and the variance of the mean of the disturbance."""
        starts, counts = _blocks(len(X), self.length)
        sums = np.add.reduceat(X, starts, axis=0)
        right = self.size * self.model.autocovariance(len(starts))
        product, mean = _spread(sums, np.concatenate([right[:0:-1], right]))
        inside = X - np.repeat(sums / counts[:, None], counts, axis=0)
        return product + self.white * inside.T @ inside, mean

    def sample(self, samples: int, rng: np.random.Generator) -> np.ndarray:
        """Return one stretch of the disturbance, (samples,)."""
        starts, counts = _blocks(samples, self.length)
        slow = np.sqrt(self.size) * self.model.sample(len(starts), rng)
        fast = np.sqrt(self.white) * rng.normal(size=samples)
        return np.repeat(slow - np.add.reduceat(fast, starts) / counts, counts) + fast


def estimate_disturbances(
    X: np.ndarray, v: np.ndarray, pieces: Sequence[slice], steps: Sequence[float]
) -> list[PieceDisturbance]:
    """Return the disturbance behind the residuals, piece by piece.

    Parameters
    ----------
    X, v, pieces, steps
        As in `coloured_covariance_of`.
    """
    lengths = _lengths(X, v, pieces, steps)
    clocks = [_clock(length * step) for length, step in zip(lengths, steps)]
    means, whites = [], []
    for piece, length in zip(pieces, lengths):
        starts, counts = _blocks(piece.stop - piece.start, length)
        mean = np.add.reduceat(np.column_stack([X[piece], v[piece]]), starts) / counts[:, None]
        rest = v[piece] - np.repeat(mean[:, -1], counts)
        means.append(mean)
        whites.append(float(rest @ rest) / max(1, len(rest) - len(starts)))
    found: dict[int, PieceDisturbance] = {}
    for clock in set(clocks):
        members = [k for k, own in enumerate(clocks) if own == clock]
        edges = np.cumsum([0, *(len(means[k]) for k in members)])
        together = np.concatenate([means[k] for k in members])
        places = [slice(int(a), int(b)) for a, b in pairwise(edges)]
        spectrum = residual_spectrum(together[:, :-1], together[:, -1], places)
        sizes = _sizes(spectrum.model, [means[k][:, -1] for k in members])
        for k, size in zip(members, sizes):
            found[k] = PieceDisturbance(spectrum, float(size), lengths[k], whites[k])
    return [found[k] for k in range(len(pieces))]


def _clock(block: float) -> float:
    """Blocks that are as long to a millisecond, shorter ones than 10 ms to two digits, have one
    clock. [s]
    """
    return round(block, max(3, 1 - math.floor(math.log10(block))))


def _lengths(
    X: np.ndarray, v: np.ndarray, pieces: Sequence[slice], steps: Sequence[float]
) -> list[int]:
    """Samples per block of each piece."""
    _, R = np.linalg.qr(X)
    A = np.linalg.solve(R, np.linalg.solve(R.T, X.T)).T
    lengths = [max(1, round(BLOCK / step)) for step in steps]
    if not _within(A, pieces, lengths):
        return lengths
    block = BLOCK
    while max(lengths) > 1 and (_within(A, pieces, lengths) or _above(v, pieces, lengths)):
        block *= 0.5
        lengths = [max(1, round(block / step)) for step in steps]
    return lengths


def _within(A: np.ndarray, pieces: Sequence[slice], lengths: Sequence[int]) -> bool:
    """Whether blocks average out what any estimate is formed from."""
    held = np.zeros(A.shape[1])
    for piece, length in zip(pieces, lengths):
        starts, counts = _blocks(piece.stop - piece.start, length)
        held += (np.add.reduceat(A[piece], starts, axis=0) ** 2 / counts[:, None]).sum(axis=0)
    return bool((held < (1.0 - UNRESOLVED) * (A**2).sum(axis=0)).any())


def _above(v: np.ndarray, pieces: Sequence[slice], lengths: Sequence[int]) -> bool:
    """Whether the residual has power above half the rate of the blocks."""
    over = 0.0
    for piece, length in zip(pieces, lengths):
        power = scipy.fft.dct(v[piece], norm="ortho") ** 2
        over += float(power[-(-len(power) // length) :].sum())
    return over > UNRESOLVED * float(v @ v)


def _blocks(samples: int, length: int) -> tuple[np.ndarray, np.ndarray]:
    """First sample and number of samples of every block; the last may be shorter."""
    starts = np.arange(0, samples, length)
    return starts, np.diff([*starts, samples])


def _spread(x: np.ndarray, kernel: np.ndarray) -> tuple[np.ndarray, float]:
    """x'Rx and the variance of a mean, for an autocovariance at lags -(n-1) ... n-1."""
    mean = float(scipy.signal.fftconvolve(np.ones(len(x)), kernel, mode="same").sum()) / len(x) ** 2
    return x.T @ scipy.signal.fftconvolve(x, kernel[:, None], mode="same", axes=0), mean


def _sizes(model: Disturbance, residuals: list[np.ndarray]) -> np.ndarray:
    """Variance of each piece over the common one; short pieces have the common one."""
    if len(residuals) == 1:
        return np.ones(1)
    own = len(residuals) >= OFFSETS  # constants, which are no part of the disturbance
    innovations = [model.innovations(v - v.mean() if own else v) for v in residuals]
    power = np.array([float(e @ e) for e in innovations])
    counts = np.array([len(e) for e in innovations])
    if power.sum() == 0.0:
        return np.ones(len(power))
    return np.where(
        counts >= _OWN, power / np.maximum(counts, 1) / (power.sum() / counts.sum()), 1.0
    )


def _tapered(r: np.ndarray, window: int) -> np.ndarray:
    """Biased autocorrelation with Bartlett's taper at lags -(window-1) ... window-1."""
    size = 1 << int(2 * len(r) - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(r, size)) ** 2
    right = np.fft.irfft(spectrum, size)[:window] / len(r) * (1.0 - np.arange(window) / window)
    return np.concatenate([right[:0:-1], right])


def _between(means: np.ndarray, expected: np.ndarray, sizes: np.ndarray) -> float:
    """Variance of a constant per piece, by the excess of the scatter of the means over what they
    should scatter.
    """
    if len(means) < OFFSETS:
        return 0.0
    excess = np.average(means**2, weights=sizes) * len(means) / (len(means) - 1) - np.average(
        expected, weights=sizes
    )
    return max(0.0, float(excess))
