"""Phases of a sum of cosines that keep its peak low for a given power.

The relative peak factor (max - min)/(2 sqrt(2) rms) is 1 for a single sine, and 1.04 to 1.2 for ten
or more lines with good phases. It is minimised through p-norms of the signal. Their slopes with
respect to all phases follow from one Fourier transform. The order p rises from 6 to 100, so that
the minimum of one norm is the start for the next, sharper norm.

References
----------
.. [Schroeder] Schroeder, Synthesis of low-peak-factor signals, IEEE Trans. Inf. Theory 16, 1970.
.. [Morelli2003] Morelli, Multiple input design for real-time parameter estimation in the frequency
   domain, IFAC 2003.
.. [Guillaume] Guillaume, Schoukens, Pintelon, Kollar, Crest-factor minimization using nonlinear
   Chebyshev approximation methods, IEEE Trans. Instrum. Meas. 40, 1991 (p-norms of rising order).
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq, minimize

# Orders of the norms, one after the other.
_NORMS = (6, 24, 100)
# Samples per cycle of the highest harmonic. The peak between samples is then at most 2 % higher
# for that line alone.
_SAMPLES_PER_CYCLE = 16
# Largest number of starts of the search.
_STARTS = 12
# Number of starts without a better peak after which the search ends.
_PATIENCE = 4
# Ratio of two peaks below which the second counts as better.
_BETTER = 0.995


def schroeder_phases(power) -> np.ndarray:
    """Return phases with a low peak in closed form [Schroeder].

    phi_n = -2 pi sum over m < n of (n - m) P_m.

    Parameters
    ----------
    power : array (line,)
        Power of each line, any scale.

    Returns
    -------
    array (line,)
        [rad]
    """
    power = np.asarray(power, float) / np.sum(power)
    n = np.arange(len(power))
    return np.array([-2.0 * np.pi * ((k - n[:k]) * power[:k]).sum() for k in n])


def relative_peak_factor(u) -> float:
    """Return (max - min)/(2 sqrt(2) rms) of a signal over whole periods: 1 for a sine. [1]

    Parameters
    ----------
    u : array (time,)
        Samples; the peak between them is not seen.
    """
    u = np.asarray(u, float)
    return float(np.ptp(u) / (2.0 * np.sqrt(2.0) * np.sqrt(np.mean(u**2))))


def synthesise_period(harmonics, power, phases, samples: int) -> np.ndarray:
    """Return one period of sum sqrt(2 P_k) cos(2 pi k t/T + phi_k).

    The mean square is the sum of the powers.

    Parameters
    ----------
    harmonics : array of int (line,)
        Cycles per period, below half of `samples`.
    power, phases : array (line,)
        [unit squared], [rad]
    samples : int
        Equally spaced over the period, the first at t = 0.

    Returns
    -------
    array (samples,)
    """
    # a cosine of amplitude A has the one-sided spectral value A/2 exp(i phi)
    spectrum = np.zeros(samples // 2 + 1, complex)
    amplitude = np.sqrt(2.0 * np.asarray(power, float))
    spectrum[np.asarray(harmonics)] = amplitude * np.exp(1j * np.asarray(phases, float)) / 2.0
    return np.fft.irfft(spectrum, samples) * samples


def fine_samples(harmonics) -> int:
    """Return the number of samples per period for the search of peaks, a power of two."""
    return 1 << int(np.ceil(np.log2(_SAMPLES_PER_CYCLE * max(harmonics))))


def optimise_phases(harmonics, power, seed: int = 0, target: float = 1.1) -> np.ndarray:
    """Return phases with a low relative peak factor, for a signal that starts and ends at zero.

    Parameters
    ----------
    harmonics : array of int (line,)
        Cycles per period.
    power : array (line,)
        Power of each line.
    seed : int
        Seed of the random starts that follow the start of [Schroeder].
    target : float
        Peak factor at which the search ends.  Otherwise it ends after 12 starts, or after four
        starts in a row without a better peak.

    Returns
    -------
    array (line,)
        [rad]
    """
    harmonics, power = np.asarray(harmonics, int), np.asarray(power, float) / np.sum(power)
    rng = np.random.default_rng(seed)
    starts = [schroeder_phases(power), *rng.uniform(-np.pi, np.pi, (_STARTS - 1, len(power)))]
    samples = fine_samples(harmonics)
    best, lowest, idle = starts[0], np.inf, 0
    for start in starts:
        phases = _minimise_peak(harmonics, power, start, samples=samples)
        peak = relative_peak_factor(synthesise_period(harmonics, power, phases, samples))
        idle += 1
        if peak < _BETTER * lowest:
            idle = 0
        if peak < lowest:
            best, lowest = phases, peak
        if lowest <= target or idle == _PATIENCE:
            break
    return _start_at_zero(harmonics, power, best, samples=samples)


def _minimise_peak(
    harmonics: np.ndarray, power: np.ndarray, phases: np.ndarray, *, samples: int
) -> np.ndarray:
    """Return the phases at a local minimum of the peak, by norms of rising order."""

    def norm(phi: np.ndarray, p: int) -> tuple[float, np.ndarray]:
        """Return the logarithm of the p-norm and its slope with the phases."""
        u = synthesise_period(harmonics, power, phi, samples)
        # division by the peak keeps v^100 within the range of the numbers
        top = np.abs(u).max()
        v = u / top
        total = np.mean(v**p)
        # d(mean v^p)/d(phi_k) = p mean(v^(p-1) dv/dphi_k), dv/dphi_k = -amplitude sin(...): the
        # imaginary part of a transform
        transform = np.fft.rfft(v ** (p - 1))[harmonics] / samples
        turned = transform.imag * np.cos(phi) - transform.real * np.sin(phi)
        slope = np.sqrt(2.0 * power) / top * turned
        return float(np.log(top) + np.log(total) / p), slope / total

    for p in _NORMS:
        result = minimize(
            norm, phases, args=(p,), jac=True, method="L-BFGS-B", options={"maxiter": 60}
        )
        phases = result.x
    return phases


def _start_at_zero(
    harmonics: np.ndarray, power: np.ndarray, phases: np.ndarray, *, samples: int
) -> np.ndarray:
    """Return the phases of the same signal, started at its flattest crossing of zero.

    The signal then leaves the trim gently and returns to it gently.
    """
    u = synthesise_period(harmonics, power, phases, samples)
    following = np.roll(u, -1)
    crossings = np.flatnonzero(np.signbit(u) != np.signbit(following))
    flattest = crossings[np.argmin(np.abs(following[crossings] - u[crossings]))]

    def evaluate(turn: float) -> float:
        """Return the signal at a part `turn` of the period."""
        return float(np.sqrt(power) @ np.cos(2.0 * np.pi * harmonics * turn + phases))

    turn = brentq(evaluate, flattest / samples, (flattest + 1) / samples, xtol=1e-15)
    # a shift of time turns the phase of harmonic k by k; the angle is brought to +-pi
    return np.angle(np.exp(1j * (phases + 2.0 * np.pi * harmonics * turn)))
