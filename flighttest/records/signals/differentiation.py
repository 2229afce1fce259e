"""Smoothed time derivatives by local polynomials.

A polynomial is fitted to a moving window of samples and its slope is taken at the middle; at both
ends the fit is one sided.  The default, nine points and order four, has the noise of the classic
five-point quadratic and a tenth of its bias: the five-point formula loses 3.5 % at 2 Hz and 50
samples per second, which makes roll damping 2 to 3 % too small.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flightmech.errors import IdentificationError

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
    found = 0
    for window in range(shortest, shortest + 400, 2):
        if derivative_gain(frequencies, step, window, order).min() < gain:
            break
        found = window
    if not found:
        most = float(derivative_gain(frequency, step, shortest, order))
        raise IdentificationError(
            f"{frequency:g} Hz at {1.0 / step:g} samples per second: the shortest window of "
            f"order {order} has a gain of {most:.3f}, "
            f"wanted {gain:g}; record faster, raise the order or accept a smaller gain"
        )
    return found


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
    return savgol_coeffs(window, order, deriv=1, delta=step, use="dot"), step * np.arange(
        -half, half + 1
    )


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
    """Return a uniformly sampled channel without its white noise, its derivative, and the size of
    the noise.

    Parameters
    ----------
    x : array (time,)
        Signal with white noise, smooth at the rate it was sampled; for measured motions, not for
        surfaces moved in steps. [any]
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
    above = (
        np.convolve(power > 4.0 * floor, np.ones(_RUN), mode="valid") == _RUN
    )  # fewer in a row happen by chance
    return float(np.flatnonzero(above)[-1] + _RUN) if above.any() else 1.0
