"""Free motion between two reversals, weighted by modulating functions: the equation of motion without differentiating a measurement.

A function phi that vanishes at both ends of a window with its first three derivatives moves the derivatives of the travel to itself,

    int phi s'' dt = int phi'' s dt,        int phi s' dt = -int phi' s dt,

and a window without a reversal has one sign of friction all over.  So the shortest motion counts from end to end, where a low-pass loses
what a reversal smears, and noise is that of the whole window.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from .loading import ControlLoading
from .motion import LEAST_RATE, NEUTRAL, derivative_noise, jumps, noise, signals

EVENTS = 10.0  # Hz: low-pass of the rate whose sign bounds the windows
LONGEST = 0.3  # s: a period of a control on its hinge moment
SHORTEST = 9  # samples: sums stand for integrals, and noise of the acceleration grows with the 2.5th power of the shortness
_OF_CHANGE = 12  # samples from which on the second function counts
_MOVING = 3.0  # standard errors of that rate; at the ends of a window phi is small


@dataclass(frozen=True)
class Window:
    """One window of a record and its function, scaled so that white noise of the record has the same size in every window.

    Attributes
    ----------
    part : slice
        Samples.
    phi : array (3, samples)
        The function, its negative first and its second derivative, over (sum phi^2)^0.5. [1, s-1, s-2]
    """

    part: slice
    phi: np.ndarray

    def of(self, x: np.ndarray, order: int = 0) -> np.ndarray:
        """Return the sum of the function times the derivative of that order, of every column."""
        return self.phi[order] @ x[self.part]


def modulated(x: np.ndarray, windows: list[Window], order: int = 0) -> np.ndarray:
    """Return the derivative of a signal, (time,) or (time, columns), in every window, (windows,) or (windows, columns)."""
    return np.array([window.of(x, order) for window in windows]).reshape(len(windows), *x.shape[1:])


def windows_of(loading: ControlLoading, data: xr.Dataset, moved: xr.Dataset) -> list[Window]:
    """Return the windows of a record in which the control slides one way, on one side of neutral, without a step of the force.

    Parameters
    ----------
    loading : ControlLoading
    data : Dataset (time,)
        The record.
    moved : Dataset (time,)
        Its `signals` without low-pass.
    """
    step = float(np.median(np.diff(moved["time"].values)))
    s = data[loading.item].values
    rate = moved["rate"].values
    use = np.abs(rate) > max(_MOVING * derivative_noise(s, step, EVENTS)[0], LEAST_RATE * float(np.abs(rate).max()))
    breaks = jumps(data[f"F_{loading.item}"].values) | _changes(rate) | _changes(moved["aft_rate"].values)
    if "preload" in loading.constants:
        use &= np.abs(moved["travel"].values) > NEUTRAL * float(np.ptp(s))
        breaks |= _changes(moved["travel"].values)
    run = np.concatenate([[0], np.cumsum(breaks | _changes(use - 0.5))])
    found = []
    for number in np.unique(run[use]):
        own = np.flatnonzero((run == number) & use)
        found += _windows(int(own[0]), len(own), step)
    return found


def modulation_noise(loading: ControlLoading, data: xr.Dataset, windows: list[Window], order: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the variances of that derivative of the travel and of the surface's end, (windows,)."""
    total = np.array([float(window.phi[order] @ window.phi[order]) for window in windows])
    return noise(data[loading.item].values) ** 2 * total, (noise(data[loading.deflection].values) / loading.gearing) ** 2 * total


def free_signals(loading: ControlLoading, data: xr.Dataset) -> tuple[xr.Dataset, list[Window]]:
    """Return the signals of a record without low-pass, and its windows."""
    moved = signals(loading, data, None)
    return moved, windows_of(loading, data, moved)


def _windows(first: int, count: int, step: float) -> list[Window]:
    """Windows with half overlap over so many samples."""
    if count < SHORTEST:
        return []
    size = min(count, max(SHORTEST, round(LONGEST / step)))
    number = int(np.ceil(2.0 * (count - size) / size)) + 1
    starts = np.linspace(0, count - size, number).round().astype(int)
    return [
        Window(slice(first + at, first + at + size), phi)
        for at in starts
        for phi in _functions(size, step)[: 2 if size >= _OF_CHANGE else 1]
    ]


def _functions(size: int, step: float) -> tuple[np.ndarray, np.ndarray]:
    """sin^4 and sin^4 cos over a window, each with its negative first and its second derivative: the mean of the motion and its change."""
    u = np.pi * np.arange(size) / (size - 1)
    k = np.pi / ((size - 1) * step)
    s, c = np.sin(u), np.cos(u)
    even = np.array([s**4, -4.0 * k * s**3 * c, 4.0 * k**2 * s**2 * (3.0 * c**2 - s**2)])
    odd = np.array([s**4 * c, -k * s**3 * (4.0 * c**2 - s**2), k**2 * s**2 * c * (12.0 * c**2 - 13.0 * s**2)])
    return even / np.linalg.norm(even[0]), odd / np.linalg.norm(odd[0])


def _changes(x: np.ndarray) -> np.ndarray:
    """Whether the sign changes between a sample and the next, (samples - 1,)."""
    return np.signbit(x[1:]) != np.signbit(x[:-1])
