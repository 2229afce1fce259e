"""Covariance of a least-squares estimate whose residuals are correlated in time.

The textbook formula takes residuals for white and is two to five times too small on flight data.  Here the residual's
own autocorrelation is used, tapered and cut at a lag window; between manoeuvres nothing is correlated.  What differs
from manoeuvre to manoeuvre as a constant is longer than any lag window and comes as a variance of its own.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import fftconvolve

SHORTEST, LONGEST = 0.5, 5.0  # limits of the lag window [s]


def coloured(X: np.ndarray, v: np.ndarray, pieces: list[slice], steps: list[float], lag: float | None = None) -> tuple[np.ndarray, float]:
    """Return the covariance of a least-squares estimate, and the offset between manoeuvres that it holds.

    Parameters
    ----------
    X : array (samples, terms)
        Regressors.
    v : array (samples,)
        Residuals.
    pieces : list of slice
        Contiguous stretches of samples, in order.
    steps : list of float
        Sampling interval of each piece. [s]
    lag : float, optional
        Length of the lag window; default a tenth of each piece, between 0.5 and 5 s. [s]

    Returns
    -------
    covariance : array (terms, terms)
        D [sum over pieces, i, j of x_i R(i - j) x_j'] D N/(N - n) with D = (X'X)^-1, R(k) = w_k (1/N) sum v_i v_(i+k) of
        the piece and Bartlett's taper w_k = max(0, 1 - |k|/L).
    offset : float
        Standard deviation of a constant that differs from piece to piece, beyond what R explains; in the covariance.

    References
    ----------
    .. [Morelli1997] Morelli, Klein, J. Guidance 20, 1997.
    .. [Newey1987] Newey, West, Econometrica 55, 1987.
    """
    count, terms = X.shape
    inner = np.zeros((terms, terms))
    sums, means, expected, sizes = [], [], [], []
    for piece, step in zip(pieces, steps):
        x, r = X[piece], v[piece]
        kernel = _kernel(r, _window(len(r), step, lag))
        inner += x.T @ fftconvolve(x, kernel[:, None], mode="same", axes=0)
        sums.append(x.sum(axis=0))
        means.append(r.mean())
        expected.append(fftconvolve(np.ones(len(r)), kernel, mode="same").sum() / len(r) ** 2)
        sizes.append(len(r))
    offset2 = _between(np.array(means), np.array(expected), np.array(sizes))
    inner += offset2 * np.einsum("mi,mj->ij", np.array(sums), np.array(sums))
    _, R = np.linalg.qr(X)
    half = np.linalg.solve(R, np.linalg.solve(R.T, inner))
    covariance = np.linalg.solve(R, np.linalg.solve(R.T, half.T))
    return 0.5 * (covariance + covariance.T) * count / (count - terms), float(np.sqrt(offset2))


def _window(samples: int, step: float, lag: float | None) -> int:
    """Samples of the lag window, at least one, at most the piece."""
    seconds = float(np.clip(0.1 * samples * step, SHORTEST, LONGEST)) if lag is None else lag
    return int(np.clip(round(seconds / step), 1, samples))


def _kernel(r: np.ndarray, window: int) -> np.ndarray:
    """Biased autocorrelation with Bartlett's taper at lags -(window-1) ... window-1."""
    size = 1 << int(2 * len(r) - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(r, size)) ** 2
    right = np.fft.irfft(spectrum, size)[:window] / len(r) * (1.0 - np.arange(window) / window)
    return np.concatenate([right[:0:-1], right])


def _between(means: np.ndarray, expected: np.ndarray, sizes: np.ndarray) -> float:
    """Variance of a constant per piece, by the excess of the scatter of the means over what they should scatter."""
    if len(means) < 3:
        return 0.0
    excess = np.average(means**2, weights=sizes) * len(means) / (len(means) - 1) - np.average(expected, weights=sizes)
    return max(0.0, float(excess))
