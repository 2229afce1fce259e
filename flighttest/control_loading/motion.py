"""Columns of the force at the hand from a record: smoothed travel, rate and acceleration, and the samples in which they mean something."""

from __future__ import annotations

import numpy as np
import xarray as xr
from scipy.ndimage import binary_dilation, binary_erosion

from flightmech.errors import IdentificationError, UnknownName

from ..signals.conditioning import lowpass
from .loading import FORCES, ControlLoading

CUTOFF = 4.0  # Hz: twice the fastest motion of a hand, so that an inertial force is seen and encoder noise is not
FREE_CUTOFF = 16.0  # Hz, of free motion: four times the mode of a control on its hinge moment, below half of 50 samples per second
NEUTRAL = 0.03  # of the travel recorded: nearer to neutral, preload is neither one nor the other sign
AIR_CUTOFF = 3.0  # Hz: above the short period and the Dutch roll
EVENT_CUTOFF = 10.0  # Hz, to find where free motion starts and ends
REST = 0.15  # s of rest before it
_SMEAR = 0.08  # s: of that low-pass
_PAUSE = 0.4  # s without motion that end a window
_SLOW = 6.0  # standard errors of the smoothed rate; below, its sign is not known
_LEAST_RATE = 0.02  # of the fastest rate: friction is fully developed
_REACH = 0.5  # periods of the cut-off over which the low-pass spreads a kink
_SHAKEN = 0.6  # periods of the cut-off next to a step of the force
_JUMP, _CLEAR = 0.4, 8.0  # step between two samples: of the range of the force, of its noise


def signals(loading: ControlLoading, data: xr.Dataset, cutoff: float | None) -> xr.Dataset:
    """Return a record with travel, rate and acceleration, its channels low-passed.

    Parameters
    ----------
    loading : ControlLoading
    data : Dataset (time,)
        ``column``, ``F_column``, ``delta_e`` (or those of wheel or pedal), ``qbar``, ``nz`` and the variables of the hinge moments,
        on an even time base; ``wow`` where the nose-wheel spring is estimated, ``p`` and ``V`` for the ailerons. [SI]
    cutoff : float or None
        Of one low-pass for all channels.  None leaves force, travel and deflection as they are and gives the air and the tab, which
        change slowly, `AIR_CUTOFF`: as inputs of a simulation their noise would shake the control. [Hz]

    Raises
    ------
    UnknownName
        A channel that the record does not hold.
    """
    wanted, item = _channels(loading), loading.item
    for name in wanted:
        if name not in data:
            raise UnknownName(name, map(str, data.data_vars), "channel", f"the {loading.item} needs it")
    time = data["time"].values.astype(float)
    step = float(np.median(np.diff(time)))
    if np.abs(np.diff(time) - step).max() > 0.2 * step:
        raise IdentificationError("the time base is not even; resample the record first")
    found = {}
    for name in wanted:
        x = np.broadcast_to(np.asarray(data[name].values, float), time.shape)
        quick = name in (item, f"F_{item}", loading.deflection)
        own = AIR_CUTOFF if cutoff is None and not quick else cutoff
        found[name] = x if own is None or name == "wow" else lowpass(x, 1.0 / step, own)
    s = found[loading.item]
    rate, acceleration = rates(s, step)
    if "alpha" in loading.model.variables and loading.item == "wheel":
        found["alpha"] = loading.arm * found["p"] / found["V"]
    for side, x in (("side", s), ("direction", rate)):
        found[side] = np.sign(x) if cutoff is None else lowpass(np.sign(x), 1.0 / step, cutoff)
    found |= {"travel": s, "rate": rate, "acceleration": acceleration, "on_ground": found.get("wow", np.zeros_like(s))}
    return xr.Dataset({name: ("time", x) for name, x in found.items()}, {"time": time})


def free_motion(loading: ControlLoading, data: xr.Dataset) -> list[xr.Dataset]:
    """Return the windows from rest to rest in which the control moves, in order of time.

    Parameters
    ----------
    loading : ControlLoading
    data : Dataset (time,)
        Pulses and releases, the hand off the control or its force recorded: see `signals`.

    Notes
    -----
    A window starts `REST` before the motion and ends a little after it: where dry friction holds a control for seconds, creep and
    the last digit of the pick-up would be fitted in place of the motion.
    """
    moved = signals(loading, data, EVENT_CUTOFF)
    time = moved["time"].values
    step = float(np.median(np.diff(time)))
    rate = np.abs(moved["rate"].values)
    moves = np.flatnonzero(rate > max(_SLOW * _rate_noise(data[loading.item].values, EVENT_CUTOFF, step), _LEAST_RATE * float(rate.max())))
    if not len(moves):
        return []
    edges = np.flatnonzero(np.diff(moves) * step > _PAUSE)
    first, last = moves[[0, *(edges + 1)]], moves[[*edges, len(moves) - 1]]
    lead, tail = round((REST + _SMEAR) / step), round(_SMEAR / step)
    whole = [(a - lead, b + tail + 1) for a, b in zip(first, last) if a >= lead]
    return [data.isel(time=slice(a, b)) for a, b in whole]


def sliding(loading: ControlLoading, data: xr.Dataset, moved: xr.Dataset, cutoff: float) -> np.ndarray:
    """Return where the control slides and is off its neutral, (time,) of bool.

    Reversals, rest and the neighbourhood of neutral are left out, and so much next to them as the low-pass smears.
    """
    step = float(np.median(np.diff(moved["time"].values)))
    raw = data[loading.item].values
    noise = _rate_noise(raw, cutoff, step)
    rate = np.abs(moved["rate"].values)
    use = ~_jumping(data[f"F_{loading.item}"].values, round(_SHAKEN / cutoff / step))
    use &= rate > max(_SLOW * noise, _LEAST_RATE * float(rate.max()))
    if "preload" in loading.constants:
        use &= np.abs(moved["travel"].values) > NEUTRAL * float(np.ptp(raw))
    width = 2 * int(np.ceil(_REACH / cutoff / step)) + 1
    return binary_erosion(use, np.ones(width), border_value=1)


def design(loading: ControlLoading, moved: xr.Dataset) -> np.ndarray:
    """Return the regressors of the force at the hand, (time, names of `ControlLoading`)."""
    columns = {str(name): moved[name].values for name in moved.data_vars}
    forces = np.column_stack([FORCES[name](columns) for name in loading.constants])
    return np.hstack([forces, loading.load(moved)[:, None] * loading.model.design(moved)])


def _channels(loading: ControlLoading) -> list[str]:
    item = loading.item
    names = [item, f"F_{item}", loading.deflection, "qbar", *loading.model.variables]
    if item == "wheel" and "alpha" in loading.model.variables:
        names = [name for name in names if name != "alpha"] + ["p", "V"]
    names += ["nz"] * ("bob_weight" in loading.constants) + ["wow"] * ("nose_spring" in loading.constants)
    return list(dict.fromkeys(names))


def rates(x: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return first and second derivative by a quartic through five samples: right within (omega step)^4/30.

    Central differences of three samples would be 2 % low at 4 Hz and 100 samples per second, and the mass 2 % high.
    """
    from scipy.signal import savgol_filter

    return savgol_filter(x, 5, 4, deriv=1, delta=step), savgol_filter(x, 5, 4, deriv=2, delta=step)


def _jumping(force: np.ndarray, reach: int) -> np.ndarray:
    """Samples next to a step of the force: when inside a sampling interval the hand let go is not known."""
    jumps = np.abs(np.diff(force, append=force[-1])) > max(_JUMP * float(np.ptp(force)), _CLEAR * noise(force))
    return binary_dilation(jumps, np.ones(2 * reach + 1)) if jumps.any() else jumps


def _rate_noise(x: np.ndarray, cutoff: float, step: float) -> float:
    """Standard deviation of the rate of a noisy signal behind the low-pass."""
    return noise(x) * np.sqrt(2.0 * cutoff * step) * 2.0 * np.pi * cutoff / np.sqrt(3.0)


def noise(x: np.ndarray) -> float:
    """Return the standard deviation of white noise on a slow signal, by its second differences."""
    return float(np.median(np.abs(np.diff(x, 2))) / 0.6745 / np.sqrt(6.0))
