"""Phases of a sum of cosines that keep it low: as much power as possible between given deflections.

The relative peak factor (max - min)/(2 sqrt(2) rms) is 1 for a single sine, and 1.04 to 1.2 for ten
or more lines with good phases. It is minimised through p-norms of the signal, whose slopes with
respect to all phases come from one Fourier transform; p rises from 6 to 100, so that the minimum of
one norm is the start for the next, sharper one.

References
----------
.. [Schroeder] Schroeder, Synthesis of low-peak-factor signals, IEEE Trans. Inf. Theory 16, 1970.
.. [Morelli2003] Morelli, Multiple input design for real-time parameter estimation in the frequency domain, IFAC 2003.
.. [Guillaume] Guillaume, Schoukens, Pintelon, Kollar, Crest-factor minimization using nonlinear Chebyshev approximation methods,
   IEEE Trans. Instrum. Meas. 40, 1991 (p-norms of rising order).
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np
import pandas as pd
import xarray as xr
from scipy.optimize import brentq, minimize

from flightmech.errors import SchemaError
from flightmech.names import quantity_attributes

_NORMS = (6, 24, 100)
# of the highest harmonic: between samples the peak is then at most 2 % higher for that line alone
_SAMPLES_PER_CYCLE = 16
_STARTS = 12
_PATIENCE = 4  # starts without a better peak after which the search ends
_BETTER = 0.995


def schroeder_phases(power) -> np.ndarray:
    """Return phi_n = -2 pi sum over m < n of (n - m) P_m, which gives a low peak in closed form
    [Schroeder].

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
    """Return one period of sum sqrt(2 P_k) cos(2 pi k t/T + phi_k), so that the mean square is the
    sum of the powers.

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
    spectrum = np.zeros(samples // 2 + 1, complex)
    spectrum[np.asarray(harmonics)] = (
        np.sqrt(2.0 * np.asarray(power, float)) * np.exp(1j * np.asarray(phases, float)) / 2.0
    )
    return np.fft.irfft(spectrum, samples) * samples


def fine_samples(harmonics) -> int:
    """Return the number of samples of a period on which peaks are looked for: a power of two."""
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
        Of the random starts that follow Schroeder's; the same seed gives the same phases.
    target : float
        Peak factor that is good enough; without it up to 12 starts are tried, until four in a row
        bring nothing.

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
        phases = _lowered(harmonics, power, start, samples)
        peak = relative_peak_factor(synthesise_period(harmonics, power, phases, samples))
        idle = 0 if peak < _BETTER * lowest else idle + 1
        if peak < lowest:
            best, lowest = phases, peak
        if lowest <= target or idle == _PATIENCE:
            break
    return _from_zero(harmonics, power, best, samples)


def _lowered(
    harmonics: np.ndarray, power: np.ndarray, phases: np.ndarray, samples: int
) -> np.ndarray:
    """The phases at a local minimum of the peak, by norms of rising order."""

    def norm(phi: np.ndarray, p: int) -> tuple[float, np.ndarray]:
        u = synthesise_period(harmonics, power, phi, samples)
        top = np.abs(u).max()
        v = u / top
        total = np.mean(v**p)
        # d(mean v^p)/d(phi_k) = p mean(v^(p-1) dv/dphi_k), dv/dphi_k = -amplitude sin(...): the
        # imaginary part of a transform
        transform = np.fft.rfft(v ** (p - 1))[harmonics] / samples
        slope = (
            np.sqrt(2.0 * power)
            / top
            * (transform.imag * np.cos(phi) - transform.real * np.sin(phi))
        )
        return float(np.log(top) + np.log(total) / p), slope / total

    for p in _NORMS:
        phases = minimize(
            norm, phases, args=(p,), jac=True, method="L-BFGS-B", options={"maxiter": 60}
        ).x
    return phases


def _from_zero(
    harmonics: np.ndarray, power: np.ndarray, phases: np.ndarray, samples: int
) -> np.ndarray:
    """The phases of the same signal, started at its flattest passage through zero: it leaves the
    trim gently and returns to it.
    """

    u = synthesise_period(harmonics, power, phases, samples)
    at = np.flatnonzero(np.signbit(u) != np.signbit(np.roll(u, -1)))
    first = at[np.argmin(np.abs(np.roll(u, -1)[at] - u[at]))]

    def value(turn: float) -> float:
        return float(np.sqrt(power) @ np.cos(2.0 * np.pi * harmonics * turn + phases))

    turn = brentq(value, first / samples, (first + 1) / samples, xtol=1e-15)
    return np.angle(np.exp(1j * (phases + 2.0 * np.pi * harmonics * turn)))


RATE = 50.0  # [Hz]
LEAD_IN = 1.0  # [s]
CHANNEL_SETS = {  # programmed test inputs of [DAS], Table 3
    "glide": ("delta_a", "delta_e", "delta_r"),
    "aeropropulsive": ("delta_a", "delta_e", "delta_r", "throttle"),
    "full": (
        "delta_a_left",
        "delta_a_right",
        "delta_f_left",
        "delta_f_right",
        "delta_e",
        "delta_r",
        "throttle",
    ),
}


def assemble_signal(
    active: Mapping[str, np.ndarray],
    rate: float,
    lead_in: float = LEAD_IN,
    repeats: int = 1,
    pause: float = 0.0,
    kind: str = "",
) -> xr.Dataset:
    """Return a test input from the moving stretch of each axis.

    Parameters
    ----------
    active : mapping of str to array (sample,)
        Axis to its deflections from trim, all of one length. [SI]
    rate : float
        Samples per second. [Hz]
    lead_in : float
        Quiet stretch before the first movement and after the last. [s]
    repeats : int
        How often the stretch is played.
    pause : float
        Quiet stretch between repeats; 0 joins periods without a seam. [s]
    kind : str
        Kept as an attribute.

    Returns
    -------
    Dataset (time,)
        One variable per axis; attributes ``kind rate lead_in repeats active_start active_stop``
        [s], of the first stretch.
    """
    if repeats < 1 or lead_in < 0.0 or pause < 0.0:
        raise SchemaError(
            "test input",
            [
                f"repeats {repeats}, lead-in {lead_in:g} s, pause {pause:g} s; at least one "
                f"stretch and no negative time"
            ],
        )
    quiet, gap = np.zeros(round(lead_in * rate)), np.zeros(round(pause * rate))
    columns = {}
    for name, u in active.items():
        stretches = [part for k in range(repeats) for part in ((gap, u) if k else (u,))]
        columns[name] = (
            "time",
            np.concatenate([quiet, *stretches, quiet, [0.0]]),
            quantity_attributes(name),
        )
    length = len(next(iter(columns.values()))[1])
    start = len(quiet) / rate
    stop = start + len(next(iter(active.values()))) / rate
    about = {
        "kind": kind,
        "rate": rate,
        "lead_in": lead_in,
        "repeats": repeats,
        "active_start": start,
        "active_stop": stop,
    }
    return xr.Dataset(
        columns, {"time": ("time", np.arange(length) / rate, quantity_attributes("time"))}, about
    )


def axes_of(signal: xr.Dataset) -> list[str]:
    """Return the names of the axes of a test input."""
    return [str(name) for name, item in signal.data_vars.items() if item.dims == ("time",)]


def active_part(signal: xr.Dataset) -> xr.Dataset:
    """Return the first moving stretch of a test input: one period of a multisine."""
    first, last = (
        round(signal.attrs[name] * signal.attrs["rate"]) for name in ("active_start", "active_stop")
    )
    return signal.isel(time=slice(first, last))


def measures(signal: xr.Dataset) -> pd.DataFrame:
    """Return the numbers that judge a test input, axis by axis, over its first moving stretch.

    Returns
    -------
    DataFrame
        Index ``axis``: ``peak rms`` [SI], ``peak_factor`` (`relative_peak_factor`), ``rate``
        (largest, [SI per second]), ``low`` and ``high`` (band that holds 90 % of the power about
        the mean, [Hz]), ``correlation`` (largest with another axis), ``with``.
    """

    part = active_part(signal)
    names, rate = axes_of(part), float(signal.attrs["rate"])
    columns = {name: part[name].values for name in names}
    related = {
        frozenset(pair): _correlation(columns[pair[0]], columns[pair[1]])
        for pair in combinations(names, 2)
    }
    rows = {}
    for name, u in columns.items():
        others = {other: related[frozenset((name, other))] for other in names if other != name}
        nearest = max(others, key=lambda other: abs(others[other]), default="")
        low, high = _band(u, rate)
        rows[name] = {
            "peak": np.abs(u).max(),
            "rms": np.sqrt(np.mean(u**2)),
            "peak_factor": relative_peak_factor(u),
            "rate": np.abs(np.diff(signal[name].values)).max() * rate,
            "low": low,
            "high": high,
            "correlation": others.get(nearest, 0.0),
            "with": nearest,
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("axis")


def axis_correlations(signal: xr.Dataset) -> np.ndarray:
    """Return the correlation of the axes about zero over the first moving stretch, (axis, axis)."""
    part = active_part(signal)
    U = np.stack([part[name].values for name in axes_of(part)])
    U = U / np.linalg.norm(U, axis=1)[:, None]
    return U @ U.T


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    return float(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)))


def _band(u: np.ndarray, rate: float) -> tuple[float, float]:
    """Frequencies below which 5 % and 95 % of the power about the mean lie."""
    power = np.abs(np.fft.rfft(u - u.mean(), 8 * len(u))) ** 2
    share = np.cumsum(power) / power.sum()
    frequency = np.fft.rfftfreq(8 * len(u), 1.0 / rate)
    return float(frequency[np.searchsorted(share, 0.05)]), float(
        frequency[np.searchsorted(share, 0.95)]
    )
