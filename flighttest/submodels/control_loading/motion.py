"""Signals of a control from a record: smooth travel, rate and acceleration.

The functions also find the samples and windows in which these signals are usable.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from flightmech.errors import IdentificationError, UnknownName
from flighttest.records.signals.white_noise import estimate_white_noise
from flighttest.submodels.control_loading.loading import FORCES, ControlLoading

# Time at rest before a pulse or release. [s]
LEAD = 0.5
# Shortest driven stretch. [s]
_SHORTEST = 1.0


def driven_and_free(
    states: xr.Dataset, manoeuvres: pd.DataFrame, free: Sequence[str]
) -> tuple[list[xr.Dataset], list[xr.Dataset]]:
    """Return the driven stretches of a record, and its pulses and releases.

    In a driven stretch the hand drives the control.

    Parameters
    ----------
    states : Dataset (time,)
        States with the channels of the cockpit, see `identify_control_loading`.
    manoeuvres : DataFrame
        ``manoeuvre start end`` of the record, see `flighttest.records.marked_manoeuvres`.
    free : sequence of str
        Names of the manoeuvres that are pulses and releases of this control.

    Raises
    ------
    UnknownName
        None of the names is among the manoeuvres.

    Examples
    --------
    >>> import numpy as np, pandas as pd, xarray as xr
    >>> time = np.arange(0.0, 10.0, 0.02)
    >>> states = xr.Dataset({"column": ("time", 0.0 * time)}, {"time": time})
    >>> columns = {"manoeuvre": ["sweep", "release"], "start": [0.0, 5.0], "end": [5.0, 8.0]}
    >>> listed = pd.DataFrame(columns)
    >>> driven, free = driven_and_free(states, listed, ["release"])
    >>> [(float(one.time[0]), float(one.time[-1])) for one in driven]
    [(0.0, 5.0), (8.0, 9.98)]
    """
    listed = list(dict.fromkeys(manoeuvres["manoeuvre"]))
    if not set(free) & set(listed):
        raise UnknownName(", ".join(free), listed, "manoeuvre", "the record has none of them")
    chosen = manoeuvres[manoeuvres["manoeuvre"].isin(list(free))].sort_values("start")
    first, end = float(states["time"].values[0]), float(states["time"].values[-1])
    starts, ends = (chosen[name].to_numpy(float).tolist() for name in ("start", "end"))
    # A driven stretch lies between the end of one free manoeuvre and the start of the next.
    driven = []
    for a, b in zip([first, *ends], [*starts, end]):
        if b - a > _SHORTEST:
            driven.append(states.sel(time=slice(a, b)))
    return driven, [states.sel(time=slice(max(a - LEAD, first), b)) for a, b in zip(starts, ends)]


# Cut-off frequency [Hz]: a hand moves a control more slowly, and noise of the acceleration grows
# with the power 2.5 of it.
CUTOFF = 2.0
# Part of the recorded travel about neutral in which the sign of the preload is uncertain.
NEUTRAL = 0.03
# Cut-off frequency of the air, above the short period and the Dutch roll. [Hz]
AIR_CUTOFF = 3.0
# Cut-off frequency for start and end of free motion. [Hz]
EVENT_CUTOFF = 10.0
# Time at rest before free motion. [s]
REST = 0.15
# Constants of both ends of the cable, and the signal that each multiplies.
OF_BOTH_ENDS = {"friction": "direction", "damping": "rate", "mass": "acceleration"}
# Time over which the low-pass of EVENT_CUTOFF smears an event. [s]
_SMEAR = 0.08
# Time without motion that ends a window. [s]
_PAUSE = 0.4
# Standard errors of the smoothed rate below which its sign is uncertain.
_SLOW = 6.0
# Part of the fastest rate at which friction is fully developed.
LEAST_RATE = 0.02
# Standard deviation of the Gaussian low-pass in periods of its cut-off (amplitude 0.71).
_WIDTH = 0.1325
# Periods of the cut-off beyond which 0.1 % of a step remains.  The smoothed rate exceeds
# `LEAST_RATE` up to 2.05 standard deviations of the low-pass before the control breaks away.
_REACH = (3.1 + 2.05) * _WIDTH
# Smallest jump of the force between two samples: part of its range, and multiple of its noise.
_JUMP, _CLEAR = 0.2, 8.0


def control_signals(loading: ControlLoading, data: xr.Dataset, cutoff: float | None) -> xr.Dataset:
    """Return travel, rate and acceleration of a record, with its channels low-passed.

    Parameters
    ----------
    loading : ControlLoading
        Control circuit.
    data : Dataset (time,)
        ``column``, ``F_column``, ``delta_e`` (or those of wheel or pedal), ``qbar``, ``nz`` and the
        variables of the hinge moments, on a uniform time base; ``wow`` or ``wow_nose`` if the
        nose-wheel spring is estimated, ``p`` and ``V`` for the ailerons. [SI]
    cutoff : float or None
        Cut-off frequency of the low-pass for all channels. [Hz]  With None, force, travel and
        deflection are not filtered. Air and tab change slowly and get `AIR_CUTOFF`: as inputs of a
        simulation their noise would move the control.

    Raises
    ------
    UnknownName
        The record lacks a channel.
    """
    names, item = loading_channels(loading), loading.item
    if "wow" in names and "wow" not in data and "wow_nose" in data:
        data = data.assign(wow=data["wow_nose"])
    for name in names:
        if name not in data:
            raise UnknownName(
                name, map(str, data.data_vars), "channel", f"the {loading.item} needs it"
            )
    time = data["time"].values.astype(float)
    step = float(np.median(np.diff(time)))
    if np.abs(np.diff(time) - step).max() > 0.2 * step:
        raise IdentificationError("the time base is not even; resample the record first")
    raw = {}
    for name in names:
        raw[name] = np.broadcast_to(np.asarray(data[name].values, float), time.shape)
    signals = {}
    for name, x in raw.items():
        band = cutoff
        if cutoff is None and name not in (item, f"F_{item}", loading.deflection):
            band = AIR_CUTOFF
        signals[name] = x
        if band is not None and name != "wow":
            signals[name] = smooth_derivatives(x, step, band)[0]
    if "alpha" in loading.model.variables and loading.item == "wheel":
        # Local angle of attack at the aileron in a roll, p arm / V.
        signals["alpha"] = loading.arm * signals["p"] / signals["V"]
    signals |= {"travel": signals[item], "on_ground": signals.get("wow", np.zeros_like(time))}
    band = EVENT_CUTOFF if cutoff is None else cutoff
    _, signals["rate"], signals["acceleration"] = smooth_derivatives(raw[item], step, band)
    # The end of the cable at the surface, reduced to the travel.
    _, aft_rate, aft_acceleration = smooth_derivatives(raw[loading.deflection], step, band)
    signals["aft_rate"] = aft_rate / loading.gearing
    signals["aft_acceleration"] = aft_acceleration / loading.gearing
    # Signs get the same low-pass as the force, so that both change alike at a reversal.
    signs = (("side", "travel"), ("direction", "rate"), ("aft_direction", "aft_rate"))
    for name, source in signs:
        signals[name] = np.sign(signals[source])
        if cutoff is not None:
            signals[name] = smooth_derivatives(signals[name], step, cutoff)[0]
    return xr.Dataset({name: ("time", x) for name, x in signals.items()}, {"time": time})


def free_motion_windows(loading: ControlLoading, data: xr.Dataset) -> list[xr.Dataset]:
    """Return the windows from rest to rest in which the control moves, in order of time.

    Parameters
    ----------
    loading : ControlLoading
        Control circuit.
    data : Dataset (time,)
        Pulses and releases, with the hand off the control or its force recorded, as for
        `control_signals`.

    Notes
    -----
    A window starts `REST` before the motion and ends a little after it.  Where dry friction stops a
    control for seconds, a longer window would fit creep and the last digit of the pick-up.
    """
    signals = control_signals(loading, data, EVENT_CUTOFF)
    time = signals["time"].values
    step = float(np.median(np.diff(time)))
    rate = np.abs(signals["rate"].values)
    noise = smoothed_derivative_noise(data[loading.item].values, step, EVENT_CUTOFF)[0]
    moving = np.flatnonzero(rate > max(_SLOW * noise, LEAST_RATE * float(rate.max())))
    if not len(moving):
        return []
    edges = np.flatnonzero(np.diff(moving) * step > _PAUSE)
    first, last = moving[[0, *(edges + 1)]], moving[[*edges, len(moving) - 1]]
    lead, tail = round((REST + _SMEAR) / step), round(_SMEAR / step)
    windows = []
    for a, b in zip(first, last):
        if a >= lead:
            windows.append(data.isel(time=slice(a - lead, b + tail + 1)))
    return windows


def is_sliding(
    loading: ControlLoading, data: xr.Dataset, signals: xr.Dataset, cutoff: float
) -> np.ndarray:
    """Return where the control slides off its neutral, (time,) of bool.

    Reversals, rest and the neighbourhood of neutral are excluded, with the samples that the
    low-pass smears.
    """
    step = float(np.median(np.diff(signals["time"].values)))
    raw = data[loading.item].values
    rate = np.abs(signals["rate"].values)
    reach = int(np.ceil(_REACH / cutoff / step))
    use = ~_next_to(has_force_jump(data[f"F_{loading.item}"].values))
    use &= rate > max(
        _SLOW * smoothed_derivative_noise(raw, step, cutoff)[0], LEAST_RATE * float(rate.max())
    )
    use &= ~(_crossing(signals["rate"].values) | _crossing(signals["aft_rate"].values))
    if "preload" in loading.constants:
        use &= np.abs(signals["travel"].values) > NEUTRAL * float(np.ptp(raw))
        use &= ~_crossing(signals["travel"].values)
    return scipy.ndimage.binary_erosion(use, np.ones(2 * reach + 1))


def force_regressors(
    loading: ControlLoading, signals: xr.Dataset, aft: Mapping[str, float] | None = None
) -> np.ndarray:
    """Return the regressors of the force at the hand, (time, names of `ControlLoading`).

    `aft` is the share of the surface end of the cable in friction, damping and mass.  It divides
    the regressors.
    """
    columns = {str(name): signals[name].values for name in signals.data_vars}
    for name, share in (aft or {}).items():
        signal = OF_BOTH_ENDS[name]
        columns[signal] = (1.0 - share) * columns[signal] + share * columns[f"aft_{signal}"]
    forces = np.column_stack([FORCES[name](columns) for name in loading.constants])
    return np.hstack([forces, loading.load(signals)[:, None] * loading.model.design(signals)])


def pick_up_noise(
    loading: ControlLoading, data: xr.Dataset, cutoff: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the noise of rate and acceleration, of the travel and of the surface end.

    The values are standard deviations, reduced to the travel.
    """
    step = float(np.median(np.diff(data["time"].values)))
    aft = data[loading.deflection].values / loading.gearing
    travel_noise = smoothed_derivative_noise(data[loading.item].values, step, cutoff)
    return travel_noise, smoothed_derivative_noise(aft, step, cutoff)


def loading_channels(loading: ControlLoading) -> list[str]:
    """Return the names of the channels that a record must hold."""
    item = loading.item
    names = [item, f"F_{item}", loading.deflection, "qbar", *loading.model.variables]
    if item == "wheel" and "alpha" in loading.model.variables:
        names = [name for name in names if name != "alpha"] + ["p", "V"]
    if "bob_weight" in loading.constants:
        names.append("nz")
    if "nose_spring" in loading.constants:
        names.append("wow")
    return list(dict.fromkeys(names))


def smooth_derivatives(
    x: np.ndarray, step: float, cutoff: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a signal after a Gaussian low-pass, its first and its second derivative.

    Parameters
    ----------
    x : array (time,)
        Uniformly sampled. [any]
    step : float
        Sampling interval. [s]
    cutoff : float
        Frequency where the amplitude is 0.71. [Hz]

    Notes
    -----
    The signal less the line through both ends is a sine series.  Derivatives of the series are
    exact up to half the sampling rate.  A quartic through five samples is 11 % low in the
    acceleration at 16 Hz and 50 samples per second.  The step response of a Gaussian neither rings
    nor overshoots.  A reversal of friction has therefore no effect 0.41 periods of the cut-off from
    it.  A Butterworth filter of the same noise still has 1 to 4 % there, which acts as a mass.
    """

    count = len(x) - 1
    line = x[0] + (x[-1] - x[0]) / count * np.arange(count + 1)
    omega, weights = _series_weights(count, step, cutoff)
    b = weights * scipy.fft.dst((x - line)[1:-1], type=1) / count
    waves = np.zeros((3, count + 1))
    waves[0, 1:-1] = scipy.fft.dst(b, type=1) / 2.0
    # The derivative of a sine series is a cosine series.
    waves[1, 1:-1] = omega * b
    waves[1] = scipy.fft.dct(waves[1], type=1) / 2.0
    waves[2, 1:-1] = scipy.fft.dst(-(omega**2) * b, type=1) / 2.0
    return line + waves[0], waves[1] + (x[-1] - x[0]) / (count * step), waves[2]


def _series_weights(count: int, step: float, cutoff: float) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies [rad s-1] of the sine series of `count` intervals and low-pass weights."""
    omega = np.pi * np.arange(1, count) / (count * step)
    return omega, np.exp(-0.5 * (omega * _WIDTH / cutoff) ** 2)


def smoothed_derivative_noise(x: np.ndarray, step: float, cutoff: float) -> tuple[float, float]:
    """Return the noise of both derivatives of `smooth_derivatives`, as standard deviations.

    The signal is slow with white noise.
    """
    omega, weights = _series_weights(len(x) - 1, step, cutoff)
    white = estimate_white_noise(x)
    first = white * float(np.sqrt(np.mean((omega * weights) ** 2)))
    second = white * float(np.sqrt(np.mean((omega**2 * weights) ** 2)))
    return first, second


def has_force_jump(force: np.ndarray) -> np.ndarray:
    """Return whether the force jumps between a sample and the next, (samples - 1,).

    The time at which the hand released the control lies between the two samples.
    """
    return np.abs(np.diff(force)) > max(
        _JUMP * float(np.ptp(force)), _CLEAR * estimate_white_noise(force)
    )


def _crossing(x: np.ndarray) -> np.ndarray:
    """Return both samples next to a change of sign; a fast reversal has no slow sample."""
    return _next_to(np.signbit(x[1:]) != np.signbit(x[:-1]))


def _next_to(between: np.ndarray) -> np.ndarray:
    """Return the samples next to an event between two samples."""
    return np.append(between, False) | np.append(False, between)
