"""Manoeuvres of flight records: all channels of a window on one uniform clock, and smoothing."""

from __future__ import annotations

import math

import numpy as np
import xarray as xr

from flightmech.errors import OutOfRange, SchemaError, UnknownName
from flightmech.names import WRAPPED, quantity_attributes
from flightmech.quantities import time_text, value_in_si
from flighttest.records.signals.resampling import (
    GAP,
    SMOOTHING,
    is_control,
    is_switch,
    lowpass,
    resample_to_grid,
)

# Quantities that are constants of a manoeuvre.
SLOW = ("mass", "x_cg_b", "y_cg_b", "z_cg_b", "x_cg", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
# Channels besides the switches whose steps must not be filtered.
_STEPS = ("wow_", "gear", "speedbrake", "brake")
# Attributes of a channel that a manoeuvre has too.
_CHANNEL_ATTRIBUTES = ("units", "sign", "long_name", "calibration")
_PLACE_ATTRIBUTES = ("latitude", "runway_elevation")


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
        has_steps = is_switch(name) or name.rpartition(".")[2].startswith(_STEPS)
        if channel.dims != ("time",) or has_steps or (is_control(name) and not controls):
            continue
        smoothed[name] = "time", lowpass(channel.values, rate, cutoff), channel.attrs
    return smoothed.assign_attrs(smoothed=cutoff)


def cut_whole(record: xr.DataTree, rate: float | str = 50.0) -> xr.Dataset:
    """Return all channels of a record over the time that every leaf covers; see `cut`."""
    clocks = [leaf.to_dataset()["time"].values for leaf in record.children.values()]
    begin = max(float(clock[0]) for clock in clocks)
    end = min(float(clock[-1]) for clock in clocks)
    return cut(record, begin, end, rate)


def cut(
    record: xr.DataTree, start: float | str, stop: float | str, rate: float | str = 50.0
) -> xr.Dataset:
    """Return a manoeuvre: all channels of a record between two times, on one uniform clock.

    Parameters
    ----------
    record : DataTree
        A flight record, see `read`.
    start, stop : float or str
        Window, on the record's clock; a text has its unit, as ``"1.5 min"``. [s]
    rate : float or str
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
    first: float = value_in_si(start, "s", "start")
    last: float = value_in_si(stop, "s", "stop")
    frequency: float = value_in_si(rate, "Hz", "rate")
    if not frequency > 0.0 or not last - first >= 1.0 / frequency:
        raise OutOfRange(
            f"window {time_text(first)} ... {time_text(last)} s at {frequency:g} Hz; stop must lie "
            "at least one "
            f"sample after start"
        )
    # 1e-6 of a sample absorbs the rounding of the window.
    grid = first + np.arange(math.floor((last - first) * frequency + 1e-6) + 1) / frequency
    pieces = {}
    for leaf, node in record.children.items():
        pieces[leaf] = _select_window(leaf, node.to_dataset(), first, last)
    demand_numbers(
        pieces, f"{record.attrs.get('title', 'record')}, {time_text(first)} ... {time_text(last)} s"
    )

    data = xr.Dataset(coords={"time": ("time", grid, quantity_attributes("time"))})
    for piece in pieces.values():
        _add_channels(data, piece, grid, (first, last))
    place_attrs = {key: record.attrs[key] for key in _PLACE_ATTRIBUTES if key in record.attrs}
    data.attrs = {
        "record": str(record.attrs.get("title", "")),
        "start": first,
        "stop": last,
        "rate": frequency,
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
        if name in WRAPPED:
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
                    f"{leaf}/{name}: {int(is_lost.sum())} NaN samples, first at {time_text(first)} "
                    "s; "
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
            f"window {time_text(start)} ... {time_text(stop)} s; leaf {leaf} holds "
            f"{time_text(time[0])} ... "
            f"{time_text(time[-1])} s; choose a window inside the record"
        )
    # The margin keeps the ends of the low-pass filter out of the window.
    margin = max(1.0, 4.0 * step)
    near = np.flatnonzero((time >= start - margin) & (time <= stop + margin))
    piece = data.isel(time=slice(near[0], near[-1] + 1))
    is_gap = (np.diff(time) > GAP * step) & (time[1:] > start) & (time[:-1] < stop)
    if is_gap.any():
        i = int(np.argmax(is_gap))
        gap = f"leaf {leaf} has a gap of {time[i + 1] - time[i]:.3g} s after {time_text(time[i])} s"
        raise OutOfRange(
            f"window {time_text(start)} ... {time_text(stop)} s; {gap}; cut before or after it"
        )
    return piece
