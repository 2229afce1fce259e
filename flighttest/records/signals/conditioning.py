"""Resampling, zero-phase filtering and cutting of flight records.

Controls move in near-rectangular steps and are interpolated by monotone cubics (no overshoot), all
other channels by cubic splines.  A channel that is faster than the target grid is low-passed first,
both ways, so that nothing is delayed and nothing folds down.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import xarray as xr

from flightmech.errors import OutOfRange, SchemaError, UnknownName
from flightmech.names import quantity_attributes
from flighttest.records.signals.sample_flags import ENDLESS

SLOW = ("mass", "x_cg_b", "y_cg_b", "z_cg_b", "x_cg", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
GAP = 3.0  # a step of the clock longer than so many median steps is a gap
_SWITCHES = ("wow_", "gear", "speedbrake", "brake")
_CONTROLS = (
    "delta_",
    "throttle",
    "pla",
    "gear",
    "speedbrake",
    "brake",
    "column",
    "wheel",
    "pedal",
    "F_",
    "wow_",
)


def is_control(name: str) -> bool:
    """Return whether a channel is moved by a hand or a switch: surfaces, levers, devices, pilot
    forces.
    """
    return name.rpartition(".")[2].startswith(_CONTROLS)


# Hz; two to three times the fastest mode of a small aeroplane: take 2 to 3 Hz for a light jet
SMOOTHING = 6.0


def lowpass(x, rate: float, cutoff: float = SMOOTHING) -> np.ndarray:
    """Return `x` low-passed without phase: Butterworth of order 4, forward and backward, -3 dB at
    `cutoff`.

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
    Two passes give -6 dB at the design frequency; it is raised by (sqrt(2) - 1)^(-1/8) = 1.117.  Both ends are padded by
    odd reflection over three time constants of the slowest pole (at least 0.5/cutoff); treat 0.5 s at each end as lost.
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
    slowest = 1.0 / (2.0 * math.pi * design * math.sin(math.pi / 8.0))
    pad = math.ceil(rate * max(0.5 / cutoff, 3.0 * slowest))
    return sosfiltfilt(_butterworth(design, rate), x, padtype="odd", padlen=min(pad, len(x) - 1))


@lru_cache(maxsize=256)  # one design takes as long as filtering a manoeuvre
def _butterworth(cutoff: float, rate: float) -> np.ndarray:
    """Return the second-order sections of the Butterworth filter of order 4; not to be written to."""
    # reading a record filters nothing: SciPy's part takes half a second to import
    from scipy.signal import butter

    return butter(4, cutoff, fs=rate, output="sos")


SAME_CLOCK = 1e-9  # of a sampling interval: stamps that differ by less are the same


def resample(time, x, grid, name: str) -> np.ndarray:
    """Return channel `name` on another time grid.

    Parameters
    ----------
    time, x : array (time,)
        Samples, at rising times. [s], [any]
    grid : array (grid,)
        Where the channel is wanted; beyond the samples the nearest value is held. [s]
    name : str
        Canonical name; it decides between the monotone cubic of a control and the cubic spline.

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
    if (
        len(time) == len(grid)
        and np.abs(time - grid).max() <= SAME_CLOCK * (time[-1] - time[0]) / len(time)
        and np.isfinite(x).all()
    ):
        return x.copy()
    return (PchipInterpolator if is_control(name) else CubicSpline)(time, x)(grid)


def resample_to_grid(time, x, grid, name: str) -> np.ndarray:
    """Return a channel on a uniform grid, low-passed below 0.4 of the grid's rate first when the
    channel is faster.

    Parameters as in `resample`; `grid` is uniform and has two points or more.
    """
    time, x, grid = (np.asarray(a, float) for a in (time, x, grid))
    rate, own = 1.0 / (grid[1] - grid[0]), 1.0 / float(np.median(np.diff(time)))
    if len(time) > 1 and own > 1.01 * rate and not name.rpartition(".")[2].startswith("wow_"):
        uniform = time[0] + np.arange(math.floor((time[-1] - time[0]) * own + 1e-6) + 1) / own
        if len(uniform) > 8:
            x = lowpass(resample(time, x, uniform, name), own, 0.4 * rate)
            time = uniform
    return resample(time, x, grid, name)


def smooth(maneuver: xr.Dataset, cutoff: float = SMOOTHING, controls: bool = False) -> xr.Dataset:
    """Return a manoeuvre with its measured channels low-passed without phase.

    Parameters
    ----------
    maneuver : Dataset (time,)
        As `cut` returns it, on a uniform clock; scalars and switches stay as they are.
    cutoff : float
        Frequency where the amplitude is 0.71; two to three times the fastest mode of the aeroplane.
        [Hz]
    controls : bool
        Send surfaces and levers through the same filter.  Needed for a regression when they move
        faster than `cutoff`.

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
    .. [DataAcquisition] Design, manufacturing, and testing of a data acquisition system for fixed-wing UAS, section IV.C.
    """
    rate = (maneuver.sizes["time"] - 1) / float(
        maneuver["time"].values[-1] - maneuver["time"].values[0]
    )
    found = maneuver.copy()
    for name in map(str, maneuver.data_vars):
        moved = maneuver[name].dims == ("time",) and not name.rpartition(".")[2].startswith(
            _SWITCHES
        )
        if moved and (controls or not is_control(name)):
            found[name] = "time", lowpass(maneuver[name].values, rate, cutoff), maneuver[name].attrs
    return found.assign_attrs(smoothed=cutoff)


def remove_delay(time, x, delay: float, name: str) -> np.ndarray:
    """Return a channel with a known latency removed: its value at t is what was recorded at t +
    delay.

    Parameters
    ----------
    time, x : array (time,)
        Samples, at rising times; NaN stays NaN, as does what would come from between a sample and a
        NaN. [s], [any]
    delay : float
        Latency of the channel, see `time_delay`; the last `delay` seconds hold the last sample. [s]
    name : str
        Canonical name, see `resample`.

    Returns
    -------
    array (time,)
    """
    time, x = np.asarray(time, float), np.asarray(x, float)
    good = np.isfinite(x)
    if not delay or good.sum() < 2:
        return x
    known = np.unwrap(x[good]) if name in ENDLESS else x[good]
    moved = resample(time[good], known, np.clip(time + delay, time[0], time[-1]), name)
    lost = np.interp(time + delay, time, (~good).astype(float)) > 0.0
    return np.where(lost, np.nan, moved)


def cut(record: xr.DataTree, start: float, stop: float, rate: float = 50.0) -> xr.Dataset:
    """Return a manoeuvre: every channel of a record between two times on one uniform clock.

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
        All channels; slow quantities (mass, c.g., inertia) as scalars, the mean over the window.
        Heading is unwrapped.  Attribute ``recorded_rate`` [Hz] of a channel states how often it was
        recorded. Attributes ``record``, ``start``, ``stop``, ``rate``, and ``latitude`` and
        ``runway_elevation`` where the record has them.

    Raises
    ------
    OutOfRange
        The window is not inside every leaf, or a leaf has a gap in it; the message states what is
        there.
    SchemaError
        NaN samples inside the window: every channel with its first time.
    """
    if not rate > 0.0 or not stop - start >= 1.0 / rate:
        raise OutOfRange(
            f"window {start:g} ... {stop:g} s at {rate:g} Hz; stop must lie at least one "
            f"sample after start"
        )
    grid = start + np.arange(math.floor((stop - start) * rate + 1e-6) + 1) / rate
    pieces = {
        leaf: _inside(leaf, node.to_dataset(), start, stop)
        for leaf, node in record.children.items()
    }
    demand_numbers(pieces, f"{record.attrs.get('title', 'record')}, {start:g} ... {stop:g} s")

    data = xr.Dataset(coords={"time": ("time", grid, quantity_attributes("time"))})
    for piece in pieces.values():
        time = piece["time"].values
        recorded = float(piece.attrs["rate"])
        for name in map(str, piece.data_vars):
            x = np.unwrap(piece[name].values) if name == "psi" else piece[name].values
            about = {
                key: value
                for key, value in piece[name].attrs.items()
                if key in ("units", "sign", "long_name", "calibration")
            }
            if name in SLOW:
                data[name] = (
                    (),
                    float(
                        x[(time >= start) & (time <= stop)].mean()
                        if ((time >= start) & (time <= stop)).any()
                        else x.mean()
                    ),
                    about,
                )
            else:
                data[name] = (
                    "time",
                    resample_to_grid(time, x, grid, name),
                    {**about, "recorded_rate": recorded},
                )
    place = {
        key: record.attrs[key] for key in ("latitude", "runway_elevation") if key in record.attrs
    }
    data.attrs = {
        "record": str(record.attrs.get("title", "")),
        "start": start,
        "stop": stop,
        "rate": rate,
        **place,
    }
    return data


def channel(record: xr.DataTree, name: str) -> xr.DataArray:
    """Return one channel of a record with its own clock.

    Raises
    ------
    UnknownName
        The record has no such channel.
    """
    for node in record.children.values():
        if name in node.data_vars:
            return node.to_dataset()[name]
    raise UnknownName(
        name,
        {str(n) for node in record.children.values() for n in node.data_vars},
        "channel",
        "see 'aeromatch flight show' for what the record holds",
    )


def demand_numbers(pieces: dict[str, xr.Dataset], what: str) -> None:
    """Raise when a channel of any leaf holds NaN, and name every such channel with the first time."""
    problems = []
    for leaf, piece in pieces.items():
        for name in map(str, piece.data_vars):
            bad = ~np.isfinite(piece.variables[name].values)
            if bad.any():
                first = float(piece["time"].values[int(np.argmax(bad))])
                problems.append(
                    f"{leaf}/{name}: {int(bad.sum())} NaN samples, first at {first:g} s; "
                    f"choose a window without them or repair the channel"
                )
    if problems:
        raise SchemaError(what, problems)


def _inside(leaf: str, data: xr.Dataset, start: float, stop: float) -> xr.Dataset:
    """Return the part of a leaf around a window, with margin for the filter's ends."""
    time = data["time"].values
    step = 1.0 / float(data.attrs["rate"])
    if start < time[0] - step or stop > time[-1] + step:
        raise OutOfRange(
            f"window {start:g} ... {stop:g} s; leaf {leaf} holds {time[0]:g} ... "
            f"{time[-1]:g} s; choose a window inside the record"
        )
    margin = max(1.0, 4.0 * step)
    near = np.flatnonzero((time >= start - margin) & (time <= stop + margin))
    piece = data.isel(time=slice(near[0], near[-1] + 1))
    inside = np.flatnonzero((np.diff(time) > GAP * step) & (time[1:] > start) & (time[:-1] < stop))
    if len(inside):
        at = int(inside[0])
        place = f"leaf {leaf} has a gap of {time[at + 1] - time[at]:.3g} s after {time[at]:g} s"
        raise OutOfRange(f"window {start:g} ... {stop:g} s; {place}; cut before or after it")
    return piece
