"""Logs of an actuator: command, position, rate and torque out of a file of any format that records are read from."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, SchemaError
from flightmech.units import to_si

from ..readers.name_map import NameMap
from ..readers.opening import open_recording
from ..readers.own_columns import located

UNITS = {"position": "rad", "rate": "rad s-1", "torque": "N m"}
"""SI unit of each measured channel; the command has whatever unit it is recorded in."""
CHANNELS = ("command", *UNITS)
_UNEVEN = 1e-3  # of the median step, beyond which a clock is made even
_GAP = 3.0  # steps; samples in a longer hole are no readings


def read_bench_log(path: str | Path, columns: Mapping[str, str] | None = None) -> xr.Dataset:
    """Return command and measured motion of an actuator from a log.

    Parameters
    ----------
    path : str or Path
        CSV, MATLAB, netCDF, HDF5, ULog, DataFlash: whatever `flighttest.read` opens, by its own column names.
    columns : mapping of str to str, optional
        Channel among ``command``, ``position``, ``rate``, ``torque`` to the column that holds it, ``TABLE/COLUMN`` where there are several
        tables; ``COLUMN [deg]`` gives a unit that the file does not state.  A channel without an entry is looked for under its own name.

    Returns
    -------
    Dataset (time,)
        ``command`` as recorded, ``position`` [rad], ``rate`` [rad/s], ``torque`` [N m] as far as recorded, on the clock of the position
        or rate; others are interpolated onto it linearly, and a clock that is not uniform is made even at its median rate.

    Raises
    ------
    UnknownName
        A column that the file does not have.
    IdentificationError
        No command, or neither position nor rate.
    SchemaError
        No clock or one that does not rise, gaps in the command.

    Notes
    -----
    A held command that jumps between two samples is read as a ramp between them: half a sample early or late, zero in the mean.
    """
    recording = open_recording(path, NameMap({}))
    found: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    units: dict[str, str] = {}
    for channel in CHANNELS:
        wanted = (columns or {}).get(channel)
        place = located(recording, wanted or channel, path, required=wanted is not None)
        if place is not None:
            time, values, unit = place
            si = UNITS.get(channel)
            values = np.asarray(to_si(values, unit, si)) if si and unit else values
            found[channel], units[channel] = (time, values), si or unit
    demand_motion(found, str(path))
    clock = _even(found["position" if "position" in found else "rate"][0], str(path))
    data = {name: ("time", _onto(clock, *pair), {"units": units[name]}) for name, pair in found.items()}
    log = xr.Dataset(data, {"time": ("time", clock - clock[0], {"units": "s"})}, {"record": Path(path).stem})
    if not np.isfinite(log["command"].values).all():
        raise SchemaError(str(path), ["the command has gaps or does not cover the log; cut the log to where it is recorded"])
    return log


def demand_motion(channels, what: str) -> None:
    """Raise for a log without a command, or without a measured motion.

    Raises
    ------
    IdentificationError
        A log that cannot identify an actuator.
    """
    if "command" not in channels:
        raise IdentificationError(f"{what}: no recorded command; name its column (--command COLUMN)")
    if "position" not in channels and "rate" not in channels:
        raise IdentificationError(
            f"{what}: no recorded position or rate: a command alone contains no information about the actuator; record the position of "
            "its output and name its column (--position COLUMN)"
        )


def _even(time: np.ndarray, what: str) -> np.ndarray:
    """Return the stamps themselves where they are uniform, else even ones at their median rate."""
    steps = np.diff(time)
    if len(steps) < 8 or not (steps > 0.0).all():
        raise SchemaError(
            what, [f"{len(time)} samples, smallest step {steps.min() if len(steps) else 0.0:g} s; time must rise, 9 samples at least"]
        )
    step = float(np.median(steps))
    if np.ptp(steps) <= _UNEVEN * step:
        return time
    return np.linspace(time[0], time[-1], round((time[-1] - time[0]) / step) + 1)


def _onto(clock: np.ndarray, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return readings at the times of `clock`, NaN where none is near."""
    if len(time) == len(clock) and np.array_equal(time, clock):
        return values
    good = np.isfinite(values)
    if good.sum() < 2:
        return np.full(len(clock), np.nan)
    time, values = time[good], values[good]
    after = np.clip(np.searchsorted(time, clock), 1, len(time) - 1)
    hole = time[after] - time[after - 1] > _GAP * max(float(np.median(np.diff(time))), float(np.median(np.diff(clock))))
    return np.where(
        hole & (clock != time[after - 1]) & (clock != time[after]), np.nan, np.interp(clock, time, values, left=np.nan, right=np.nan)
    )
