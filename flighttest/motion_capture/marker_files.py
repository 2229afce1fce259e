"""Markers of bodies and how the cameras see them, as a TOML file, and recordings of their positions.

flapping_frequency = "5 Hz"
multiples = 8                                # cut-off over the flapping frequency
axes = "north east down"                     # of the cameras: x y z point to
noise = "0.5 mm"                             # of a coordinate; without it what the frames show

[body.fuselage]                              # x forward, y right, z down from the point whose motion is wanted
nose = ["0.20 m", "0 m", "0 m"]
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr
from pydantic import Field, model_validator

from flightmech.errors import SchemaError
from flightmech.support.configuration import Strict, si, validate
from flightmech.support.toml_files.content import load
from flightmech.units import to_si

from ..readers.name_map import NameMap
from ..readers.opening import open_recording
from ..readers.own_columns import located

_WAYS = {"north": (0, 1.0), "south": (0, -1.0), "east": (1, 1.0), "west": (1, -1.0), "down": (2, 1.0), "up": (2, -1.0)}
_EVEN = 1e-3  # of the median step
Metres = si("m")


class MarkerSetup(Strict):
    """Bodies with their markers, axes of the cameras, cut-off."""

    body: dict[str, dict[str, tuple[Metres, Metres, Metres]]] = Field(  # type: ignore[valid-type]
        min_length=1, description="Markers of each body in body axes, x forward, y right, z down."
    )
    flapping_frequency: si("Hz") = Field(gt=0.0, description="Frequency of the periodic motion.")  # type: ignore[valid-type]
    multiples: float = Field(default=8.0, gt=0.0, description="Cut-off of the smoothing over the flapping frequency.")
    axes: str = Field(default="north east down", description="Where x, y and z of the cameras point to: north east down, their opposites.")
    noise: si("m") | None = Field(default=None, description="Standard deviation of a coordinate of a marker.")  # type: ignore[valid-type]
    unit: str = Field(default="m", description="Unit of the positions, where the file states none.")

    @model_validator(mode="after")
    def _right_handed(self) -> MarkerSetup:
        words = self.axes.split()
        if len(words) != 3 or any(word not in _WAYS for word in words) or not np.isclose(np.linalg.det(self.turn), 1.0):
            raise ValueError(f"axes = {self.axes!r}: three directions of {', '.join(_WAYS)} that make a right-handed frame are needed")
        return self

    @property
    def turn(self) -> np.ndarray:
        """Matrix from the axes of the cameras to north, east, down."""
        found = np.zeros((3, 3))
        for column, word in enumerate(self.axes.split()):
            row, sign = _WAYS[word]
            found[row, column] = sign
        return found

    @property
    def cutoff(self) -> float:
        """Cut-off of the smoothing. [Hz]"""
        return self.multiples * self.flapping_frequency


def read_marker_setup(path: str | Path) -> MarkerSetup:
    """Return the setup of a TOML file.

    Raises
    ------
    ParseError
        The text is not TOML.
    SchemaError
        With all faults of the keys.
    """
    return validate(MarkerSetup, load(path), str(path))


def read_markers(path: str | Path, setup: MarkerSetup) -> xr.DataArray:
    """Return the positions of all markers of the setup.

    Parameters
    ----------
    path : str or Path
        Recording with columns ``MARKER_x``, ``MARKER_y``, ``MARKER_z`` and time; empty cells where a marker was not seen.
    setup : MarkerSetup

    Returns
    -------
    DataArray (time, marker, axis)
        North, east, down [m].

    Raises
    ------
    UnknownName
        A column of a marker is missing.
    SchemaError
        Frames that are not evenly spaced.
    """
    recording = open_recording(path, NameMap({}))
    names = [name for markers in setup.body.values() for name in markers]
    columns, time = [], np.empty(0)
    for name in names:
        for axis in "xyz":
            place = located(recording, f"{name}_{axis}", path)
            assert place is not None  # required
            time = place[0]
            columns.append(np.asarray(to_si(place[1], place[2] or setup.unit, "m")))
    steps = np.diff(time)
    if len(steps) < 2 or not (steps > 0.0).all() or np.ptp(steps) > _EVEN * float(np.median(steps)):
        raise SchemaError(
            str(path), ["its frames are not evenly spaced in time; give one row per frame, with empty cells where nothing was seen"]
        )
    positions = np.stack(columns, axis=1).reshape(len(time), len(names), 3) @ setup.turn.T
    return xr.DataArray(positions, {"time": time, "marker": names, "axis": ["north", "east", "down"]}, ("time", "marker", "axis"))
