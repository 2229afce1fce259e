"""Rates and accelerations of a body from its poses, and the flight record of it.

Position and quaternion are smoothed by a Fourier series up to a cut-off and differentiated analytically: with a flapping wing the motion
stands at the multiples of the flapping frequency, so the cut-off is given as a multiple of it (7 to 10 [Grauer2010]).

References
----------
.. [Grauer2010] Grauer, Ulrich, Hubbard, Pines, Humbert, System identification of an ornithopter aerodynamics model, AIAA 2010-7632.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from flightmech.axes import euler, matrix
from flightmech.errors import IdentificationError
from flightmech.names import lookup

_STEEPNESS = 20  # of the weights 1/(1 + (f/cutoff)^n)
_LEFT_OUT = 2.0  # periods of the cut-off at each end
_FEWEST = 16  # samples
_G = 9.80665
_END = 8  # samples of a parabola at each end


def motion(pose: xr.Dataset, cutoff: float) -> xr.Dataset:
    """Return the smoothed motion of a body with standard errors.

    Parameters
    ----------
    pose : Dataset (time,)
        As from `poses`, on a uniform clock; frames without a pose are bridged by a cubic, those in a hole longer than half a period of
        the cut-off are NaN in the result.
    cutoff : float
        Frequency up to which there is motion, such as 8 times the flapping frequency. [Hz]

    Returns
    -------
    Dataset (time,)
        ``north east h vn ve vd phi theta psi p q r p_dot q_dot r_dot ax ay az``, the last three specific force at the origin of the body
        along body axes; SI.  Each has its mean standard error as attribute ``stderr``, that of small pitch and bank for the angles.  Two
        periods of the cut-off are left out at both ends.

    Raises
    ------
    IdentificationError
        Too few frames, or a cut-off beyond half the frame rate.
    """
    time = pose["time"].values.astype(float)
    count, step = len(time), float((time[-1] - time[0]) / max(len(time) - 1, 1))
    good = np.isfinite(pose["r"].values).all(axis=1)
    if good.sum() < _FEWEST or np.ptp(np.diff(time)) > 1e-3 * step:
        raise IdentificationError(f"{int(good.sum())} frames with a pose of {count}; at least {_FEWEST} on a uniform clock are needed")
    if not 0.0 < cutoff < 0.5 / step:
        raise IdentificationError(f"cut-off {cutoff:g} Hz; it must lie between 0 and half the frame rate, {0.5 / step:g} Hz")
    (x, v, a), gains = _smooth(_bridged(time, pose["r"].values, good), step, cutoff)
    (quat, rate, bend), _ = _smooth(_bridged(time, pose["q"].values, good), step, cutoff)
    size = np.linalg.norm(quat, axis=1, keepdims=True)
    quat, rate, bend = quat / size, rate / size, bend / size
    omega, omega_dot = 2.0 * _product(quat, rate), 2.0 * _product(quat, bend)
    R = matrix(quat)
    force = np.einsum("nij,nj->ni", R, a - [0.0, 0.0, _G])
    phi, theta, psi = euler(R)
    columns = dict(zip(("north", "east", "h"), (x * [1.0, 1.0, -1.0]).T)) | dict(zip(("vn", "ve", "vd"), v.T))
    columns |= {"phi": phi, "theta": theta, "psi": np.unwrap(psi)}
    columns |= dict(zip(("p", "q", "r", "p_dot", "q_dot", "r_dot", "ax", "ay", "az"), np.hstack([omega, omega_dot, force]).T))
    where, turn = (np.sqrt(np.nanmean(pose[name].values ** 2, axis=0)) for name in ("r_stderr", "turn_stderr"))
    of = [
        *zip((("north", "east", "h"), ("vn", "ve", "vd")), (gains[0] * where, gains[1] * where)),
        *zip((("phi", "theta", "psi"), ("p", "q", "r"), ("p_dot", "q_dot", "r_dot")), np.outer(gains, turn)),
        (("ax", "ay", "az"), np.full(3, np.hypot(gains[2] * np.sqrt(np.mean(where**2)), _G * gains[0] * np.sqrt(np.mean(turn**2))))),
    ]
    errors = {name: float(s) for names, values in of for name, s in zip(names, values)}
    lost = _holes(time, good, 0.5 / cutoff)
    found = xr.Dataset(
        {name: ("time", np.where(lost, np.nan, y), {"units": lookup(name).units, "stderr": errors[name]}) for name, y in columns.items()},
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
        As from `motion`.
    title : str
    """
    leaves = {f"/{name}": data.assign_attrs(body=name) for name, data in bodies.items()}
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs={"title": title, "kind": "motion capture", "unmapped": "", "notes": ""}), **leaves})


def _bridged(time: np.ndarray, x: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Return the columns with frames that are missing taken from a cubic through the others."""
    if good.all():
        return x
    from scipy.interpolate import CubicSpline

    inside = np.clip(time, time[good][0], time[good][-1])
    return np.where(good[:, None], x, CubicSpline(time[good], x[good])(inside))


def _holes(time: np.ndarray, good: np.ndarray, longest: float) -> np.ndarray:
    """Whether each frame lies in a hole longer than allowed."""
    before = np.maximum.accumulate(np.where(good, time, -np.inf))
    after = np.minimum.accumulate(np.where(good, time, np.inf)[::-1])[::-1]
    return ~good & (after - before > longest)


def _smooth(x: np.ndarray, step: float, cutoff: float) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], np.ndarray]:
    """Return columns (time, column) smoothed, their first and second derivatives, and the gain of white noise of each."""
    from scipy.fft import dct, dst

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
    """Return a cubic with the values and second derivatives of both ends, and its derivatives: the remainder suits a sine series."""
    reach = np.arange(min(_END, len(x)))
    first, end = (np.polyfit(reach * step, part, 2) for part in (x[: len(reach)], x[::-1][: len(reach)]))
    T, t = (len(x) - 1) * step, (i * step)[:, None]
    bend_0, bend_1 = 2.0 * first[0], 2.0 * end[0]
    value = first[2] * (1.0 - t / T) + end[2] * t / T
    value = value + ((1.0 - t / T) ** 3 - (1.0 - t / T)) * T**2 / 6.0 * bend_0 + ((t / T) ** 3 - t / T) * T**2 / 6.0 * bend_1
    slope = (end[2] - first[2]) / T + (1.0 - 3.0 * (1.0 - t / T) ** 2) * T / 6.0 * bend_0 + (3.0 * (t / T) ** 2 - 1.0) * T / 6.0 * bend_1
    return value, slope, (1.0 - t / T) * bend_0 + t / T * bend_1


def _product(quat: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Return the vector part of conj(quat) rate: half of the rate about body axes, of a derivative of any order for a unit quaternion."""
    s, u, ds, du = quat[:, :1], quat[:, 1:], rate[:, :1], rate[:, 1:]
    return s * du - ds * u - np.cross(u, du)
