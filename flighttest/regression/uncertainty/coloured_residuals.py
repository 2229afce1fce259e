"""Covariance of a least-squares estimate whose residuals are correlated in time.

The usual formula assumes white residuals and is two to five times too small on flight data. This
module estimates the spectrum of the disturbance behind the residuals, including the part that the
fit has absorbed (`residual_spectrum`). If a lag window is given, it uses the tapered
autocorrelation of the residual instead. Manoeuvres are independent of each other. A constant that
differs between manoeuvres has a variance of its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy

from flighttest.regression.uncertainty.disturbance import Disturbance
from flighttest.regression.uncertainty.residual_spectrum import (
    OFFSETS,
    ResidualSpectrum,
    residual_spectrum,
)

BLOCK = 0.08  # longest block over which residuals are averaged before their spectrum is fitted [s]
# largest share inside the blocks of the weights that form an estimate, and largest share of the
# residual's power above half the block rate
UNRESOLVED = 0.1
WINDOW = 0.1  # lag window for the standard errors of comparison, of the longest piece
_OWN_SIZE = 25  # blocks from which on a manoeuvre has a disturbance of its own size


class Coloured(NamedTuple):
    """Covariance of a least-squares estimate, with figures of its disturbance.

    Attributes
    ----------
    covariance : array (terms, terms)
    offset : float
        Standard deviation of a constant that differs from piece to piece, beyond the scatter that
        the disturbance explains. It is part of the covariance.
    windowed : array (terms,)
        Standard errors by a lag window, for comparison: the given window, or a tenth of the longest
        piece.
    hidden, edge : float
        Largest values of the attributes of `ResidualSpectrum` over the clocks; 1 and 0 with a lag
        window.
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
    envelope: np.ndarray | None = None,
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
        Length of a lag window. The covariance then uses the residual's biased autocorrelation with
        Bartlett's taper. [s]
    envelope : array (samples,), optional
        Factor on a stationary disturbance, sample by sample, as of `growth_envelope`; not for a lag
        window.

    Returns
    -------
    Coloured

    Notes
    -----
    cov = D [sum over pieces, i, j of x_i R(i - j) x_j'] D with D = (X'X)^-1 and R the
    autocovariance of the disturbance. With a lag window R(k) = w_k (1/N) sum v_i v_(i+k) of the
    piece, w_k = max(0, 1 - |k|/L), and the sum is multiplied by N/(N - n).

    The window follows [Morelli1997]_ and [Newey1987]_. It uses only the part of the disturbance
    that the fit has not absorbed, and is too small for slow terms. For intercepts fitted to 10 s,
    two standard errors cover 77 %, against 92 % by default.

    References
    ----------
    .. [Morelli1997] Morelli, Klein, J. Guidance 20, 1997.
    .. [Newey1987] Newey, West, Econometrica 55, 1987.
    """
    window = lag
    if window is None:
        durations = [(piece.stop - piece.start) * step for piece, step in zip(pieces, steps)]
        window = WINDOW * max(durations)
    parts = _windowed_products(X, v, pieces=pieces, steps=steps, lag=window)
    by_window, offset = _combine_pieces(X, v, pieces=pieces, parts=parts)
    windowed = np.sqrt(np.diag(by_window))
    if lag is not None:
        return Coloured(by_window, offset, windowed)
    scale = np.ones((len(v), 1)) if envelope is None else envelope[:, None]
    # A disturbance s u acts on X as the stationary u = v/s acts on s X.
    disturbances = estimate_disturbances(X / scale, v / scale[:, 0], pieces=pieces, steps=steps)
    parts = []
    for disturbance, piece in zip(disturbances, pieces):
        parts.append(disturbance.spread(X[piece] * scale[piece]))
    covariance, offset = _combine_pieces(X, v, pieces=pieces, parts=parts)
    hidden = max(disturbance.spectrum.hidden for disturbance in disturbances)
    edge = max(disturbance.spectrum.edge for disturbance in disturbances)
    return Coloured(covariance, offset, windowed, hidden=hidden, edge=edge)


def _combine_pieces(
    X: np.ndarray,
    v: np.ndarray,
    pieces: Sequence[slice],
    parts: Sequence[tuple[np.ndarray, float]],
) -> tuple[np.ndarray, float]:
    """Return covariance and offset, from X'RX and the variance of the mean of each piece."""
    residual_means = np.array([v[piece].mean() for piece in pieces])
    sizes = np.array([piece.stop - piece.start for piece in pieces])
    expected = np.array([mean_variance for _, mean_variance in parts])
    offset2 = _offset_variance(residual_means, expected, sizes)
    # A constant of a piece adds offset^2 times the outer product of the regressor sums.
    sums = np.array([X[piece].sum(axis=0) for piece in pieces])
    inner = np.sum([product for product, _ in parts], axis=0) + offset2 * sums.T @ sums
    # (X'X)^-1 inner (X'X)^-1 with X = QR: two solves from each side, no squared condition
    _, R = np.linalg.qr(X)
    half = np.linalg.solve(R, np.linalg.solve(R.T, inner))
    covariance = np.linalg.solve(R, np.linalg.solve(R.T, half.T))
    return 0.5 * (covariance + covariance.T), float(np.sqrt(offset2))


def _windowed_products(
    X: np.ndarray, v: np.ndarray, pieces: Sequence[slice], steps: Sequence[float], lag: float
) -> list[tuple[np.ndarray, float]]:
    """Return X'RX and the variance of the mean of each piece, by the tapered autocorrelation."""
    freedom_factor = len(X) / (len(X) - X.shape[1])
    parts = []
    for piece, step in zip(pieces, steps):
        window = int(np.clip(round(lag / step), 1, piece.stop - piece.start))
        autocovariance = freedom_factor * _tapered_autocorrelation(v[piece], window)
        parts.append(_convolved_products(X[piece], autocovariance))
    return parts


@dataclass(frozen=True)
class PieceDisturbance:
    """Disturbance of one piece: slow noise of block means, and white noise inside the blocks.

    Averaging removes the part of the spectrum that a low-pass has emptied. An autoregression of the
    block means reaches far into the past. If motion is faster than the blocks, they do not resolve
    the noise at its frequency. The blocks are halved until they resolve the estimates theta = A z.
    They are also halved until the residual is below half their rate, so that no part of it is
    aliased.

    Attributes
    ----------
    spectrum : ResidualSpectrum
        Spectrum of the block means; common to all pieces of one clock.
    size : float
        Variance of this piece over that of the model.
    length : int
        Samples per block.
    white : float
        Variance inside the blocks.
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
        """Return X'RX and the variance of the mean of the disturbance.

        Parameters
        ----------
        X : array (samples, terms)
        """
        starts, counts = _divide_into_blocks(len(X), self.length)
        sums = np.add.reduceat(X, starts, axis=0)
        one_sided = self.size * self.model.autocovariance(len(starts))
        product, mean_variance = _convolved_products(sums, _mirror(one_sided))
        # The white part acts on the regressors less their block means.
        inside = X - np.repeat(sums / counts[:, None], counts, axis=0)
        return product + self.white * inside.T @ inside, mean_variance

    def sample(self, samples: int, rng: np.random.Generator) -> np.ndarray:
        """Return one stretch of the disturbance, (samples,)."""
        starts, counts = _divide_into_blocks(samples, self.length)
        slow = np.sqrt(self.size) * self.model.sample(len(starts), rng)
        fast = np.sqrt(self.white) * rng.normal(size=samples)
        # The fast part has a block mean of zero, so that `slow` is the block mean.
        return np.repeat(slow - np.add.reduceat(fast, starts) / counts, counts) + fast


class _BlockMeans(NamedTuple):
    """Block means of regressors and residual of one piece, and the variance inside the blocks."""

    X: np.ndarray
    v: np.ndarray
    white: float


def estimate_disturbances(
    X: np.ndarray, v: np.ndarray, pieces: Sequence[slice], steps: Sequence[float]
) -> list[PieceDisturbance]:
    """Return the disturbance behind the residuals, piece by piece.

    Parameters
    ----------
    X, v, pieces, steps
        As in `coloured_covariance_of`.
    """
    lengths = _choose_block_lengths(X, v, pieces=pieces, steps=steps)
    clocks = [_block_clock(length * step) for length, step in zip(lengths, steps)]
    means = []
    for piece, length in zip(pieces, lengths):
        means.append(_average_blocks(X[piece], v[piece], length))
    # Pieces of one clock have one spectrum, and sizes of their own.
    disturbances: dict[int, PieceDisturbance] = {}
    for clock in set(clocks):
        members = [k for k, piece_clock in enumerate(clocks) if piece_clock == clock]
        edges = np.cumsum([0, *(len(means[k].v) for k in members)])
        spectrum = residual_spectrum(
            np.concatenate([means[k].X for k in members]),
            np.concatenate([means[k].v for k in members]),
            [slice(int(start), int(stop)) for start, stop in pairwise(edges)],
        )
        sizes = _relative_sizes(spectrum.model, [means[k].v for k in members])
        for k, size in zip(members, sizes):
            disturbances[k] = PieceDisturbance(
                spectrum, size=float(size), length=lengths[k], white=means[k].white
            )
    return [disturbances[k] for k in range(len(pieces))]


def whiten_pieces(
    X: np.ndarray,
    v: np.ndarray,
    columns: np.ndarray,
    pieces: Sequence[slice],
    steps: Sequence[float],
    least: float = 0.0,
) -> list[np.ndarray]:
    """Return columns without the colour of the disturbance, (blocks, columns) of each piece.

    The disturbance of every row has unit variance.

    Parameters
    ----------
    X, v, pieces, steps
        As in `coloured_covariance_of`; they determine the disturbance.
    columns : array (samples, columns)
        Signals that are averaged over blocks and whitened.
    least : float
        Least standard deviation of an innovation.

    Notes
    -----
    The variance inside the blocks is not used: the blocks resolve the estimates.
    """
    white = []
    for disturbance, piece in zip(estimate_disturbances(X, v, pieces=pieces, steps=steps), pieces):
        starts, counts = _divide_into_blocks(piece.stop - piece.start, disturbance.length)
        means = np.add.reduceat(columns[piece], starts) / counts[:, None]
        innovations = np.array([disturbance.model.innovations(column) for column in means.T])
        level = np.sqrt(disturbance.size * disturbance.model.variance)
        white.append(innovations.T / max(least, level))
    return white


def _average_blocks(X: np.ndarray, v: np.ndarray, length: int) -> _BlockMeans:
    """Return the block means of one piece."""
    starts, counts = _divide_into_blocks(len(v), length)
    means = np.add.reduceat(np.column_stack([X, v]), starts) / counts[:, None]
    inside = v - np.repeat(means[:, -1], counts)
    white = float(inside @ inside) / max(1, len(inside) - len(starts))
    return _BlockMeans(means[:, :-1], means[:, -1], white)


def _block_clock(block: float) -> float:
    """Return the block length that defines a clock, rounded to 1 ms, or to two digits. [s]"""
    return round(block, max(3, 1 - math.floor(math.log10(block))))


def _choose_block_lengths(
    X: np.ndarray, v: np.ndarray, pieces: Sequence[slice], steps: Sequence[float]
) -> list[int]:
    """Return the samples per block of each piece."""
    # A' of the estimates theta = A z, (samples, terms)
    _, R = np.linalg.qr(X)
    A = np.linalg.solve(R, np.linalg.solve(R.T, X.T)).T
    lengths = [max(1, round(BLOCK / step)) for step in steps]
    if not _blocks_hide_estimates(A, pieces, lengths):
        return lengths
    block = BLOCK
    while max(lengths) > 1 and (
        _blocks_hide_estimates(A, pieces, lengths) or _blocks_hide_residual(v, pieces, lengths)
    ):
        block *= 0.5
        lengths = [max(1, round(block / step)) for step in steps]
    return lengths


def _blocks_hide_estimates(A: np.ndarray, pieces: Sequence[slice], lengths: Sequence[int]) -> bool:
    """Return whether the blocks average out the weights that form any estimate."""
    resolved = np.zeros(A.shape[1])
    for piece, length in zip(pieces, lengths):
        starts, counts = _divide_into_blocks(piece.stop - piece.start, length)
        sums = np.add.reduceat(A[piece], starts, axis=0)
        resolved += (sums**2 / counts[:, None]).sum(axis=0)
    return bool((resolved < (1.0 - UNRESOLVED) * (A**2).sum(axis=0)).any())


def _blocks_hide_residual(v: np.ndarray, pieces: Sequence[slice], lengths: Sequence[int]) -> bool:
    """Return whether the residual has power above half the rate of the blocks."""
    fast_power = 0.0
    for piece, length in zip(pieces, lengths):
        power = scipy.fft.dct(v[piece], norm="ortho") ** 2
        fast_power += float(power[-(-len(power) // length) :].sum())
    return fast_power > UNRESOLVED * float(v @ v)


def _divide_into_blocks(samples: int, length: int) -> tuple[np.ndarray, np.ndarray]:
    """Return first sample and number of samples of every block; the last may be shorter."""
    starts = np.arange(0, samples, length)
    return starts, np.diff([*starts, samples])


def _mirror(one_sided: np.ndarray) -> np.ndarray:
    """Return an autocovariance at lags -(n-1) ... n-1 from that at lags 0 ... n-1."""
    return np.concatenate([one_sided[:0:-1], one_sided])


def _convolved_products(x: np.ndarray, autocovariance: np.ndarray) -> tuple[np.ndarray, float]:
    """Return x'Rx and the variance of a mean, for an autocovariance at lags -(n-1) ... n-1."""
    # R is a Toeplitz matrix: its product with x is a convolution.
    total = scipy.signal.fftconvolve(np.ones(len(x)), autocovariance, mode="same").sum()
    Rx = scipy.signal.fftconvolve(x, autocovariance[:, None], mode="same", axes=0)
    return x.T @ Rx, float(total) / len(x) ** 2


def _relative_sizes(model: Disturbance, residuals: list[np.ndarray]) -> np.ndarray:
    """Return the variance of each piece over the common one; 1 for short pieces."""
    if len(residuals) == 1:
        return np.ones(1)
    if len(residuals) >= OFFSETS:  # each piece has a constant, which is not part of the disturbance
        residuals = [v - v.mean() for v in residuals]
    innovations = [model.innovations(v) for v in residuals]
    power = np.array([float(e @ e) for e in innovations])
    counts = np.array([len(e) for e in innovations])
    if power.sum() == 0.0:
        return np.ones(len(power))
    common = power.sum() / counts.sum()
    return np.where(counts >= _OWN_SIZE, power / np.maximum(counts, 1) / common, 1.0)


def _tapered_autocorrelation(r: np.ndarray, window: int) -> np.ndarray:
    """Return the biased autocorrelation with Bartlett's taper, at lags -(window-1) ... window-1."""
    # The transform is padded to twice the length, so that its products do not wrap around.
    size = 1 << int(2 * len(r) - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(r, size)) ** 2
    taper = 1.0 - np.arange(window) / window
    return _mirror(np.fft.irfft(spectrum, size)[:window] / len(r) * taper)


def _offset_variance(means: np.ndarray, expected: np.ndarray, sizes: np.ndarray) -> float:
    """Return the variance of a constant per piece: scatter of the means beyond the expected one.

    `means`, their `expected` variances and `sizes` are arrays (pieces,).
    """
    if len(means) < OFFSETS:
        return 0.0
    observed = np.average(means**2, weights=sizes) * len(means) / (len(means) - 1)
    return max(0.0, float(observed - np.average(expected, weights=sizes)))
