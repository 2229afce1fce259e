"""Resampling, zero-phase filtering and cutting of flight records.

Controls move in near-rectangular steps.  They are interpolated by monotone cubics, which do not
overshoot, and all other channels by cubic splines.  A channel that is faster than the target grid
is low-passed first in both directions, without delay and aliasing.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import xarray as xr

from flightmech.errors import OutOfRange, SchemaError, UnknownName
from flightmech.names import quantity_attributes
from flighttest.records.signals.sample_flags import ENDLESS

# Quantities that are constants of a manoeuvre.
SLOW = ("mass", "x_cg_b", "y_cg_b", "z_cg_b", "x_cg", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
GAP = 3.0
"""Longest step of a clock without a gap, in median steps."""
_SWITCHES = ("wow_", "gear", "speedbrake", "brake")
_CONTROLS = (
    *("delta_", "throttle", "pla", "gear", "speedbrake", "brake"),
    *("column", "wheel", "pedal", "F_", "wow_"),
)
SMOOTHING = 6.0
"""Cut-off of `smooth`, two to three times the fastest mode of a small aeroplane. [Hz]

For a light jet 2 to 3 Hz are suitable.
"""
SAME_CLOCK = 1e-9
"""Difference of equal stamps, in sampling intervals."""
# Cut-off of a faster channel before it is resampled, in rates of the target grid.
_GRID_CUTOFF = 0.4
# Attributes of a channel that a manoeuvre has too.
_CHANNEL_ATTRIBUTES = ("units", "sign", "long_name", "calibration")
_PLACE_ATTRIBUTES = ("latitude", "runway_elevation")


def is_control(name: str) -> bool:
    """Return whether a channel is a surface, lever, device or pilot force."""
    return name.rpartition(".")[2].startswith(_CONTROLS)


def lowpass(x, rate: float, cutoff: float = SMOOTHING) -> np.ndarray:
    """Return `x` after a zero-phase low-pass filter.

    The filter is a Butterworth filter of order 4, forward and backward, with -3 dB at `cutoff`.

    Parameters
    ----------
    x : array (time,)
        Uniformly sampled signal. [any]
    rate : float
        Samples per second. [Hz]
    cutoff : float
        Frequency where the amplitude is 0.71, below half the rate. [Hz]

    Returns
    -------
    array (time,)

    Raises
    ------
    OutOfRange
        The cut-off is not below half the rate.

    Notes
    -----
    Two passes give -6 dB at the design frequency, which is therefore raised by
    (sqrt(2) - 1)^(-1/8) = 1.117.  Both ends are padded by odd reflection over three time constants
    of the slowest pole (at least 0.5/cutoff).  Treat 0.5 s at each end as lost.
    """
    # reading a record filters nothing: SciPy's part takes half a second to import
    from scipy.signal import sosfiltfilt

    design = cutoff / (math.sqrt(2.0) - 1.0) ** 0.125
    if not 0.0 < design < 0.5 * rate:
        raise OutOfRange(
            f"cut-off {cutoff:g} Hz at {rate:g} samples per second; it must lie between 0 "
            f"and {0.5 * rate * 0.895:g} Hz"
        )
    x = np.asarray(x, float)
    # The slowest poles of a Butterworth filter of order 4 have the damping ratio sin(pi/8).
    slowest = 1.0 / (2.0 * math.pi * design * math.sin(math.pi / 8.0))
    pad = math.ceil(rate * max(0.5 / cutoff, 3.0 * slowest))
    return sosfiltfilt(_butterworth(design, rate), x, padtype="odd", padlen=min(pad, len(x) - 1))


# One design takes as long as the filtering of a manoeuvre.
@lru_cache(maxsize=256)
def _butterworth(cutoff: float, rate: float) -> np.ndarray:
    """Return the second-order sections of a Butterworth filter of order 4, for reading only."""
    # reading a record filters nothing: SciPy's part takes half a second to import
    from scipy.signal import butter

    return butter(4, cutoff, fs=rate, output="sos")


def resample(time, x, grid, name: str) -> np.ndarray:
    """Return channel `name` on another time grid.

    Parameters
    ----------
    time, x : array (time,)
        Samples, at rising times. [s], [any]
    grid : array (grid,)
        Times of the result.  Beyond the samples the nearest value is held. [s]
    name : str
        Canonical name.  A control has a monotone cubic, any other channel a cubic spline.

    Returns
    -------
    array (grid,)

    References
    ----------
    .. [Fritsch1980] Fritsch, Carlson, SIAM J. Numer. Anal. 17, 1980.
    """
    # reading a record filters nothing: SciPy's part takes half a second to import
    from scipy.interpolate import CubicSpline, PchipInterpolator

    time, x, grid = (np.asarray(a, float) for a in (time, x, grid))
    grid = np.clip(grid, time[0], time[-1])
    if len(time) < 4:
        return np.interp(grid, time, x)
    if _is_same_clock(time, grid) and np.isfinite(x).all():
        return x.copy()
    interpolator = PchipInterpolator if is_control(name) else CubicSpline
    return interpolator(time, x)(grid)


def _is_same_clock(time: np.ndarray, grid: np.ndarray) -> bool:
    if len(time) != len(grid):
        return False
    tolerance = SAME_CLOCK * (time[-1] - time[0]) / len(time)
    return bool(np.abs(time - grid).max() <= tolerance)


def resample_to_grid(time, x, grid, name: str) -> np.ndarray:
    """Return a channel on a uniform grid.

    A channel faster than the grid is low-passed first below 0.4 of the rate of the grid.
    Parameters are the same as in `resample`; `grid` is uniform and has at least two points.
    """
    time, x, grid = (np.asarray(a, float) for a in (time, x, grid))
    rate = 1.0 / (grid[1] - grid[0])
    channel_rate = 1.0 / float(np.median(np.diff(time)))
    # A switch has no frequencies that could be filtered.
    is_switch = name.rpartition(".")[2].startswith("wow_")
    if len(time) > 1 and channel_rate > 1.01 * rate and not is_switch:
        steps = math.floor((time[-1] - time[0]) * channel_rate + 1e-6)
        uniform = time[0] + np.arange(steps + 1) / channel_rate
        # A shorter channel is too short for the filter.
        if len(uniform) > 8:
            x = lowpass(resample(time, x, uniform, name), channel_rate, _GRID_CUTOFF * rate)
            time = uniform
    return resample(time, x, grid, name)


def smooth(maneuver: xr.Dataset, cutoff: float = SMOOTHING, controls: bool = False) -> xr.Dataset:
    """Return a manoeuvre with its measured channels after a zero-phase low-pass filter.

    Parameters
    ----------
    maneuver : Dataset (time,)
        As `cut` returns it, on a uniform clock; scalars and switches stay as they are.
    cutoff : float
        Frequency where the amplitude is 0.71; two to three times the fastest mode of the aeroplane.
        [Hz]
    controls : bool
        Whether surfaces and levers are filtered too.  A regression needs it if they move faster
        than `cutoff`.

    Returns
    -------
    Dataset (time,)
        Attribute ``smoothed`` [Hz]; treat 0.5 s at each end as lost.

    Raises
    ------
    OutOfRange
        The cut-off is not below half the rate of the manoeuvre.

    References
    ----------
    .. [DataAcquisition] Design, manufacturing, and testing of a data acquisition system for
       fixed-wing UAS, section IV.C.
    """
    time = maneuver["time"].values
    rate = (maneuver.sizes["time"] - 1) / float(time[-1] - time[0])
    smoothed = maneuver.copy()
    for name in map(str, maneuver.data_vars):
        channel = maneuver[name]
        is_switch = name.rpartition(".")[2].startswith(_SWITCHES)
        if channel.dims != ("time",) or is_switch or (is_control(name) and not controls):
            continue
        smoothed[name] = "time", lowpass(channel.values, rate, cutoff), channel.attrs
    return smoothed.assign_attrs(smoothed=cutoff)


def remove_delay(time, x, delay: float, name: str) -> np.ndarray:
    """Return a channel without a known latency.

    The value of the result at t is the recorded value at t + delay.

    Parameters
    ----------
    time, x : array (time,)
        Samples, at rising times.  The result is NaN where a NaN contributes to it. [s], [any]
    delay : float
        Latency of the channel, see `time_delay`.  The last `delay` seconds have the last sample.
        [s]
    name : str
        Canonical name, see `resample`.

    Returns
    -------
    array (time,)
    """
    time, x = np.asarray(time, float), np.asarray(x, float)
    is_finite = np.isfinite(x)
    if not delay or is_finite.sum() < 2:
        return x
    samples = x[is_finite]
    if name in ENDLESS:
        samples = np.unwrap(samples)
    shifted_time = np.clip(time + delay, time[0], time[-1])
    shifted = resample(time[is_finite], samples, shifted_time, name)
    # Linear interpolation of the mask is positive where a NaN is one of the two neighbours.
    is_lost = np.interp(time + delay, time, (~is_finite).astype(float)) > 0.0
    return np.where(is_lost, np.nan, shifted)


def cut(record: xr.DataTree, start: float, stop: float, rate: float = 50.0) -> xr.Dataset:
    """Return a manoeuvre: all channels of a record between two times, on one uniform clock.

    Parameters
    ----------
    record : DataTree
        A flight record, see `read`.
    start, stop : float
        Window, on the record's clock. [s]
    rate : float
        Samples per second. [Hz]

    Returns
    -------
    Dataset (time,)
        All channels.  Slow quantities (mass, c.g., inertia) are scalars, their mean over the
        window.  Heading is unwrapped.  Attribute ``recorded_rate`` [Hz] of a channel is its rate in
        the record.  Attributes are ``record``, ``start``, ``stop``, ``rate``, and ``latitude`` and
        ``runway_elevation`` if the record has them.

    Raises
    ------
    OutOfRange
        The window is not inside every leaf, or a leaf has a gap in it.
    SchemaError
        NaN samples inside the window: every channel with its first time.
    """
    if not rate > 0.0 or not stop - start >= 1.0 / rate:
        raise OutOfRange(
            f"window {start:g} ... {stop:g} s at {rate:g} Hz; stop must lie at least one "
            f"sample after start"
        )
    grid = start + np.arange(math.floor((stop - start) * rate + 1e-6) + 1) / rate
    pieces = {}
    for leaf, node in record.children.items():
        pieces[leaf] = _select_window(leaf, node.to_dataset(), start, stop)
    demand_numbers(pieces, f"{record.attrs.get('title', 'record')}, {start:g} ... {stop:g} s")

    data = xr.Dataset(coords={"time": ("time", grid, quantity_attributes("time"))})
    for piece in pieces.values():
        _add_channels(data, piece, grid, (start, stop))
    place_attrs = {key: record.attrs[key] for key in _PLACE_ATTRIBUTES if key in record.attrs}
    data.attrs = {
        "record": str(record.attrs.get("title", "")),
        "start": start,
        "stop": stop,
        "rate": rate,
        **place_attrs,
    }
    return data


def _add_channels(
    data: xr.Dataset, piece: xr.Dataset, grid: np.ndarray, window: tuple[float, float]
) -> None:
    """Add the channels of a part of a leaf to a manoeuvre."""
    time = piece["time"].values
    for name in map(str, piece.data_vars):
        x, attrs = piece[name].values, piece[name].attrs
        attrs = {key: item for key, item in attrs.items() if key in _CHANNEL_ATTRIBUTES}
        if name == "psi":
            x = np.unwrap(x)
        if name in SLOW:
            # A slow leaf may have samples next to the window only.
            inside = (time >= window[0]) & (time <= window[1])
            mean = x[inside].mean() if inside.any() else x.mean()
            data[name] = (), float(mean), attrs
        else:
            attrs["recorded_rate"] = float(piece.attrs["rate"])
            data[name] = "time", resample_to_grid(time, x, grid, name), attrs


def channel(record: xr.DataTree, name: str) -> xr.DataArray:
    """Return one channel of a record on the clock of its leaf.

    Raises
    ------
    UnknownName
        The record has no such channel.
    """
    for node in record.children.values():
        if name in node.data_vars:
            return node.to_dataset()[name]
    names: set[str] = set()
    for node in record.children.values():
        names.update(map(str, node.data_vars))
    raise UnknownName(
        name,
        names,
        what="channel",
        hint="see 'aeromatch flight show' for what the record holds",
    )


def demand_numbers(pieces: dict[str, xr.Dataset], what: str) -> None:
    """Raise if a channel of any leaf has NaN; the error has each channel and its first time."""
    problems = []
    for leaf, piece in pieces.items():
        for name in map(str, piece.data_vars):
            is_lost = ~np.isfinite(piece.variables[name].values)
            if is_lost.any():
                first = float(piece["time"].values[int(np.argmax(is_lost))])
                problems.append(
                    f"{leaf}/{name}: {int(is_lost.sum())} NaN samples, first at {first:g} s; "
                    f"choose a window without them or repair the channel"
                )
    if problems:
        raise SchemaError(what, problems)


def _select_window(leaf: str, data: xr.Dataset, start: float, stop: float) -> xr.Dataset:
    """Return the part of a leaf in and near a window. [s]"""
    time = data["time"].values
    step = 1.0 / float(data.attrs["rate"])
    if start < time[0] - step or stop > time[-1] + step:
        raise OutOfRange(
            f"window {start:g} ... {stop:g} s; leaf {leaf} holds {time[0]:g} ... "
            f"{time[-1]:g} s; choose a window inside the record"
        )
    # The margin keeps the ends of the low-pass filter out of the window.
    margin = max(1.0, 4.0 * step)
    near = np.flatnonzero((time >= start - margin) & (time <= stop + margin))
    piece = data.isel(time=slice(near[0], near[-1] + 1))
    is_gap = (np.diff(time) > GAP * step) & (time[1:] > start) & (time[:-1] < stop)
    if is_gap.any():
        i = int(np.argmax(is_gap))
        gap = f"leaf {leaf} has a gap of {time[i + 1] - time[i]:.3g} s after {time[i]:g} s"
        raise OutOfRange(f"window {start:g} ... {stop:g} s; {gap}; cut before or after it")
    return piece
