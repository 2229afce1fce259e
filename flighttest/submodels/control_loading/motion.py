"""Columns of the force at the hand from a record: smoothed travel, rate and acceleration, and the
samples in which they mean something.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
import scipy
import xarray as xr
from scipy.fft import dct, dst

from flightmech.errors import IdentificationError, UnknownName
from flighttest.submodels.control_loading.loading import FORCES, ControlLoading

LEAD = 0.5  # s of rest before a pulse or release
_SHORTEST = 1.0  # s of a driven stretch


def driven_and_free(
    states: xr.Dataset, manoeuvres: pd.DataFrame, free: Sequence[str]
) -> tuple[list[xr.Dataset], list[xr.Dataset]]:
    """Return the stretches of a record in which the hand drives the control, and its pulses and
    releases.

    Parameters
    ----------
    states : Dataset (time,)
        States with the channels of the cockpit, see `identify_control_loading`.
    manoeuvres : DataFrame
        ``manoeuvre start end`` of the record, see `flighttest.manoeuvres`.
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
    >>> listed = pd.DataFrame({"manoeuvre": ["sweep", "release"], "start": [0.0, 5.0], "end": [5.0, 8.0]})
    >>> driven, free = driven_and_free(states, listed, ["release"])
    >>> [(float(one.time[0]), float(one.time[-1])) for one in driven]
    [(0.0, 5.0), (8.0, 9.98)]
    """
    known = list(dict.fromkeys(manoeuvres["manoeuvre"]))
    if not set(free) & set(known):
        raise UnknownName(", ".join(free), known, "manoeuvre", "the record has none of them")
    chosen = manoeuvres[manoeuvres["manoeuvre"].isin(list(free))].sort_values("start")
    first, end = float(states["time"].values[0]), float(states["time"].values[-1])
    starts, ends = (chosen[name].to_numpy(float).tolist() for name in ("start", "end"))
    edges = [first, *(x for pair in zip(starts, ends) for x in pair), end]
    driven = [
        states.sel(time=slice(a, b)) for a, b in zip(edges[::2], edges[1::2]) if b - a > _SHORTEST
    ]
    return driven, [states.sel(time=slice(max(a - LEAD, first), b)) for a, b in zip(starts, ends)]


CUTOFF = (
    2.0  # Hz: a hand moves a control slower; noise of the acceleration grows with the 2.5th power
)
NEUTRAL = (
    0.03  # of the travel recorded: nearer to neutral, preload is neither one nor the other sign
)
AIR_CUTOFF = 3.0  # Hz: above the short period and the Dutch roll
EVENT_CUTOFF = 10.0  # Hz, to find where free motion starts and ends
REST = 0.15  # s of rest before it
OF_BOTH_ENDS = {
    "friction": "direction",
    "damping": "rate",
    "mass": "acceleration",
}  # what each multiplies
_SMEAR = 0.08  # s: of that low-pass
_PAUSE = 0.4  # s without motion that end a window
_SLOW = 6.0  # standard errors of the smoothed rate; below, its sign is not known
LEAST_RATE = 0.02  # of the fastest rate: friction is fully developed
# standard deviation of the Gaussian low-pass in periods of its cut-off, where the amplitude is 0.71
_WIDTH = 0.1325
_REACH = 3.1 * _WIDTH  # periods of the cut-off beyond which 0.1 % of a step is left
_JUMP, _CLEAR = 0.2, 8.0  # step between two samples: of the range of the force, of its noise


def control_signals(loading: ControlLoading, data: xr.Dataset, cutoff: float | None) -> xr.Dataset:
    """Return a record with travel, rate and acceleration, its channels low-passed.

    Parameters
    ----------
    loading : ControlLoading
    data : Dataset (time,)
        ``column``, ``F_column``, ``delta_e`` (or those of wheel or pedal), ``qbar``, ``nz`` and the
        variables of the hinge moments, on an even time base; ``wow`` or ``wow_nose`` where the
        nose-wheel spring is estimated, ``p`` and ``V`` for the ailerons. [SI]
    cutoff : float or None
        Of one low-pass for all channels.  None leaves force, travel and deflection as they are and
        gives the air and the tab, which change slowly, `AIR_CUTOFF`: as inputs of a simulation
        their noise would shake the control. [Hz]

    Raises
    ------
    UnknownName
        A channel that the record does not hold.
    """
    wanted, item = loading_channels(loading), loading.item
    if "wow" in wanted and "wow" not in data and "wow_nose" in data:
        data = data.assign(wow=data["wow_nose"])
    for name in wanted:
        if name not in data:
            raise UnknownName(
                name, map(str, data.data_vars), "channel", f"the {loading.item} needs it"
            )
    time = data["time"].values.astype(float)
    step = float(np.median(np.diff(time)))
    if np.abs(np.diff(time) - step).max() > 0.2 * step:
        raise IdentificationError("the time base is not even; resample the record first")
    raw = {
        name: np.broadcast_to(np.asarray(data[name].values, float), time.shape) for name in wanted
    }
    found = {}
    for name, x in raw.items():
        quick = name in (item, f"F_{item}", loading.deflection)
        own = AIR_CUTOFF if cutoff is None and not quick else cutoff
        found[name] = x if own is None or name == "wow" else smooth_derivatives(x, step, own)[0]
    if "alpha" in loading.model.variables and loading.item == "wheel":
        found["alpha"] = loading.arm * found["p"] / found["V"]
    found |= {"travel": found[item], "on_ground": found.get("wow", np.zeros_like(time))}
    band = EVENT_CUTOFF if cutoff is None else cutoff
    _, found["rate"], found["acceleration"] = smooth_derivatives(raw[item], step, band)
    _, found["aft_rate"], found["aft_acceleration"] = (
        x / loading.gearing for x in smooth_derivatives(raw[loading.deflection], step, band)
    )
    for side, of in (("side", "travel"), ("direction", "rate"), ("aft_direction", "aft_rate")):
        found[side] = (
            np.sign(found[of])
            if cutoff is None
            else smooth_derivatives(np.sign(found[of]), step, cutoff)[0]
        )
    return xr.Dataset({name: ("time", x) for name, x in found.items()}, {"time": time})


def free_motion_windows(loading: ControlLoading, data: xr.Dataset) -> list[xr.Dataset]:
    """Return the windows from rest to rest in which the control moves, in order of time.

    Parameters
    ----------
    loading : ControlLoading
    data : Dataset (time,)
        Pulses and releases, the hand off the control or its force recorded: see `control_signals`.

    Notes
    -----
    A window starts `REST` before the motion and ends a little after it: where dry friction holds a control for seconds, creep and
    the last digit of the pick-up would be fitted in place of the motion.
    """
    moved = control_signals(loading, data, EVENT_CUTOFF)
    time = moved["time"].values
    step = float(np.median(np.diff(time)))
    rate = np.abs(moved["rate"].values)
    moves = np.flatnonzero(
        rate
        > max(
            _SLOW * smoothed_derivative_noise(data[loading.item].values, step, EVENT_CUTOFF)[0],
            LEAST_RATE * float(rate.max()),
        )
    )
    if not len(moves):
        return []
    edges = np.flatnonzero(np.diff(moves) * step > _PAUSE)
    first, last = moves[[0, *(edges + 1)]], moves[[*edges, len(moves) - 1]]
    lead, tail = round((REST + _SMEAR) / step), round(_SMEAR / step)
    whole = [(a - lead, b + tail + 1) for a, b in zip(first, last) if a >= lead]
    return [data.isel(time=slice(a, b)) for a, b in whole]


def is_sliding(
    loading: ControlLoading, data: xr.Dataset, moved: xr.Dataset, cutoff: float
) -> np.ndarray:
    """Return where the control slides and is off its neutral, (time,) of bool.

    Reversals, rest and the neighbourhood of neutral are left out, and so much next to them as the
    low-pass smears.
    """
    step = float(np.median(np.diff(moved["time"].values)))
    raw = data[loading.item].values
    rate = np.abs(moved["rate"].values)
    reach = int(np.ceil(_REACH / cutoff / step))
    use = ~_next_to(has_force_jump(data[f"F_{loading.item}"].values))
    use &= rate > max(
        _SLOW * smoothed_derivative_noise(raw, step, cutoff)[0], LEAST_RATE * float(rate.max())
    )
    use &= ~(_crossing(moved["rate"].values) | _crossing(moved["aft_rate"].values))
    if "preload" in loading.constants:
        use &= np.abs(moved["travel"].values) > NEUTRAL * float(np.ptp(raw))
        use &= ~_crossing(moved["travel"].values)
    return scipy.ndimage.binary_erosion(use, np.ones(2 * reach + 1))


def force_regressors(
    loading: ControlLoading, moved: xr.Dataset, aft: Mapping[str, float] | None = None
) -> np.ndarray:
    """Return the regressors of the force at the hand, (time, names of `ControlLoading`).

    ``aft`` is the share of the surface's end of the cable in friction, damping and mass; the
    regressors are so divided.
    """
    columns = {str(name): moved[name].values for name in moved.data_vars}
    for name, share in (aft or {}).items():
        one = OF_BOTH_ENDS[name]
        columns[one] = (1.0 - share) * columns[one] + share * columns[f"aft_{one}"]
    forces = np.column_stack([FORCES[name](columns) for name in loading.constants])
    return np.hstack([forces, loading.load(moved)[:, None] * loading.model.design(moved)])


def pick_up_noise(
    loading: ControlLoading, data: xr.Dataset, cutoff: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the standard deviations of the noise in rate and acceleration, of the travel and of
    the surface's end of the cable.
    """
    step = float(np.median(np.diff(data["time"].values)))
    own = smoothed_derivative_noise(data[loading.item].values, step, cutoff)
    return own, smoothed_derivative_noise(
        data[loading.deflection].values / loading.gearing, step, cutoff
    )


def loading_channels(loading: ControlLoading) -> list[str]:
    """Return the names of the channels that a record must hold."""
    item = loading.item
    names = [item, f"F_{item}", loading.deflection, "qbar", *loading.model.variables]
    if item == "wheel" and "alpha" in loading.model.variables:
        names = [name for name in names if name != "alpha"] + ["p", "V"]
    names += ["nz"] * ("bob_weight" in loading.constants) + ["wow"] * (
        "nose_spring" in loading.constants
    )
    return list(dict.fromkeys(names))


def smooth_derivatives(
    x: np.ndarray, step: float, cutoff: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a signal behind a Gaussian low-pass, its first and its second derivative.

    Parameters
    ----------
    x : array (time,)
        Evenly sampled. [any]
    step : float
        [s]
    cutoff : float
        Frequency where the amplitude is 0.71. [Hz]

    Notes
    -----
    Weights on the sine series of what the line through both ends leaves: derivatives are exact up to half the sampling rate, where a
    quartic through five samples is 11 % low in the acceleration at 16 Hz and 50 samples per second.  The step response of a Gaussian
    neither rings nor overshoots, so that a reversal of friction is gone 0.41 periods of the cut-off from it; a Butterworth filter of the
    same noise still has 1 to 4 % of it there, which acts as a mass.
    """

    count = len(x) - 1
    line = x[0] + (x[-1] - x[0]) / count * np.arange(count + 1)
    omega, weights = _weights(count, step, cutoff)
    b = weights * dst((x - line)[1:-1], type=1) / count
    waves = np.zeros((3, count + 1))
    waves[0, 1:-1] = dst(b, type=1) / 2.0
    waves[1, 1:-1] = omega * b
    waves[1] = dct(waves[1], type=1) / 2.0
    waves[2, 1:-1] = dst(-(omega**2) * b, type=1) / 2.0
    return line + waves[0], waves[1] + (x[-1] - x[0]) / (count * step), waves[2]


def _weights(count: int, step: float, cutoff: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies of the sine series of so many intervals and the amplitude of the low-pass. [rad
    s-1], [1]
    """
    omega = np.pi * np.arange(1, count) / (count * step)
    return omega, np.exp(-0.5 * (omega * _WIDTH / cutoff) ** 2)


def smoothed_derivative_noise(x: np.ndarray, step: float, cutoff: float) -> tuple[float, float]:
    """Return the standard deviations of the noise in `smooth_derivatives` first and second derivatives of a
    slow signal with white noise.
    """
    omega, weights = _weights(len(x) - 1, step, cutoff)
    first, second = (
        estimate_white_noise(x) * float(np.sqrt(np.mean((omega**k * weights) ** 2))) for k in (1, 2)
    )
    return first, second


def has_force_jump(force: np.ndarray) -> np.ndarray:
    """Return whether the force jumps between a sample and the next, (samples - 1,): when in between
    the hand let go is not known.
    """
    return np.abs(np.diff(force)) > max(
        _JUMP * float(np.ptp(force)), _CLEAR * estimate_white_noise(force)
    )


def _crossing(x: np.ndarray) -> np.ndarray:
    """Both samples next to a change of sign, however fast: a quick reversal has no slow sample."""
    return _next_to(np.signbit(x[1:]) != np.signbit(x[:-1]))


def _next_to(between: np.ndarray) -> np.ndarray:
    """Samples next to an event between two."""
    return np.append(between, False) | np.append(False, between)


def estimate_white_noise(x: np.ndarray) -> float:
    """Return the standard deviation of white noise on a signal that is mostly slow, by its fourth
    differences.
    """
    return float(np.median(np.abs(np.diff(x, 4))) / 0.6745 / np.sqrt(70.0))
