"""Rates and accelerations of a body from its poses, and the flight record of it.

Position and quaternion are smoothed by a Fourier series up to a cut-off and differentiated
analytically: with a flapping wing the motion stands at the multiples of the flapping frequency, so
the cut-off is given as a multiple of it (7 to 10 [Grauer2010]).

References
----------
.. [Grauer2010] Grauer, Ulrich, Hubbard, Pines, Humbert, System identification of an ornithopter aerodynamics model, AIAA 2010-7632.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import numpy as np
import xarray as xr
from pydantic import Field, model_validator
from scipy.fft import dct, dst
from scipy.interpolate import CubicSpline

from flightmech.axes import euler_from_matrix, matrix_from_quaternion, quaternion_from_matrix
from flightmech.errors import IdentificationError, SchemaError
from flightmech.names import lookup
from flightmech.support.input_files import read_toml
from flightmech.support.toml_models import Strict, validate_content
from flightmech.support.toml_quantities import InUnits
from flightmech.units import to_si
from flighttest.records.readers.columns import locate_column
from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.opening import open_recording

_STEEPNESS = 20  # of the weights 1/(1 + (f/cutoff)^n)
_LEFT_OUT = 2.0  # periods of the cut-off at each end
_FEWEST = 16  # samples
_G = 9.80665
_END = 8  # samples of a parabola at each end


def smooth_motion(pose: xr.Dataset, cutoff: float) -> xr.Dataset:
    """Return the smoothed motion of a body with standard errors.

    Parameters
    ----------
    pose : Dataset (time,)
        As from `poses`, on a uniform clock; frames without a pose are bridged by a cubic, those in
        a hole longer than half a period of the cut-off are NaN in the result.
    cutoff : float
        Frequency up to which there is motion, such as 8 times the flapping frequency. [Hz]

    Returns
    -------
    Dataset (time,)
        ``north east h vn ve vd phi theta psi p q r p_dot q_dot r_dot ax ay az``, the last three
        specific force at the origin of the body along body axes; SI.  Each has its mean standard
        error as attribute ``stderr``, that of small pitch and bank for the angles.  Two periods of
        the cut-off are left out at both ends.

    Raises
    ------
    IdentificationError
        Too few frames, or a cut-off beyond half the frame rate.
    """
    time = pose["time"].values.astype(float)
    count, step = len(time), float((time[-1] - time[0]) / max(len(time) - 1, 1))
    good = np.isfinite(pose["r"].values).all(axis=1)
    if good.sum() < _FEWEST or np.ptp(np.diff(time)) > 1e-3 * step:
        raise IdentificationError(
            f"{int(good.sum())} frames with a pose of {count}; at least {_FEWEST} on a "
            f"uniform clock are needed"
        )
    if not 0.0 < cutoff < 0.5 / step:
        raise IdentificationError(
            f"cut-off {cutoff:g} Hz; it must lie between 0 and half the frame rate, "
            f"{0.5 / step:g} Hz"
        )
    (x, v, a), gains = _smooth(_bridged(time, pose["r"].values, good), step, cutoff)
    (quat, rate, bend), _ = _smooth(_bridged(time, pose["q"].values, good), step, cutoff)
    size = np.linalg.norm(quat, axis=1, keepdims=True)
    quat, rate, bend = quat / size, rate / size, bend / size
    omega, omega_dot = 2.0 * _product(quat, rate), 2.0 * _product(quat, bend)
    R = matrix_from_quaternion(quat)
    force = np.einsum("nij,nj->ni", R, a - [0.0, 0.0, _G])
    phi, theta, psi = euler_from_matrix(R)
    columns = dict(zip(("north", "east", "h"), (x * [1.0, 1.0, -1.0]).T)) | dict(
        zip(("vn", "ve", "vd"), v.T)
    )
    columns |= {"phi": phi, "theta": theta, "psi": np.unwrap(psi)}
    columns |= dict(
        zip(
            ("p", "q", "r", "p_dot", "q_dot", "r_dot", "ax", "ay", "az"),
            np.hstack([omega, omega_dot, force]).T,
        )
    )
    where, turn = (
        np.sqrt(np.nanmean(pose[name].values ** 2, axis=0)) for name in ("r_stderr", "turn_stderr")
    )
    of = [
        *zip((("north", "east", "h"), ("vn", "ve", "vd")), (gains[0] * where, gains[1] * where)),
        *zip(
            (("phi", "theta", "psi"), ("p", "q", "r"), ("p_dot", "q_dot", "r_dot")),
            np.outer(gains, turn),
        ),
        (
            ("ax", "ay", "az"),
            np.full(
                3,
                np.hypot(
                    gains[2] * np.sqrt(np.mean(where**2)), _G * gains[0] * np.sqrt(np.mean(turn**2))
                ),
            ),
        ),
    ]
    errors = {name: float(s) for names, values in of for name, s in zip(names, values)}
    lost = _holes(time, good, 0.5 / cutoff)
    found = xr.Dataset(
        {
            name: (
                "time",
                np.where(lost, np.nan, y),
                {"units": lookup(name).units, "stderr": errors[name]},
            )
            for name, y in columns.items()
        },
        {"time": ("time", time, {"units": "s"})},
        {"cutoff": cutoff, "noise": pose.attrs["noise"]},
    )
    ends = int(np.ceil(_LEFT_OUT / (cutoff * step)))
    return found.isel(time=slice(ends, count - ends))


def motion_record(bodies: dict[str, xr.Dataset], title: str) -> xr.DataTree:
    """Return the flight record of bodies, one leaf each, for `save_record`.

    Parameters
    ----------
    bodies : mapping of str to Dataset
        As from `smooth_motion`.
    title : str
    """
    leaves = {f"/{name}": data.assign_attrs(body=name) for name, data in bodies.items()}
    return xr.DataTree.from_dict(
        {
            "/": xr.Dataset(
                attrs={"title": title, "kind": "motion capture", "unmapped": "", "notes": ""}
            ),
            **leaves,
        }
    )


def _bridged(time: np.ndarray, x: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Return the columns with frames that are missing taken from a cubic through the others."""
    if good.all():
        return x

    inside = np.clip(time, time[good][0], time[good][-1])
    return np.where(good[:, None], x, CubicSpline(time[good], x[good])(inside))


def _holes(time: np.ndarray, good: np.ndarray, longest: float) -> np.ndarray:
    """Whether each frame lies in a hole longer than allowed."""
    before = np.maximum.accumulate(np.where(good, time, -np.inf))
    after = np.minimum.accumulate(np.where(good, time, np.inf)[::-1])[::-1]
    return ~good & (after - before > longest)


def _smooth(
    x: np.ndarray, step: float, cutoff: float
) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], np.ndarray]:
    """Return columns (time, column) smoothed, their first and second derivatives, and the gain of
    white noise of each.
    """

    last = len(x) - 1
    i = np.arange(last + 1)
    chord = _cubic(x, i, step)
    k = np.arange(1, last)
    omega = np.pi * k / (last * step)
    weight = 1.0 / (1.0 + (omega / (2.0 * np.pi * cutoff)) ** _STEEPNESS)
    b = weight[:, None] * dst((x - chord[0])[1:-1], type=1, axis=0) / last
    zero = np.zeros((1, x.shape[1]))
    waves = np.concatenate([zero, dst(b, type=1, axis=0) / 2.0, zero])
    turn = np.concatenate([zero, omega[:, None] * b, zero])
    bend = np.concatenate([zero, dst(-(omega[:, None] ** 2) * b, type=1, axis=0) / 2.0, zero])
    gains = np.sqrt([(weight**2 * omega ** (2 * order)).sum() / (last + 1) for order in range(3)])
    return (chord[0] + waves, chord[1] + dct(turn, type=1, axis=0) / 2.0, chord[2] + bend), gains


def _cubic(x: np.ndarray, i: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a cubic with the values and second derivatives of both ends, and its derivatives: the
    remainder suits a sine series.
    """
    reach = np.arange(min(_END, len(x)))
    first, end = (
        np.polyfit(reach * step, part, 2) for part in (x[: len(reach)], x[::-1][: len(reach)])
    )
    T, t = (len(x) - 1) * step, (i * step)[:, None]
    bend_0, bend_1 = 2.0 * first[0], 2.0 * end[0]
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


def _product(quat: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Return the vector part of conj(quat) rate: half of the rate about body axes, of a derivative
    of any order for a unit quaternion.
    """
    s, u, ds, du = quat[:, :1], quat[:, 1:], rate[:, :1], rate[:, 1:]
    return s * du - ds * u - np.cross(u, du)


_WAYS = {
    "north": (0, 1.0),
    "south": (0, -1.0),
    "east": (1, 1.0),
    "west": (1, -1.0),
    "down": (2, 1.0),
    "up": (2, -1.0),
}
_EVEN = 1e-3  # of the median step
Metres = Annotated[float, InUnits("m")]


class MarkerSetup(Strict):
    """Bodies with their markers, axes of the cameras, cut-off."""

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
        description="Where x, y and z of the cameras point to: north east down, their opposites.",
    )
    noise: Annotated[float, InUnits("m")] | None = Field(
        default=None, description="Standard deviation of a coordinate of a marker."
    )
    unit: str = Field(default="m", description="Unit of the positions, where the file states none.")

    @model_validator(mode="after")
    def _right_handed(self) -> MarkerSetup:
        words = self.axes.split()
        if (
            len(words) != 3
            or any(word not in _WAYS for word in words)
            or not np.isclose(np.linalg.det(self.turn), 1.0)
        ):
            raise ValueError(
                f"axes = {self.axes!r}: three directions of {', '.join(_WAYS)} that make a "
                f"right-handed frame are needed"
            )
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
    return validate_content(MarkerSetup, read_toml(path), str(path))


def read_markers(path: str | Path, setup: MarkerSetup) -> xr.DataArray:
    """Return the positions of all markers of the setup.

    Parameters
    ----------
    path : str or Path
        Recording with columns ``MARKER_x``, ``MARKER_y``, ``MARKER_z`` and time; empty cells where
        a marker was not seen.
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
            place = locate_column(recording, f"{name}_{axis}", path)
            assert place is not None  # required
            time = place[0]
            columns.append(np.asarray(to_si(place[1], place[2] or setup.unit, "m")))
    steps = np.diff(time)
    if len(steps) < 2 or not (steps > 0.0).all() or np.ptp(steps) > _EVEN * float(np.median(steps)):
        raise SchemaError(
            str(path),
            [
                "its frames are not evenly spaced in time; give one row per frame, with "
                "empty cells where nothing was seen"
            ],
        )
    positions = np.stack(columns, axis=1).reshape(len(time), len(names), 3) @ setup.turn.T
    return xr.DataArray(
        positions,
        {"time": time, "marker": names, "axis": ["north", "east", "down"]},
        ("time", "marker", "axis"),
    )


# second singular value of the marker positions over the first, below which they lie on a line
_FLAT = 1e-6


def poses(
    positions: xr.DataArray,
    markers: Mapping[str, tuple[float, float, float]],
    noise: float | None = None,
) -> xr.Dataset:
    """Return the pose of a body in every frame.

    Parameters
    ----------
    positions : DataArray (time, marker, axis)
        North, east, down of the markers; NaN where the cameras did not see one. [m]
    markers : mapping of str to (x, y, z)
        Where each marker sits in the body, x forward, y right, z down, from the point whose motion
        is wanted. [m]
    noise : float, optional
        Standard deviation of each coordinate of a marker; by default what the frames with more than
        three markers show. [m]

    Returns
    -------
    Dataset (time,)
        ``r (time, axis)`` [m], ``q (time, component)``, scalar first and without jumps of sign;
        ``r_stderr (time, axis)`` [m] and ``turn_stderr (time, axis)``, of a turn about body axes
        [rad]; ``seen (time,)``, markers; ``residual (time,)``, rms of a coordinate [m].  NaN in
        frames with fewer than three markers, or three on a line.  Attribute ``noise`` [m].

    Raises
    ------
    IdentificationError
        Fewer than three markers off a line, no frame that shows them, or no way to know the noise.
    """
    names = [name for name in map(str, positions["marker"].values) if name in markers]
    Q = np.array([markers[name] for name in names], float).reshape(-1, 3)
    if len(names) < 3 or not _spread(Q[None])[0]:
        raise IdentificationError(
            f"markers {', '.join(names) or 'none'} recorded; a body needs three that do not "
            f"lie on a line"
        )
    P = positions.sel(marker=names).transpose("time", "marker", "axis").values.astype(float)
    seen = np.isfinite(P).all(axis=2)
    weight = seen.astype(float)
    count = weight.sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        middle_q, middle_p = (
            weight @ Q / count[:, None],
            np.where(seen[:, :, None], P, 0.0).sum(axis=1) / count[:, None],
        )
    A = np.where(seen[:, :, None], Q[None] - middle_q[:, None], 0.0)
    good = (count >= 3) & _spread(A)
    if not good.any():
        raise IdentificationError(
            f"no frame shows three of the markers {', '.join(names)}; check their names and "
            f"the cameras"
        )
    D = np.where(seen[:, :, None], P - middle_p[:, None], 0.0)
    A, D, middle_q, middle_p = A[good], D[good], middle_q[good], middle_p[good]
    U, _, Vt = np.linalg.svd(np.einsum("nmi,nmj->nij", A, D))
    flip = np.linalg.det(U) * np.linalg.det(Vt)
    U[:, :, 2] *= flip[:, None]
    R = U @ Vt  # body = R ned
    r = middle_p - np.einsum("nji,nj->ni", R, middle_q)
    rest = np.where(seen[good][:, :, None], D - np.einsum("nji,nmj->nmi", R, A), 0.0)
    squares, freedom = (rest**2).sum(axis=(1, 2)), 3.0 * count[good] - 6.0
    if noise is None:
        if not freedom.sum() > 0.0:
            raise IdentificationError(
                "no frame shows more than three markers: nothing indicates their noise; give it"
            )
        noise = float(np.sqrt(squares.sum() / freedom.sum()))
    inertia = np.einsum("nmk,nmk->n", A, A)[:, None, None] * np.eye(3) - np.einsum(
        "nmi,nmj->nij", A, A
    )
    turn = noise**2 * np.linalg.inv(inertia)
    arm = _skew(middle_q)
    body = arm @ turn @ np.swapaxes(arm, 1, 2)
    where = noise**2 / count[good][:, None, None] * np.eye(3) + np.einsum(
        "nji,njk,nkl->nil", R, body, R
    )
    found = {
        "r": (("time", "axis"), r), "q": (("time", "component"), _continuous(quaternion_from_matrix(R))),
        "r_stderr": (("time", "axis"), np.sqrt(np.einsum("nii->ni", where))),
        "turn_stderr": (("time", "axis"), np.sqrt(np.einsum("nii->ni", turn))),
        "residual": ("time", np.sqrt(squares / (3.0 * count[good]))),
    }  # fmt: skip
    time = positions["time"].values
    part = xr.Dataset(
        found, {"time": time[good], "axis": ["north", "east", "down"]}, {"noise": noise}
    )
    return part.reindex(time=time).assign(seen=("time", count.astype(int)))


def _spread(A: np.ndarray) -> np.ndarray:
    """Whether the points of each frame (frame, point, 3) do not lie on a line."""
    singular = np.linalg.svd(
        A - A.mean(axis=1, keepdims=True) if len(A) == 1 else A, compute_uv=False
    )
    return singular[:, 1] > _FLAT * np.maximum(singular[:, 0], np.finfo(float).tiny)


def _skew(v: np.ndarray) -> np.ndarray:
    out = np.zeros((len(v), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return out - np.swapaxes(out, 1, 2)


def _continuous(q: np.ndarray) -> np.ndarray:
    """Quaternions of the sign that lies nearer to the one before."""
    turned = np.einsum("ni,ni->n", q[1:], q[:-1]) < 0.0
    return q * np.where(np.concatenate([[0], np.cumsum(turned)]) % 2, -1.0, 1.0)[:, None]
