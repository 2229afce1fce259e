"""Finite Fourier transform of sampled signals at any frequencies.

    x~(f) = integral from 0 to T of x(t) exp(-2 pi j f t) dt

The transform is exact for the cubic that interpolates the samples [Press2007]_: a chirp-z transform
[Rabiner1969]_ over the samples, and corrections at both ends [Morelli1997a]_.  A plain sum of the
samples has an error of 0.2 % at 0.02 Hz and 37 % at 3 Hz for a signal whose ends differ.

References
----------
.. [Morelli1997a] Morelli, High accuracy evaluation of the finite Fourier transform using sampled
   data, NASA TM 110340, 1997.
.. [Rabiner1969] Rabiner, Schafer, Rader, The chirp z-transform algorithm, IEEE Trans. Audio
   Electroacoustics 17, 1969.
.. [Press2007] Press, Teukolsky, Vetterling, Flannery, Numerical Recipes, 3rd edition 2007, 13.9
   (end corrections).
"""

from __future__ import annotations

import numpy as np
from scipy.signal import czt

from flightmech.errors import IdentificationError

# Angle 2 pi f step below which the corrections are evaluated by their series. [rad]
_SMALL = 0.1
# Samples at each end that are corrected.
ENDS = 4
# Frequencies of the adjoint in one block, so that its matrix stays small.
_CHUNK = 64


def harmonics(duration: float, low: float, high: float) -> np.ndarray:
    """Return the multiples of 1/duration from `low` to `high`.

    The spectrum at each of them is an independent value.

    Parameters
    ----------
    duration : float
        Duration of the record. [s]
    low, high : float
        Edges of the band, which are part of the band. [Hz]

    Returns
    -------
    array (frequency,)
        [Hz]

    Raises
    ------
    IdentificationError
        The edges are not a band, or the band has no multiple of 1/duration.

    Examples
    --------
    >>> harmonics(20.0, 0.1, 0.3)
    array([0.1 , 0.15, 0.2 , 0.25, 0.3 ])
    """
    if not 0.0 < low < high:
        raise IdentificationError(
            f"band {low:g} ... {high:g} Hz; expected 0 < low < high, as 0.1 ... 2 for a "
            f"small aeroplane"
        )
    # An edge that is a multiple, but for rounding, is part of the band.
    first, last = int(np.ceil(low * duration - 1e-6)), int(np.floor(high * duration + 1e-6))
    if last < first:
        raise IdentificationError(
            f"no multiple of 1/{duration:g} s in {low:g} ... {high:g} Hz; widen the band or "
            f"take a longer record"
        )
    return np.arange(first, last + 1) / duration


def remove_straight_line(x: np.ndarray) -> np.ndarray:
    """Return signals (time, ...) without their straight line by least squares."""
    t = np.linspace(-1.0, 1.0, len(x))
    basis = np.linalg.qr(np.column_stack([np.ones_like(t), t]))[0]
    return x - np.tensordot(basis, np.tensordot(basis, x, axes=(0, 0)), axes=(1, 0))


def finite_fourier(x: np.ndarray, step: float, frequencies: np.ndarray) -> np.ndarray:
    """Return the finite Fourier transform of sampled signals.

    Parameters
    ----------
    x : array (time, ...)
        At least eight uniform samples, the first at time zero. [any]
    step : float
        Sampling interval. [s]
    frequencies : array (frequency,)
        A uniform grid uses a chirp-z transform, any other grid plain sums. [Hz]

    Returns
    -------
    complex array (frequency, ...)
        [unit of x times second]

    Raises
    ------
    IdentificationError
        Fewer than eight samples, or a frequency beyond half the sampling rate.

    Notes
    -----
    The derivative of a signal on the record has the transform
    2 pi j f x~ + x(T) exp(-2 pi j f T) - x(0).
    """
    x, frequencies = np.asarray(x, float), np.atleast_1d(np.asarray(frequencies, float))
    _check_band(len(x), step, frequencies)
    angle = 2.0 * np.pi * frequencies * step
    weight, ends = end_corrections(angle)
    flat = x.reshape(len(x), -1)
    total = weight[:, None] * _sum_samples(flat, angle)
    # The correction at the end is the conjugate of the one at the start, turned by its phase.
    end_phase = np.exp(-1j * angle * (len(x) - 1))
    total += ends @ flat[:ENDS] + end_phase[:, None] * (ends.conj() @ flat[: -ENDS - 1 : -1])
    return (step * total).reshape(len(frequencies), *x.shape[1:])


def adjoint_fourier(
    values: np.ndarray, step: float, frequencies: np.ndarray, samples: int
) -> np.ndarray:
    """Return the real part of the adjoint of `finite_fourier`.

    It is Re(F* values), with the matrix F (frequency, samples) of the transform.

    Parameters
    ----------
    values : complex array (frequency, ...)
    step, frequencies
        As in `finite_fourier`.
    samples : int
        Length of the signal.

    Returns
    -------
    array (samples, ...)
    """
    angle = 2.0 * np.pi * np.asarray(frequencies, float) * step
    weight, ends = end_corrections(angle)
    flat = np.asarray(values).reshape(len(angle), -1)
    end_phase = np.exp(-1j * angle * (samples - 1))
    adjoint = np.zeros((samples, flat.shape[1]))
    i = np.arange(samples)
    # In chunks of frequencies, which limits the memory of the matrix of phases.
    for first in range(0, len(angle), _CHUNK):
        part = slice(first, first + _CHUNK)
        weighted = weight[part, None] * flat[part]
        adjoint += (np.exp(1j * np.outer(i, angle[part])) @ weighted).real
    # Corrections of the first and of the last samples.
    adjoint[:ENDS] += (ends.conj().T @ flat).real
    adjoint[: -ENDS - 1 : -1] += (ends.T @ (end_phase.conj()[:, None] * flat)).real
    return (step * adjoint).reshape(samples, *np.shape(values)[1:])


def _check_band(samples: int, step: float, frequencies: np.ndarray) -> None:
    if samples < 2 * ENDS:
        raise IdentificationError(
            f"{samples} samples for a Fourier transform; {2 * ENDS} are needed"
        )
    if frequencies.max() > 0.5 / step * (1 + 1e-9):
        raise IdentificationError(
            f"{frequencies.max():g} Hz is beyond half the sampling rate, {0.5 / step:g} Hz; "
            f"lower the band"
        )


def _sum_samples(x: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Return the sums of x_i exp(-j angle i) (frequency, ...)."""
    steps = np.diff(angle)
    if len(angle) > 1 and np.ptp(steps) <= 1e-9 * abs(steps[0]):
        return czt(x, len(angle), w=np.exp(-1j * steps.mean()), a=np.exp(1j * angle[0]), axis=0)
    return np.exp(-1j * np.outer(angle, np.arange(len(x)))) @ x


def end_corrections(angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return weight of the sum (frequency,) and corrections of the first samples (frequency, 4).

    The formulas are in [Press2007]_, section 13.9, for cubic interpolation; t = 2 pi f step.
    """
    # The closed form cancels for small angles, for which any other value serves.
    is_small = angle < _SMALL
    t = np.where(is_small, 1.0, angle)
    c, s, c2, s2, t2 = np.cos(t), np.sin(t), np.cos(2 * t), np.sin(2 * t), t * t
    plus, minus, d = 6 + t2, 3 - t2, 6 * t2 * t2
    weight = plus * (3 - 4 * c + c2) / (0.5 * d)
    closed = [
        ((-42 + 5 * t2 + plus * (8 * c - c2)) - 1j * (-12 * t + 6 * t2 * t + plus * s2)) / d,
        (14 * minus - 7 * plus * c - 1j * (30 * t - 5 * plus * s)) / d,
        (-4 * minus + 2 * plus * c - 1j * (-12 * t + 2 * plus * s)) / (0.5 * d),
        (2 * minus - plus * c - 1j * (6 * t - plus * s)) / d,
    ]
    # Series of the same functions for small angles.
    t = angle
    t2 = t * t
    t4 = t2 * t2
    series = [
        -2 / 3
        + t2 / 45
        + 103 / 15120 * t4
        - 169 / 226800 * t2 * t4
        - 1j * t * (2 / 45 + 2 / 105 * t2 - 8 / 2835 * t4),
        7 / 24
        - 7 / 180 * t2
        + 5 / 3456 * t4
        - 7 / 259200 * t2 * t4
        - 1j * t * (7 / 72 - t2 / 168 + 11 / 72576 * t4),
        -1 / 6
        + t2 / 45
        - 5 / 6048 * t4
        + t2 * t4 / 64800
        + 1j * t * (7 / 90 - t2 / 210 + 11 / 90720 * t4),
        1 / 24
        - t2 / 180
        + 5 / 24192 * t4
        - t2 * t4 / 259200
        - 1j * t * (7 / 360 - t2 / 840 + 11 / 362880 * t4),
    ]
    weight = np.where(is_small, 1 - 11 / 720 * t4 + 23 / 15120 * t2 * t4, weight)
    corrections = np.where(is_small[:, None], np.stack(series, axis=1), np.stack(closed, axis=1))
    return weight, corrections
