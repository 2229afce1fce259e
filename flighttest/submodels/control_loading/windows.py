"""Preparation of records for both regressions of control loading.

Driven manoeuvres are used at the samples in which the control slides. Free motion is used in
windows, with modulating functions phi that vanish with their derivatives at both ends. Integration
by parts moves the derivatives of a signal x to phi,

    int phi x' dt = - int phi' x dt,    int phi x'' dt = int phi'' x dt

so that a noisy signal is not differentiated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from flighttest.records.signals.white_noise import estimate_white_noise
from flighttest.submodels.control_loading.joint_fit import RecordEquations, stretch_lengths
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.motion import (
    LEAST_RATE,
    NEUTRAL,
    control_signals,
    force_regressors,
    has_force_jump,
    is_sliding,
    pick_up_noise,
    smooth_derivatives,
    smoothed_derivative_noise,
)

# Cut-off frequency of the rate whose sign bounds the windows. [Hz]
EVENTS = 10.0
# Longest window, a period of a control on its hinge moment. [s]
LONGEST = 0.3
# Shortest window in samples. Sums replace integrals, and noise of the acceleration grows with the
# power 2.5 of the shortness.
SHORTEST = 9
# Smallest number of samples of a window that has the second function, which shows the change.
_OF_CHANGE = 12
# Standard errors of the rate above which the control moves. A wrong choice at the ends of a window
# does little harm, because phi is small there.
_MOVING = 3.0
# Signals of `control_signals` by the order of the derivative.
_DERIVATIVES = ("travel", "rate", "acceleration")


@dataclass(frozen=True)
class ModulatingWindow:
    """One window of a record and its modulating function.

    The function is scaled so that white noise of the record has the same size in every window.

    Attributes
    ----------
    part : slice
        Samples of the record.
    phi : array (3, samples)
        The function, its negative first and its second derivative, over (sum phi^2)^0.5. [1, s-1,
        s-2]
    """

    part: slice
    phi: np.ndarray

    def of(self, x: np.ndarray, order: int = 0) -> np.ndarray:
        """Return the sum of the function times the derivative of that order, of every column."""
        return self.phi[order] @ x[self.part]


def modulate_signal(x: np.ndarray, windows: list[ModulatingWindow], order: int = 0) -> np.ndarray:
    """Return the derivative of a signal in every window.

    A signal (time,) or (time, columns) gives (windows,) or (windows, columns).
    """
    return np.array([window.of(x, order) for window in windows]).reshape(len(windows), *x.shape[1:])


def find_slide_windows(
    loading: ControlLoading, data: xr.Dataset, moved: xr.Dataset
) -> list[ModulatingWindow]:
    """Return the windows of a record in which the control slides one way.

    Within a window it is on one side of neutral, and the force has no step.

    Parameters
    ----------
    loading : ControlLoading
        Control circuit.
    data : Dataset (time,)
        The record.
    moved : Dataset (time,)
        Its `control_signals` without low-pass.
    """
    step = _step(moved)
    travel = data[loading.item].values
    rate = moved["rate"].values
    # The control moves where its rate is above the noise and above a share of the largest rate.
    noise = smoothed_derivative_noise(travel, step, EVENTS)[0]
    least = max(_MOVING * noise, LEAST_RATE * float(np.abs(rate).max()))
    use = np.abs(rate) > least
    # A window must not contain a step of the force, or a change of sign of friction or breakout.
    breaks = (
        has_force_jump(data[f"F_{loading.item}"].values)
        | _changes(rate)
        | _changes(moved["aft_rate"].values)
    )
    if "preload" in loading.constants:
        use &= np.abs(moved["travel"].values) > NEUTRAL * float(np.ptp(travel))
        breaks |= _changes(moved["travel"].values)
    # Number of the run of each sample: a break, or a change of use, starts the next run.
    run = np.concatenate([[0], np.cumsum(breaks | _changes(use - 0.5))])
    windows = []
    for number in np.unique(run[use]):
        indices = np.flatnonzero((run == number) & use)
        windows += _overlapping_windows(int(indices[0]), len(indices), step)
    return windows


def modulation_noise(
    loading: ControlLoading, data: xr.Dataset, windows: list[ModulatingWindow], order: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the variances of a derivative of the travel and of the surface end, (windows,).

    White noise of variance s^2 gives sum phi x the variance s^2 sum phi^2.
    """
    total = np.array([float(window.phi[order] @ window.phi[order]) for window in windows])
    travel = estimate_white_noise(data[loading.item].values)
    aft = estimate_white_noise(data[loading.deflection].values) / loading.gearing
    return travel**2 * total, aft**2 * total


def free_signals(
    loading: ControlLoading, data: xr.Dataset
) -> tuple[xr.Dataset, list[ModulatingWindow]]:
    """Return the signals of a record without low-pass, and its windows."""
    moved = control_signals(loading, data, None)
    return moved, find_slide_windows(loading, data, moved)


def _overlapping_windows(first: int, count: int, step: float) -> list[ModulatingWindow]:
    """Return windows with half overlap over `count` samples."""
    if count < SHORTEST:
        return []
    size = min(count, max(SHORTEST, round(LONGEST / step)))
    # Number of windows that cover all samples with steps of half a window at most.
    number = int(np.ceil(2.0 * (count - size) / size)) + 1
    starts = np.linspace(0, count - size, number).round().astype(int)
    functions = _functions(size, step)[: 2 if size >= _OF_CHANGE else 1]
    windows = []
    for start in starts:
        part = slice(first + start, first + start + size)
        windows += [ModulatingWindow(part, phi) for phi in functions]
    return windows


def _functions(size: int, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return sin^4 u and sin^4 u cos u over a window, each (3, samples), over the norm of phi.

    The rows are phi, -phi' and phi'', with u from 0 to pi. The first function gives the mean of the
    motion, the second its change.
    """
    u = np.pi * np.arange(size) / (size - 1)
    k = np.pi / ((size - 1) * step)  # du/dt [s-1]
    s, c = np.sin(u), np.cos(u)
    # Derivatives of sin^4 u: 4 k s^3 c and 4 k^2 s^2 (3 c^2 - s^2).
    even = np.array([s**4, -4.0 * k * s**3 * c, 4.0 * k**2 * s**2 * (3.0 * c**2 - s**2)])
    # Derivatives of sin^4 u cos u: k s^3 (4 c^2 - s^2) and k^2 s^2 c (12 c^2 - 13 s^2).
    odd = np.array(
        [s**4 * c, -k * s**3 * (4.0 * c**2 - s**2), k**2 * s**2 * c * (12.0 * c**2 - 13.0 * s**2)]
    )
    return even / np.linalg.norm(even[0]), odd / np.linalg.norm(odd[0])


def _changes(x: np.ndarray) -> np.ndarray:
    """Return whether the sign changes between a sample and the next, (samples - 1,)."""
    return np.signbit(x[1:]) != np.signbit(x[:-1])


@dataclass(frozen=True)
class PreparedRecord:
    """One record with its usable samples or windows.

    Attributes
    ----------
    moved : Dataset (time,)
        Its `control_signals`.
    used : array of bool (time,) or list of ModulatingWindow
        Samples of a driven manoeuvre, after a low-pass; windows of free motion, without one.
    white : array (2,)
        Variance of the noise of the travel and of the surface end of the cable, per sample.
    noise : array (2, 2, rows)
        Variance of the noise in rate and acceleration, of the travel and of the surface's end.
    step : float
        Sampling interval. [s]
    """

    moved: xr.Dataset
    used: np.ndarray | list[ModulatingWindow]
    white: np.ndarray
    noise: np.ndarray
    step: float

    def rows(self, x: np.ndarray, order: int = 0) -> np.ndarray:
        """Return the derivative of a signal, (time,) or (time, columns), in the rows."""
        if isinstance(self.used, list):
            return modulate_signal(x, self.used, order)
        if order == 0:
            return x[self.used]
        return smooth_derivatives(x, self.step, np.inf)[order][self.used]

    def motion(self, loading: ControlLoading, order: int, share: float) -> np.ndarray:
        """Return rate (1) or acceleration (2) of the mean of both ends of the cable, (rows,).

        `share` is the weight of the surface end.
        """
        if isinstance(self.used, list):
            # The derivative is moved to the modulating function.
            fore = self.moved["travel"].values
            aft = self.moved[loading.deflection].values / loading.gearing
            return modulate_signal((1.0 - share) * fore + share * aft, self.used, order)
        fore = self.moved[_DERIVATIVES[order]].values
        aft = self.moved[f"aft_{_DERIVATIVES[order]}"].values
        return ((1.0 - share) * fore + share * aft)[self.used]

    def motion_noise(self, order: int, share: float) -> np.ndarray:
        """Return the variance of the noise in `motion`, (rows,)."""
        fore, aft = self.noise[order - 1]
        return (1.0 - share) ** 2 * fore + share**2 * aft

    def equations(self, X: np.ndarray, z: np.ndarray, noise_of_X: np.ndarray) -> RecordEquations:
        """Return regressors and response as the rows of a fit."""
        lengths = () if isinstance(self.used, list) else stretch_lengths(self.used)
        return RecordEquations(X, z, noise_of_X, lengths, self.step)


def driven_stretches(
    loading: ControlLoading, driven: Sequence[xr.Dataset], cutoff: float
) -> list[PreparedRecord]:
    """Return the driven manoeuvres in which the control slides, after a low-pass.

    Parameters
    ----------
    loading : ControlLoading
    driven : sequence of Dataset (time,)
    cutoff : float
        Cut-off frequency of the low-pass. [Hz]
    """
    records = []
    for data in driven:
        signals = control_signals(loading, data, cutoff)
        use = is_sliding(loading, data, signals=signals, cutoff=cutoff)
        if use.any():
            fore, aft = (np.array(x) ** 2 for x in pick_up_noise(loading, data, cutoff))
            # (rate or acceleration, end, rows); the noise is the same at all samples.
            ends = np.stack([fore, aft], axis=1)[:, :, None]
            records.append(
                PreparedRecord(
                    signals,
                    use,
                    white=_white_variances(loading, data),
                    noise=np.tile(ends, (1, 1, int(use.sum()))),
                    step=_step(signals),
                )
            )
    return records


def free_stretches(loading: ControlLoading, free: Sequence[xr.Dataset]) -> list[PreparedRecord]:
    """Return the pulses and releases that have a window, without a low-pass."""
    records = []
    for data in free:
        signals, windows = free_signals(loading, data)
        if windows:
            noise = [modulation_noise(loading, data, windows, order) for order in (1, 2)]
            records.append(
                PreparedRecord(
                    signals,
                    windows,
                    white=_white_variances(loading, data),
                    noise=np.array(noise),
                    step=_step(signals),
                )
            )
    return records


def force_rows(
    loading: ControlLoading, record: PreparedRecord, aft: Mapping[str, float]
) -> RecordEquations:
    """Return the equations of the force at the hand; `aft` as in `sliding_fit`."""
    X = record.rows(force_regressors(loading, record.moved, aft))
    variance = np.zeros(X.shape)
    # Rate and acceleration are noisy: they come from both ends, with their variances.
    for order, name in ((1, "damping"), (2, "mass")):
        if name in loading.constants:
            column, share = loading.names.index(name), aft.get(name, 0.0)
            X[:, column] = record.motion(loading, order, share)
            variance[:, column] = record.motion_noise(order, share)
    return record.equations(X, record.rows(record.moved[f"F_{loading.item}"].values), variance)


def with_error(
    loading: ControlLoading, record: PreparedRecord, channel: str, kind: int, size: float
) -> PreparedRecord:
    """Return a record with an error of a channel.

    The error is a bias (kind 0) [unit of the channel] or a scale error (kind 1).
    """
    rates = {
        loading.item: ("rate", "acceleration"),
        loading.deflection: ("aft_rate", "aft_acceleration"),
    }
    signals = record.moved.copy()
    if kind:
        # A scale error also scales the derivatives.
        for name in (channel, *rates.get(channel, ())):
            signals[name] = record.moved[name] * (1.0 + size)
    else:
        signals[channel] = record.moved[channel] + size
    if channel == loading.item:
        signals["travel"] = signals[channel]
    if loading.item == "wheel" and channel in ("p", "V"):
        signals["alpha"] = loading.arm * signals["p"] / signals["V"]
    return replace(record, moved=signals)


def _white_variances(loading: ControlLoading, data: xr.Dataset) -> np.ndarray:
    """Return the variance of white noise of the travel and of the surface end, (2,)."""
    fore = estimate_white_noise(data[loading.item].values)
    aft = estimate_white_noise(data[loading.deflection].values / loading.gearing)
    return np.array([fore, aft]) ** 2


def _step(moved: xr.Dataset) -> float:
    """Return the sampling interval. [s]"""
    return float(np.median(np.diff(moved["time"].values)))
