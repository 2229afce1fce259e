"""Records made ready for both regressions: samples of driven manoeuvres in which the control slides, windows of free motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from ..equation_error.joint_fit import Rows, stretch_lengths
from .loading import ControlLoading
from .modulation import Window, free_signals, modulated, modulation_noise
from .motion import design, noise, pick_up_noise, signals, sliding, smoothed

_DERIVATIVES = ("travel", "rate", "acceleration")


@dataclass(frozen=True)
class Stretch:
    """One record and what of it is used.

    Attributes
    ----------
    moved : Dataset (time,)
        Its `signals`.
    used : array of bool (time,) or list of Window
        Samples of a driven manoeuvre, behind a low-pass; windows of free motion, without.
    white : array (2,)
        Variance of the noise of the travel and of that of the surface's end of the cable, per sample.
    noise : array (2, 2, rows)
        Variance of the noise in rate and acceleration, of the travel and of the surface's end.
    step : float
        Sampling interval. [s]
    """

    moved: xr.Dataset
    used: np.ndarray | list[Window]
    white: np.ndarray
    noise: np.ndarray
    step: float

    def rows(self, x: np.ndarray, order: int = 0) -> np.ndarray:
        """Return the derivative of a signal, (time,) or (time, columns), in the rows."""
        if isinstance(self.used, list):
            return modulated(x, self.used, order)
        return x[self.used] if order == 0 else smoothed(x, self.step, np.inf)[order][self.used]

    def motion(self, loading: ControlLoading, order: int, share: float) -> np.ndarray:
        """Return rate (1) or acceleration (2) of the mean of both ends of the cable, (rows,); `share` is that of the surface."""
        own, far = self.moved["travel"].values, self.moved[loading.deflection].values / loading.gearing
        if not isinstance(self.used, list):
            own, far = self.moved[_DERIVATIVES[order]].values, self.moved[f"aft_{_DERIVATIVES[order]}"].values
            return ((1.0 - share) * own + share * far)[self.used]
        return modulated((1.0 - share) * own + share * far, self.used, order)

    def motion_noise(self, order: int, share: float) -> np.ndarray:
        """Return the variance of the noise in `motion`, (rows,)."""
        own, far = self.noise[order - 1]
        return (1.0 - share) ** 2 * own + share**2 * far

    def equations(self, X: np.ndarray, z: np.ndarray, noise_of_X: np.ndarray) -> Rows:
        """Return regressors and response as the rows of a fit."""
        lengths = () if isinstance(self.used, list) else stretch_lengths(self.used)
        return Rows(X, z, noise_of_X, lengths, self.step)


def driven_stretches(loading: ControlLoading, driven: Sequence[xr.Dataset], cutoff: float) -> list[Stretch]:
    """Return driven manoeuvres behind a low-pass [Hz]; without those in which the control never slides."""
    found = []
    for one in driven:
        moved = signals(loading, one, cutoff)
        use = sliding(loading, one, moved, cutoff)
        if use.any():
            own, far = (np.array(x) ** 2 for x in pick_up_noise(loading, one, cutoff))
            both = np.stack([own, far], axis=1)[:, :, None]
            found.append(Stretch(moved, use, _white(loading, one), np.tile(both, (1, 1, int(use.sum()))), _step(moved)))
    return found


def free_stretches(loading: ControlLoading, free: Sequence[xr.Dataset]) -> list[Stretch]:
    """Return pulses and releases; without those that have no window."""
    found = []
    for one in free:
        moved, windows = free_signals(loading, one)
        if windows:
            both = np.array([modulation_noise(loading, one, windows, order) for order in (1, 2)])
            found.append(Stretch(moved, windows, _white(loading, one), both, _step(moved)))
    return found


def force_rows(loading: ControlLoading, one: Stretch, aft: Mapping[str, float]) -> Rows:
    """Return the equations of the force at the hand; `aft` as in `sliding_fit`."""
    X = one.rows(design(loading, one.moved, aft))
    variance = np.zeros(X.shape)
    for order, name in ((1, "damping"), (2, "mass")):
        if name in loading.constants:
            at, share = loading.names.index(name), aft.get(name, 0.0)
            X[:, at], variance[:, at] = one.motion(loading, order, share), one.motion_noise(order, share)
    return one.equations(X, one.rows(one.moved[f"F_{loading.item}"].values), variance)


def with_error(loading: ControlLoading, one: Stretch, channel: str, kind: int, size: float) -> Stretch:
    """Return a record one of whose channels has a bias (kind 0) [unit of the channel] or a scale error (1)."""

    def wrong(name: str) -> xr.DataArray:
        return one.moved[name] * (1.0 + size) if kind else one.moved[name] + size

    rates = {loading.item: ("rate", "acceleration"), loading.deflection: ("aft_rate", "aft_acceleration")}
    moved = one.moved.assign({channel: wrong(channel)} | {name: wrong(name) for name in rates.get(channel, ()) if kind})
    if channel == loading.item:
        moved["travel"] = moved[channel]
    if loading.item == "wheel" and channel in ("p", "V"):
        moved["alpha"] = loading.arm * moved["p"] / moved["V"]
    return Stretch(moved, one.used, one.white, one.noise, one.step)


def _white(loading: ControlLoading, data: xr.Dataset) -> np.ndarray:
    return np.array([noise(data[loading.item].values), noise(data[loading.deflection].values / loading.gearing)]) ** 2


def _step(moved: xr.Dataset) -> float:
    return float(np.median(np.diff(moved["time"].values)))
