"""Recordings of a vehicle of several bodies: markers, and commands of its actuators."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError
from flightmech.units import to_si

from ..motion_capture.marker_files import read_markers
from ..readers.name_map import NameMap
from ..readers.opening import open_recording
from ..readers.own_columns import located
from .vehicle import Vehicle


def read_flight(path: str | Path, vehicle: Vehicle) -> tuple[xr.DataArray, xr.Dataset]:
    """Return the positions of the markers, and the commands of the actuators (time,).

    Parameters
    ----------
    path : str or Path
        Recording with columns as `read_markers` needs them, and one per command, in SI or with its unit.
    vehicle : Vehicle

    Raises
    ------
    UnknownName
        A column of a marker or of a command is missing.
    SchemaError
        Frames that are not evenly spaced, or a command that begins later or ends earlier than they.
    """
    positions = read_markers(path, vehicle.markers)
    time = positions["time"].values
    recording = open_recording(path, NameMap({}))
    commands: dict[str, np.ndarray] = {}
    for name in sorted({drive.command for drive in vehicle.actuator.values() if drive.command}):
        place = located(recording, name, path)
        assert place is not None  # required
        stamps, values = place[0], np.asarray(to_si(place[1], place[2])) if place[2] else place[1]
        good = np.isfinite(values)
        if not good.any() or stamps[good][0] > time[0] or stamps[good][-1] < time[-1]:
            raise SchemaError(str(path), [f"{name} does not cover the frames, {time[0]:g} to {time[-1]:g} s"])
        commands[name] = np.interp(time, stamps[good], values[good])
    return positions, xr.Dataset({name: ("time", values) for name, values in commands.items()}, {"time": time})
