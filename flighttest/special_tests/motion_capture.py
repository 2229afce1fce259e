"""Motion capture: marker setup and positions, and the smoothed motion of a body.

Position and quaternion are smoothed by a Fourier series up to a cut-off and differentiated
analytically. With a flapping wing the motion is at the multiples of the flapping frequency, so the
cut-off is given as a multiple of it (7 to 10 [Grauer2010]).

References
----------
.. [Grauer2010] Grauer, Ulrich, Hubbard, Pines, Humbert, System identification of an ornithopter
   aerodynamics model, AIAA 2010-7632.
"""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import xarray as xr
from pydantic import Field, model_validator
from scipy.fft import dct, dst
from scipy.interpolate import CubicSpline

from flightmech.axes import euler_from_matrix, matrix_from_quaternion
from flightmech.errors import IdentificationError, SchemaError
from flightmech.names import lookup
from flightmech.support.toml_files import read_toml
from flightmech.support.toml_models import Strict, validate_content
from flightmech.support.toml_quantities import InUnits
from flightmech.units import to_si
from flighttest.records.readers.columns import locate_column
from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.opening import open_recording

# Exponent n of the weights 1/(1 + (f/cutoff)^n).
_STEEPNESS = 20
# Periods of the cut-off that are omitted at each end.
_LEFT_OUT = 2.0
# Fewest frames with a pose.
_FEWEST = 16
# Acceleration of gravity [m s-2].
_G = 9.80665
# Samples of the parabola at each end.
_END = 8
# Largest range of the steps of the clock of a pose, as a share of the mean step, and of the clock
# of a recording, as a share of the median step.
_EVEN = 1e-3
# Row and sign of each direction in north, east, down.
_DIRECTIONS = {
    "north": (0, 1.0),
    "south": (0, -1.0),
    "east": (1, 1.0),
    "west": (1, -1.0),
    "down": (2, 1.0),
    "up": (2, -1.0),
}
_AXES = ["north", "east", "down"]
Metres = Annotated[float, InUnits("m")]


def smooth_motion(pose: xr.Dataset, cutoff: float) -> xr.Dataset:
    """Return the smoothed motion of a body with standard errors.

    Parameters
    ----------
    pose : Dataset (time,)
        As from `poses`, on a uniform clock.  Frames without a pose are interpolated by a cubic.  In
        a gap longer than half a period of the cut-off they are NaN in the result.
    cutoff : float
        Highest frequency of the motion, such as 8 times the flapping frequency. [Hz]

    Returns
    -------
    Dataset (time,)
        ``north east h vn ve vd phi theta psi p q r p_dot q_dot r_dot ax ay az``, the last three
        specific force at the origin of the body along body axes; SI.  Each has its mean standard
        error as attribute ``stderr``, for the angles at small pitch and bank.  Two periods of the
        cut-off are omitted at both ends.

    Raises
    ------
    IdentificationError
        There are too few frames, or the cut-off is above half the frame rate.
    """
    time = pose["time"].values.astype(float)
    count, step = len(time), float((time[-1] - time[0]) / max(len(time) - 1, 1))
    has_pose = np.isfinite(pose["r"].values).all(axis=1)
    if has_pose.sum() < _FEWEST or np.ptp(np.diff(time)) > _EVEN * step:
        raise IdentificationError(
            f"{int(has_pose.sum())} frames with a pose of {count}; at least {_FEWEST} on a "
            f"uniform clock are needed"
        )
    if not 0.0 < cutoff < 0.5 / step:
        raise IdentificationError(
            f"cut-off {cutoff:g} Hz; it must lie between 0 and half the frame rate, "
            f"{0.5 / step:g} Hz"
        )
    position = _smooth_columns(_fill_gaps(time, pose["r"].values, has_pose), step, cutoff)
    attitude = _smooth_columns(_fill_gaps(time, pose["q"].values, has_pose), step, cutoff)
    columns = _motion_columns(position, attitude)
    errors = _motion_errors(pose, position.gains)
    # A gap of more than half a period of the cut-off is not bridged.
    in_gap = _find_gaps(time, has_pose, 0.5 / cutoff)
    variables = {}
    for name, y in columns.items():
        attributes = {"units": lookup(name).units, "stderr": errors[name]}
        variables[name] = ("time", np.where(in_gap, np.nan, y), attributes)
    motion = xr.Dataset(
        variables,
        {"time": ("time", time, {"units": "s"})},
        {"cutoff": cutoff, "noise": pose.attrs["noise"]},
    )
    # The filter has no full support at both ends.
    ends = int(np.ceil(_LEFT_OUT / (cutoff * step)))
    return motion.isel(time=slice(ends, count - ends))


class _Smoothed(NamedTuple):
    """Columns (time, column), their first and second derivatives, and gains of white noise."""

    value: np.ndarray
    slope: np.ndarray
    bend: np.ndarray
    gains: np.ndarray


def _motion_columns(position: _Smoothed, attitude: _Smoothed) -> dict[str, np.ndarray]:
    """Return position, velocity, attitude, rates, accelerations and specific force by name."""
    # a smoothed quaternion has no unit length
    size = np.linalg.norm(attitude.value, axis=1, keepdims=True)
    q, rate, bend = attitude.value / size, attitude.slope / size, attitude.bend / size
    omega, omega_dot = 2.0 * _vector_product(q, rate), 2.0 * _vector_product(q, bend)
    R = matrix_from_quaternion(q)
    # specific force is acceleration less gravity
    force = np.einsum("nij,nj->ni", R, position.bend - [0.0, 0.0, _G])
    phi, theta, psi = euler_from_matrix(R)
    triples = {
        ("north", "east", "h"): position.value * [1.0, 1.0, -1.0],
        ("vn", "ve", "vd"): position.slope,
        ("phi", "theta", "psi"): np.stack([phi, theta, np.unwrap(psi)], axis=1),
        ("p", "q", "r"): omega,
        ("p_dot", "q_dot", "r_dot"): omega_dot,
        ("ax", "ay", "az"): force,
    }
    columns: dict[str, np.ndarray] = {}
    for names, values in triples.items():
        columns.update(zip(names, values.T, strict=True))
    return columns


def _motion_errors(pose: xr.Dataset, gains: np.ndarray) -> dict[str, float]:
    """Return the mean standard error of each column of a motion."""
    position = np.sqrt(np.nanmean(pose["r_stderr"].values ** 2, axis=0))
    turn = np.sqrt(np.nanmean(pose["turn_stderr"].values ** 2, axis=0))
    # errors of the specific force: acceleration, and gravity along axes with an attitude error
    acceleration = gains[2] * np.sqrt(np.mean(position**2))
    gravity = _G * gains[0] * np.sqrt(np.mean(turn**2))
    triples = {
        ("north", "east", "h"): gains[0] * position,
        ("vn", "ve", "vd"): gains[1] * position,
        ("phi", "theta", "psi"): gains[0] * turn,
        ("p", "q", "r"): gains[1] * turn,
        ("p_dot", "q_dot", "r_dot"): gains[2] * turn,
        ("ax", "ay", "az"): np.full(3, np.hypot(acceleration, gravity)),
    }
    errors: dict[str, float] = {}
    for names, values in triples.items():
        errors.update(zip(names, map(float, values), strict=True))
    return errors


def motion_record(bodies: dict[str, xr.Dataset], title: str) -> xr.DataTree:
    """Return the flight record of bodies, one leaf each, for `save_record`.

    Parameters
    ----------
    bodies : mapping of str to Dataset
        As from `smooth_motion`.
    title : str
    """
    attributes = {"title": title, "kind": "motion capture", "unmapped": "", "notes": ""}
    nodes = {"/": xr.Dataset(attrs=attributes)}
    for name, data in bodies.items():
        nodes[f"/{name}"] = data.assign_attrs(body=name)
    return xr.DataTree.from_dict(nodes)


def _fill_gaps(time: np.ndarray, x: np.ndarray, has_pose: np.ndarray) -> np.ndarray:
    """Return the columns with missing frames interpolated by a cubic."""
    if has_pose.all():
        return x
    # before the first pose and after the last, the pose is constant
    inside = np.clip(time, time[has_pose][0], time[has_pose][-1])
    return np.where(has_pose[:, None], x, CubicSpline(time[has_pose], x[has_pose])(inside))


def _find_gaps(time: np.ndarray, has_pose: np.ndarray, longest: float) -> np.ndarray:
    """Return whether each frame is in a gap that is too long."""
    # times of the last pose before and of the first pose after each frame
    previous = np.maximum.accumulate(np.where(has_pose, time, -np.inf))
    following = np.minimum.accumulate(np.where(has_pose, time, np.inf)[::-1])[::-1]
    return ~has_pose & (following - previous > longest)


def _smooth_columns(x: np.ndarray, step: float, cutoff: float) -> _Smoothed:
    """Return smoothed columns (time, column) with their derivatives and gains."""
    last = len(x) - 1
    i = np.arange(last + 1)
    # a cubic takes the ends, the remainder is a sine series without jumps
    cubic, cubic_slope, cubic_bend = _end_cubic(x, i, step)
    k = np.arange(1, last)
    omega = np.pi * k / (last * step)
    weight = 1.0 / (1.0 + (omega / (2.0 * np.pi * cutoff)) ** _STEEPNESS)
    b = weight[:, None] * dst((x - cubic)[1:-1], type=1, axis=0) / last
    zero = np.zeros((1, x.shape[1]))
    # sine series, and its derivatives as a cosine and a sine series
    waves = np.concatenate([zero, dst(b, type=1, axis=0) / 2.0, zero])
    slope = np.concatenate([zero, omega[:, None] * b, zero])
    bend = np.concatenate([zero, dst(-(omega[:, None] ** 2) * b, type=1, axis=0) / 2.0, zero])
    # standard deviation of filtered white noise, of derivatives 0 to 2
    gains = np.sqrt([(weight**2 * omega ** (2 * order)).sum() / (last + 1) for order in range(3)])
    return _Smoothed(
        cubic + waves,
        cubic_slope + dct(slope, type=1, axis=0) / 2.0,
        bend=cubic_bend + bend,
        gains=gains,
    )


def _end_cubic(
    x: np.ndarray, i: np.ndarray, step: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a cubic through both ends of each column, with its derivatives.

    It has the values and second derivatives of parabolas through the samples at the ends. The
    remainder is then zero with zero curvature at both ends, as a sine series is.
    """
    count = min(_END, len(x))
    t_end = np.arange(count) * step
    # Parabolas through the samples at both ends, in time from the respective end.
    first, end = np.polyfit(t_end, x[:count], 2), np.polyfit(t_end, x[::-1][:count], 2)
    T, t = (len(x) - 1) * step, (i * step)[:, None]
    bend_0, bend_1 = 2.0 * first[0], 2.0 * end[0]
    # A straight line between the end values, plus cubics that are zero at both ends and have the
    # second derivative bend_0 at one end and bend_1 at the other.
    value = first[2] * (1.0 - t / T) + end[2] * t / T
    value = (
        value
        + ((1.0 - t / T) ** 3 - (1.0 - t / T)) * T**2 / 6.0 * bend_0
        + ((t / T) ** 3 - t / T) * T**2 / 6.0 * bend_1
    )
    slope = (
        (end[2] - first[2]) / T
        + (1.0 - 3.0 * (1.0 - t / T) ** 2) * T / 6.0 * bend_0
        + (3.0 * (t / T) ** 2 - 1.0) * T / 6.0 * bend_1
    )
    return value, slope, (1.0 - t / T) * bend_0 + t / T * bend_1


def _vector_product(quat: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Return the vector part of conj(quat) rate.

    For a unit quaternion it is half of the rate about body axes, or of a derivative of the rate.
    """
    s, u, ds, du = quat[:, :1], quat[:, 1:], rate[:, :1], rate[:, 1:]
    return s * du - ds * u - np.cross(u, du)


class MarkerSetup(Strict):
    """Bodies with their markers, axes of the cameras and cut-off."""

    body: dict[str, dict[str, tuple[Metres, Metres, Metres]]] = Field(
        min_length=1, description="Markers of each body in body axes, x forward, y right, z down."
    )
    flapping_frequency: Annotated[float, InUnits("Hz")] = Field(
        gt=0.0, description="Frequency of the periodic motion."
    )
    multiples: float = Field(
        default=8.0, gt=0.0, description="Cut-off of the smoothing over the flapping frequency."
    )
    axes: str = Field(
        default="north east down",
        description="Directions of x, y and z of the cameras: north east down, or opposites.",
    )
    noise: Annotated[float, InUnits("m")] | None = Field(
        default=None, description="Standard deviation of a coordinate of a marker."
    )
    unit: str = Field(default="m", description="Unit of the positions, if the file has none.")

    @model_validator(mode="after")
    def _check_axes(self) -> MarkerSetup:
        directions = self.axes.split()
        is_valid = len(directions) == 3 and set(directions) <= set(_DIRECTIONS)
        # a left-handed frame has the determinant -1, two equal directions have 0
        if not is_valid or not np.isclose(np.linalg.det(self.turn), 1.0):
            raise ValueError(
                f"axes = {self.axes!r}: three directions of {', '.join(_DIRECTIONS)} that make a "
                f"right-handed frame are needed"
            )
        return self

    @property
    def turn(self) -> np.ndarray:
        """Matrix from the axes of the cameras to north, east, down."""
        matrix = np.zeros((3, 3))
        for column, direction in enumerate(self.axes.split()):
            row, sign = _DIRECTIONS[direction]
            matrix[row, column] = sign
        return matrix

    @property
    def cutoff(self) -> float:
        """Cut-off of the smoothing. [Hz]"""
        return self.multiples * self.flapping_frequency


def read_marker_setup(path: str | Path) -> MarkerSetup:
    """Return the setup of a TOML file.

    Raises
    ------
    ParseError
        The file is not TOML.
    SchemaError
        All faults of the keys.
    """
    return validate_content(MarkerSetup, read_toml(path), str(path))


def read_markers(path: str | Path, setup: MarkerSetup) -> xr.DataArray:
    """Return the positions of all markers of the setup.

    Parameters
    ----------
    path : str or Path
        Recording with columns ``MARKER_x``, ``MARKER_y``, ``MARKER_z`` and time; empty cells if a
        marker is not seen.
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
        The frames are not evenly spaced.
    """
    recording = open_recording(path, NameMap({}))
    names = list(chain.from_iterable(setup.body.values()))
    columns, time = [], np.empty(0)
    for name in names:
        for axis in "xyz":
            column = locate_column(recording, f"{name}_{axis}", path)
            # a required column that is missing raises
            assert column is not None
            time, values, unit = column
            columns.append(np.asarray(to_si(values, unit or setup.unit, "m")))
    steps = np.diff(time)
    if len(steps) < 2 or not (steps > 0.0).all() or np.ptp(steps) > _EVEN * float(np.median(steps)):
        problem = (
            "its frames are not evenly spaced in time; give one row per frame, with empty cells "
            "where nothing was seen"
        )
        raise SchemaError(str(path), [problem])
    positions = np.stack(columns, axis=1).reshape(len(time), len(names), 3) @ setup.turn.T
    return xr.DataArray(
        positions,
        {"time": time, "marker": names, "axis": _AXES},
        ("time", "marker", "axis"),
    )
