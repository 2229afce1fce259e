"""Smoothed time derivatives by local polynomials, and smoothing by sine series.

A polynomial is fitted to a moving window of samples, and its slope is evaluated at the middle.  At
both ends the fit is one sided.  The default, nine points and order four, has the noise of the
classic five-point quadratic and a tenth of its bias.  The five-point formula loses 3.5 % at 2 Hz
and 50 samples per second, which makes roll damping 2 to 3 % too small.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flightmech.errors import IdentificationError
from flightmech.short_text import ShortText

WINDOW = 9
ORDER = 4


def derivative(x, step: float, window: int = WINDOW, order: int = ORDER) -> np.ndarray:
    """Return the smoothed time derivative of a uniformly sampled signal.

    Parameters
    ----------
    x : array (time,)
        Signal. [any]
    step : float
        Sampling interval. [s]
    window : int
        Number of samples of the moving window, odd.
    order : int
        Order of the polynomial, smaller than `window`.

    Returns
    -------
    array (time,)
        Derivative. [unit of x per second]

    Raises
    ------
    IdentificationError
        Fewer samples than the window holds.

    References
    ----------
    .. [Savitzky1964] Savitzky, Golay, Anal. Chem. 36, 1964.
    """
    # SciPy takes half a second to import; reading a record does not differentiate
    from scipy.signal import savgol_filter

    x = np.asarray(x, float)
    if len(x) < window:
        raise IdentificationError(
            f"{len(x)} samples cannot be differentiated over a window of {window}; lengthen "
            f"the manoeuvre or give the derivative"
        )
    return savgol_filter(x, window, order, deriv=1, delta=step, mode="interp")


def derivative_gain(frequency, step: float, window: int = WINDOW, order: int = ORDER) -> np.ndarray:
    """Return the amplitude of `derivative` on a sine, divided by the true amplitude.

    Parameters
    ----------
    frequency : array
        Frequencies of the sine. [Hz]
    step : float
        Sampling interval. [s]
    window, order : int
        As in `derivative`.

    Returns
    -------
    array
        Gain, 1 when perfect; `derivative_window` chooses by it. [1]

    Examples
    --------
    >>> round(float(derivative_gain(2.0, 0.02)), 3)
    0.997
    """
    weights, shift = _weights(step, window, order)
    omega = 2.0 * np.pi * np.asarray(frequency, float)
    return (np.sin(omega[..., None] * shift) @ weights) / omega


def derivative_window(frequency: float, step: float, order: int = ORDER, gain: float = 0.99) -> int:
    """Return the longest window, so the least noise, that still follows `frequency`.

    Parameters
    ----------
    frequency : float
        Highest frequency that matters: of the excitation, of the fastest mode. [Hz]
    step : float
        Sampling interval. [s]
    order : int
        Order of the polynomial, even: an odd one adds nothing to the slope in the middle.
    gain : float
        Smallest gain of `derivative` up to that frequency. [1]

    Returns
    -------
    int
        Odd number of samples.

    Raises
    ------
    IdentificationError
        Even the shortest window, `order` + 1 samples, loses more.

    Examples
    --------
    >>> derivative_window(2.0, 0.02)
    11
    """
    frequencies = np.linspace(0.02, 1.0, 50) * frequency
    shortest = order + 1 + order % 2
    longest = 0
    for window in range(shortest, shortest + 400, 2):
        if derivative_gain(frequencies, step, window, order).min() < gain:
            break
        longest = window
    if not longest:
        most = float(derivative_gain(frequency, step, shortest, order))
        raise IdentificationError(
            f"{frequency:g} Hz at {1.0 / step:g} samples per second: the shortest window of "
            f"order {order} has a gain of {most:.3f}, "
            f"wanted {gain:g}; record faster, raise the order or accept a smaller gain"
        )
    return longest


def derivative_noise(step: float, window: int = WINDOW, order: int = ORDER) -> float:
    """Return the standard deviation of `derivative` for white noise of standard deviation one. [1
    s-1]

    Examples
    --------
    >>> round(derivative_noise(0.02), 1)
    16.9
    """
    return float(np.linalg.norm(_weights(step, window, order)[0]))


def _weights(step: float, window: int, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Weights of the samples for the slope at the middle, and their times from it."""
    # SciPy takes half a second to import; reading a record does not differentiate
    from scipy.signal import savgol_coeffs

    half = window // 2
    weights = savgol_coeffs(window, order, deriv=1, delta=step, use="dot")
    return weights, step * np.arange(-half, half + 1)


SHORTEST = 64
"""Fewest samples of `fourier_smooth`, which finds the noise in the upper two fifths."""
# Samples of the parabola that gives each end point.
_END = 9
# Running means in a row above the threshold that make a signal. Fewer occur by chance.
_RUN = 5
# Samples of a running mean of the squared coefficients.
_MEAN_WIDTH = 11
# Median of the square of a standard normal variable.
_MEDIAN_OF_SQUARE = 0.455
# Share of the coefficients below those that have only noise.
_NOISE_START = 0.6


@dataclass(frozen=True)
class Smoothed(ShortText):
    """A smoothed channel.

    Attributes
    ----------
    value : array (time,)
        The smooth signal. [unit of the channel]
    derivative : array (time,)
        Its time derivative, analytic. [unit per second]
    noise : float
        Standard deviation of the removed noise. [unit of the channel]
    cutoff : float
        Frequency at which signal and noise are equally strong. [Hz]
    """

    value: np.ndarray
    derivative: np.ndarray
    noise: float
    cutoff: float


def fourier_smooth(x, step: float) -> Smoothed:
    """Return a uniformly sampled channel without its white noise, and its derivative.

    Parameters
    ----------
    x : array (time,)
        Signal with white noise, smooth at its sampling rate: a measured motion, not a surface that
        moves in steps. [any]
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
    g = x minus the chord between its smoothed ends; b_k its sine coefficients at the frequency
    f_k = k/(2 (N - 1) step).  The noise floor is n^2 = median of b_k^2 over k > 0.6 N divided by
    0.455.  k_c is the last k that ends five values in a row above 4 n^2, of the running means of
    b^2 over k - 5 ... k + 5.  The Wiener weights are 1/(1 + (k/k_c)^6).  The variance of the
    residual times N/(N - k_c) is the variance of the noise.  One cut-off applies to the whole
    channel, so that short bursts in a long quiet record are smoothed too much.

    References
    ----------
    .. [Morelli1995] Morelli, Estimating noise characteristics from flight test data using optimal
       Fourier smoothing, J. Aircraft 32, 1995.
    """
    # SciPy takes half a second to import; reading a record does not differentiate
    from scipy.fft import dct, dst

    x = np.asarray(x, float)
    count = len(x)
    if count < SHORTEST or not np.isfinite(x).all():
        raise IdentificationError(
            f"{count} samples, {int((~np.isfinite(x)).sum())} of them NaN; Fourier smoothing "
            f"needs {SHORTEST} finite ones or more"
        )
    last, i = count - 1, np.arange(count)
    # The sine series of a signal that is zero at both ends converges fast.
    first, end = _end_points(x)
    chord = first + (end - first) * i / last
    b = dst((x - chord)[1:-1], type=1) / last
    k = np.arange(1, last)
    k_c = _cutoff(b, count)
    filtered = b / (1.0 + (k / k_c) ** 6)
    value = chord.copy()
    value[1:-1] += dst(filtered, type=1) / 2.0
    # The derivative of a sine series is a cosine series.
    cosines = np.concatenate([[0.0], filtered * np.pi * k / (last * step), [0.0]])
    derivative = (end - first) / (last * step) + dct(cosines, type=1) / 2.0
    noise = np.sqrt(np.mean((x - value) ** 2) * count / max(count - k_c, 1.0))
    return Smoothed(value, derivative, float(noise), cutoff=float(k_c / (2.0 * last * step)))


def _end_points(x: np.ndarray) -> tuple[float, float]:
    """Return both end points of a parabola through the samples next to them."""
    i = np.arange(_END)
    first = np.polyval(np.polyfit(i, x[:_END], 2), 0.0)
    end = np.polyval(np.polyfit(i, x[: -_END - 1 : -1], 2), 0.0)
    return float(first), float(end)


def _cutoff(b: np.ndarray, count: int) -> float:
    """Return the number of the coefficient where the signal is as strong as the noise."""
    floor = np.median(b[int(_NOISE_START * count) :] ** 2) / _MEDIAN_OF_SQUARE
    power = np.convolve(b**2, np.ones(_MEAN_WIDTH) / _MEAN_WIDTH, mode="same")
    is_signal = np.convolve(power > 4.0 * floor, np.ones(_RUN), mode="valid") == _RUN
    if not is_signal.any():
        return 1.0
    return float(np.flatnonzero(is_signal)[-1] + _RUN)
