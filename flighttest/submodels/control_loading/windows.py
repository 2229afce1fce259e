"""Records made ready for both regressions: samples of driven manoeuvres in which the control
slides, windows of free motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from flighttest.submodels.control_loading.joint_fit import RecordEquations, stretch_lengths
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.motion import (
    LEAST_RATE,
    NEUTRAL,
    control_signals,
    estimate_white_noise,
    force_regressors,
    has_force_jump,
    is_sliding,
    pick_up_noise,
    smooth_derivatives,
    smoothed_derivative_noise,
)

EVENTS = 10.0  # Hz: low-pass of the rate whose sign bounds the windows
LONGEST = 0.3  # s: a period of a control on its hinge moment
# samples: sums stand for integrals, and noise of the acceleration grows with the 2.5th power of the
# shortness
SHORTEST = 9
_OF_CHANGE = 12  # samples from which on the second function counts
_MOVING = 3.0  # standard errors of that rate; at the ends of a window phi is small


@dataclass(frozen=True)
class ModulatingWindow:
    """One window of a record and its function, scaled so that white noise of the record has the
    same size in every window.

    Attributes
    ----------
    part : slice
        Samples.
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
    """Return the derivative of a signal, (time,) or (time, columns), in every window, (windows,) or
    (windows, columns).
    """
    return np.array([window.of(x, order) for window in windows]).reshape(len(windows), *x.shape[1:])


def find_slide_windows(
    loading: ControlLoading, data: xr.Dataset, moved: xr.Dataset
) -> list[ModulatingWindow]:
    """Return the windows of a record in which the control slides one way, on one side of neutral,
    without a step of the force.

    Parameters
    ----------
    loading : ControlLoading
    data : Dataset (time,)
        The record.
    moved : Dataset (time,)
        Its `control_signals` without low-pass.
    """
    step = float(np.median(np.diff(moved["time"].values)))
    s = data[loading.item].values
    rate = moved["rate"].values
    use = np.abs(rate) > max(
        _MOVING * smoothed_derivative_noise(s, step, EVENTS)[0],
        LEAST_RATE * float(np.abs(rate).max()),
    )
    breaks = (
        has_force_jump(data[f"F_{loading.item}"].values)
        | _changes(rate)
        | _changes(moved["aft_rate"].values)
    )
    if "preload" in loading.constants:
        use &= np.abs(moved["travel"].values) > NEUTRAL * float(np.ptp(s))
        breaks |= _changes(moved["travel"].values)
    run = np.concatenate([[0], np.cumsum(breaks | _changes(use - 0.5))])
    found = []
    for number in np.unique(run[use]):
        own = np.flatnonzero((run == number) & use)
        found += _windows(int(own[0]), len(own), step)
    return found


def modulation_noise(
    loading: ControlLoading, data: xr.Dataset, windows: list[ModulatingWindow], order: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the variances of that derivative of the travel and of the surface's end, (windows,)."""
    total = np.array([float(window.phi[order] @ window.phi[order]) for window in windows])
    return estimate_white_noise(data[loading.item].values) ** 2 * total, (
        estimate_white_noise(data[loading.deflection].values) / loading.gearing
    ) ** 2 * total


def free_signals(
    loading: ControlLoading, data: xr.Dataset
) -> tuple[xr.Dataset, list[ModulatingWindow]]:
    """Return the signals of a record without low-pass, and its windows."""
    moved = control_signals(loading, data, None)
    return moved, find_slide_windows(loading, data, moved)


def _windows(first: int, count: int, step: float) -> list[ModulatingWindow]:
    """Windows with half overlap over so many samples."""
    if count < SHORTEST:
        return []
    size = min(count, max(SHORTEST, round(LONGEST / step)))
    number = int(np.ceil(2.0 * (count - size) / size)) + 1
    starts = np.linspace(0, count - size, number).round().astype(int)
    return [
        ModulatingWindow(slice(first + at, first + at + size), phi)
        for at in starts
        for phi in _functions(size, step)[: 2 if size >= _OF_CHANGE else 1]
    ]


def _functions(size: int, step: float) -> tuple[np.ndarray, np.ndarray]:
    """sin^4 and sin^4 cos over a window, each with its negative first and its second derivative:
    the mean of the motion and its change.
    """
    u = np.pi * np.arange(size) / (size - 1)
    k = np.pi / ((size - 1) * step)
    s, c = np.sin(u), np.cos(u)
    even = np.array([s**4, -4.0 * k * s**3 * c, 4.0 * k**2 * s**2 * (3.0 * c**2 - s**2)])
    odd = np.array(
        [s**4 * c, -k * s**3 * (4.0 * c**2 - s**2), k**2 * s**2 * c * (12.0 * c**2 - 13.0 * s**2)]
    )
    return even / np.linalg.norm(even[0]), odd / np.linalg.norm(odd[0])


def _changes(x: np.ndarray) -> np.ndarray:
    """Whether the sign changes between a sample and the next, (samples - 1,)."""
    return np.signbit(x[1:]) != np.signbit(x[:-1])


_DERIVATIVES = ("travel", "rate", "acceleration")


@dataclass(frozen=True)
class PreparedRecord:
    """One record and what of it is used.

    Attributes
    ----------
    moved : Dataset (time,)
        Its `control_signals`.
    used : array of bool (time,) or list of Window
        Samples of a driven manoeuvre, behind a low-pass; windows of free motion, without.
    white : array (2,)
        Variance of the noise of the travel and of that of the surface's end of the cable, per
        sample.
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
        return (
            x[self.used]
            if order == 0
            else smooth_derivatives(x, self.step, np.inf)[order][self.used]
        )

    def motion(self, loading: ControlLoading, order: int, share: float) -> np.ndarray:
        """Return rate (1) or acceleration (2) of the mean of both ends of the cable, (rows,);
        `share` is that of the surface.
        """
        own, far = (
            self.moved["travel"].values,
            self.moved[loading.deflection].values / loading.gearing,
        )
        if not isinstance(self.used, list):
            own, far = (
                self.moved[_DERIVATIVES[order]].values,
                self.moved[f"aft_{_DERIVATIVES[order]}"].values,
            )
            return ((1.0 - share) * own + share * far)[self.used]
        return modulate_signal((1.0 - share) * own + share * far, self.used, order)

    def motion_noise(self, order: int, share: float) -> np.ndarray:
        """Return the variance of the noise in `motion`, (rows,)."""
        own, far = self.noise[order - 1]
        return (1.0 - share) ** 2 * own + share**2 * far

    def equations(self, X: np.ndarray, z: np.ndarray, noise_of_X: np.ndarray) -> RecordEquations:
        """Return regressors and response as the rows of a fit."""
        lengths = () if isinstance(self.used, list) else stretch_lengths(self.used)
        return RecordEquations(X, z, noise_of_X, lengths, self.step)


def driven_stretches(
    loading: ControlLoading, driven: Sequence[xr.Dataset], cutoff: float
) -> list[PreparedRecord]:
    """Return driven manoeuvres behind a low-pass [Hz]; without those in which the control never
    slides.
    """
    found = []
    for one in driven:
        moved = control_signals(loading, one, cutoff)
        use = is_sliding(loading, one, moved, cutoff)
        if use.any():
            own, far = (np.array(x) ** 2 for x in pick_up_noise(loading, one, cutoff))
            both = np.stack([own, far], axis=1)[:, :, None]
            found.append(
                PreparedRecord(
                    moved,
                    use,
                    _white(loading, one),
                    np.tile(both, (1, 1, int(use.sum()))),
                    _step(moved),
                )
            )
    return found


def free_stretches(loading: ControlLoading, free: Sequence[xr.Dataset]) -> list[PreparedRecord]:
    """Return pulses and releases; without those that have no window."""
    found = []
    for one in free:
        moved, windows = free_signals(loading, one)
        if windows:
            both = np.array([modulation_noise(loading, one, windows, order) for order in (1, 2)])
            found.append(PreparedRecord(moved, windows, _white(loading, one), both, _step(moved)))
    return found


def force_rows(
    loading: ControlLoading, one: PreparedRecord, aft: Mapping[str, float]
) -> RecordEquations:
    """Return the equations of the force at the hand; `aft` as in `sliding_fit`."""
    X = one.rows(force_regressors(loading, one.moved, aft))
    variance = np.zeros(X.shape)
    for order, name in ((1, "damping"), (2, "mass")):
        if name in loading.constants:
            at, share = loading.names.index(name), aft.get(name, 0.0)
            X[:, at], variance[:, at] = (
                one.motion(loading, order, share),
                one.motion_noise(order, share),
            )
    return one.equations(X, one.rows(one.moved[f"F_{loading.item}"].values), variance)


def with_error(
    loading: ControlLoading, one: PreparedRecord, channel: str, kind: int, size: float
) -> PreparedRecord:
    """Return a record one of whose channels has a bias (kind 0) [unit of the channel] or a scale
    error (1).
    """

    def wrong(name: str) -> xr.DataArray:
        return one.moved[name] * (1.0 + size) if kind else one.moved[name] + size

    rates = {
        loading.item: ("rate", "acceleration"),
        loading.deflection: ("aft_rate", "aft_acceleration"),
    }
    moved = one.moved.assign(
        {channel: wrong(channel)} | {name: wrong(name) for name in rates.get(channel, ()) if kind}
    )
    if channel == loading.item:
        moved["travel"] = moved[channel]
    if loading.item == "wheel" and channel in ("p", "V"):
        moved["alpha"] = loading.arm * moved["p"] / moved["V"]
    return PreparedRecord(moved, one.used, one.white, one.noise, one.step)


def _white(loading: ControlLoading, data: xr.Dataset) -> np.ndarray:
    return (
        np.array(
            [
                estimate_white_noise(data[loading.item].values),
                estimate_white_noise(data[loading.deflection].values / loading.gearing),
            ]
        )
        ** 2
    )


def _step(moved: xr.Dataset) -> float:
    return float(np.median(np.diff(moved["time"].values)))
