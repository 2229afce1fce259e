"""Optimal Fourier smoothing: signal and noise separated by how their sine coefficients fall with frequency.

The coefficients of a smooth signal fall as the third power of frequency once the chord between its ends is removed; those of
white noise do not fall.  Where the two meet is the cut-off, found from the data and not chosen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flightmech.errors import IdentificationError

SHORTEST = 64  # samples; the floor is judged by the upper two fifths of the coefficients
_END = 9  # samples of the parabola that gives each end point
_RUN = 5  # running means in a row above the threshold that make a signal
_MEDIAN_OF_SQUARE = 0.455  # median of the square of a standard normal variable


@dataclass(frozen=True)
class Smoothed:
    """A smoothed channel.

    Attributes
    ----------
    value : array (time,)
        The smooth signal. [unit of the channel]
    derivative : array (time,)
        Its time derivative, analytic. [unit per second]
    noise : float
        Standard deviation of what was taken out. [unit of the channel]
    cutoff : float
        Frequency at which signal and noise are equally strong. [Hz]
    """

    value: np.ndarray
    derivative: np.ndarray
    noise: float
    cutoff: float


def fourier_smooth(x, step: float) -> Smoothed:
    """Return a uniformly sampled channel without its white noise, its derivative, and the size of the noise.

    Parameters
    ----------
    x : array (time,)
        Signal with white noise, smooth at the rate it was sampled; for measured motions, not for surfaces moved in steps. [any]
    step : float
        Sampling interval. [s]

    Returns
    -------
    Smoothed

    Raises
    ------
    IdentificationError
        Fewer than 64 samples, or NaN among them.

    Notes
    -----
    g = x minus the chord between its smoothed ends; b_k its sine coefficients at f_k = k/(2 (N - 1) step).  Floor n^2 = median of
    b_k^2 over k > 0.6 N divided by 0.455; k_c = the last k that ends five b^2, means over k - 5 ... k + 5, above 4 n^2; Wiener weights
    1/(1 + (k/k_c)^6).  The variance of the residual times N/(N - k_c) is that of the noise.  One cut-off for the whole
    channel: short bursts in a long quiet record are smoothed too much.

    References
    ----------
    .. [Morelli1995] Morelli, Estimating noise characteristics from flight test data using optimal Fourier smoothing, J. Aircraft 32, 1995.
    """
    from scipy.fft import dct, dst

    x = np.asarray(x, float)
    count = len(x)
    if count < SHORTEST or not np.isfinite(x).all():
        raise IdentificationError(
            f"{count} samples, {int((~np.isfinite(x)).sum())} of them NaN; Fourier smoothing needs {SHORTEST} finite ones or more"
        )
    last, i = count - 1, np.arange(count)
    first, end = _ends(x)
    chord = first + (end - first) * i / last
    b = dst((x - chord)[1:-1], type=1) / last
    k = np.arange(1, last)
    edge = _cutoff(b, count)
    kept = b / (1.0 + (k / edge) ** 6)
    value = chord.copy()
    value[1:-1] += dst(kept, type=1) / 2.0
    turn = np.concatenate([[0.0], kept * np.pi * k / (last * step), [0.0]])
    derivative = (end - first) / (last * step) + dct(turn, type=1) / 2.0
    noise = np.sqrt(np.mean((x - value) ** 2) * count / max(count - edge, 1.0))
    return Smoothed(value, derivative, float(noise), float(edge / (2.0 * last * step)))


def _ends(x: np.ndarray) -> tuple[float, float]:
    """Return both end points of a parabola through the samples next to them."""
    i = np.arange(_END)
    ends = [np.polyval(np.polyfit(i, part, 2), 0.0) for part in (x[:_END], x[: -_END - 1 : -1])]
    return float(ends[0]), float(ends[1])


def _cutoff(b: np.ndarray, count: int) -> float:
    """Return the number of the coefficient where the signal sinks into the floor."""
    floor = np.median(b[int(0.6 * count) :] ** 2) / _MEDIAN_OF_SQUARE
    power = np.convolve(b**2, np.ones(11) / 11.0, mode="same")
    above = np.convolve(power > 4.0 * floor, np.ones(_RUN), mode="valid") == _RUN  # fewer in a row happen by chance
    return float(np.flatnonzero(above)[-1] + _RUN) if above.any() else 1.0
