"""Smoothed time derivatives by local polynomials.

A polynomial is fitted to a moving window of samples and its slope is taken at the middle; at both ends the fit is one
sided.  The default, nine points and order four, has the noise of the classic five-point quadratic and a tenth of its
bias: the five-point formula loses 3.5 % at 2 Hz and 50 samples per second, which makes roll damping 2 to 3 % too small.
"""

from __future__ import annotations

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
    from scipy.signal import savgol_filter

    x = np.asarray(x, float)
    if len(x) < window:
        raise IdentificationError(
            f"{len(x)} samples cannot be differentiated over a window of {window}; lengthen the manoeuvre or give the derivative"
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
            f"{frequency:g} Hz at {1.0 / step:g} samples per second: the shortest window of order {order} has a gain of {most:.3f}, "
            f"wanted {gain:g}; record faster, raise the order or accept a smaller gain"
        )
    return found


def derivative_noise(step: float, window: int = WINDOW, order: int = ORDER) -> float:
    """Return the standard deviation of `derivative` for white noise of standard deviation one. [1 s-1]

    Examples
    --------
    >>> round(derivative_noise(0.02), 1)
    16.9
    """
    return float(np.linalg.norm(_weights(step, window, order)[0]))


def _weights(step: float, window: int, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Weights of the samples for the slope at the middle, and their times from it."""
    from scipy.signal import savgol_coeffs

    half = window // 2
    return savgol_coeffs(window, order, deriv=1, delta=step, use="dot"), step * np.arange(-half, half + 1)
