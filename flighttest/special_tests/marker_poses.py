"""Pose of a rigid body in every frame from the positions of its markers."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from flightmech.axes import quaternion_from_matrix
from flightmech.errors import IdentificationError

# Second singular value of the marker positions over the first, below which they are on a line.
_FLAT = 1e-6
_AXES = ["north", "east", "down"]


def poses(
    positions: xr.DataArray,
    markers: Mapping[str, tuple[float, float, float]],
    noise: float | None = None,
) -> xr.Dataset:
    """Return the pose of a body in every frame.

    Parameters
    ----------
    positions : DataArray (time, marker, axis)
        North, east, down of the markers; NaN if the cameras do not see a marker. [m]
    markers : mapping of str to (x, y, z)
        Position of each marker in body axes, from the point whose motion is returned. [m]
    noise : float, optional
        Standard deviation of a coordinate; by default from frames with more than 3 markers. [m]

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
        Fewer than three markers off a line, in all or in every frame, or an unknown noise.
    """
    names = [name for name in map(str, positions["marker"].values) if name in markers]
    Q = np.array([markers[name] for name in names], float).reshape(-1, 3)
    _check_markers(names, Q)
    P = positions.sel(marker=names).transpose("time", "marker", "axis").values.astype(float)
    seen = np.isfinite(P).all(axis=2)
    is_seen = seen[:, :, None]
    count = seen.sum(axis=1).astype(float)
    # Positions about the centre of the seen markers, in body axes (A) and of the cameras (D).
    A, D, middle_q, middle_p = _subtract_centres(Q, P, seen=seen, count=count)
    # Three markers off one line determine an attitude.
    usable = (count >= 3) & _is_off_line(A)
    _check_frames(usable, names)
    is_seen, count_used = is_seen[usable], count[usable]
    A, D, middle_q, middle_p = A[usable], D[usable], middle_q[usable], middle_p[usable]
    R = _best_rotation(A, D)
    # Origin of the body: centre of the markers less its turned position in the body.
    r = middle_p - np.einsum("nji,nj->ni", R, middle_q)
    residual = np.where(is_seen, D - np.einsum("nji,nmj->nmi", R, A), 0.0)
    squares = (residual**2).sum(axis=(1, 2))
    if noise is None:
        noise = _estimate_noise(squares, count_used)
    place_covariance, turn_covariance = _pose_covariances(
        A, R, middle_q, count=count_used, noise=noise
    )
    variables = {
        "r": (("time", "axis"), r),
        "q": (("time", "component"), _continue_signs(quaternion_from_matrix(R))),
        "r_stderr": (("time", "axis"), np.sqrt(np.einsum("nii->ni", place_covariance))),
        "turn_stderr": (("time", "axis"), np.sqrt(np.einsum("nii->ni", turn_covariance))),
        "residual": ("time", np.sqrt(squares / (3.0 * count_used))),
    }
    time = positions["time"].values
    frames = xr.Dataset(variables, {"time": time[usable], "axis": _AXES}, {"noise": noise})
    return frames.reindex(time=time).assign(seen=("time", count.astype(int)))


def _check_markers(names: list[str], Q: np.ndarray) -> None:
    """Raise IdentificationError if the markers at Q (marker, 3) do not determine a pose."""
    if len(names) < 3 or not _is_off_line((Q - Q.mean(axis=0, keepdims=True))[None])[0]:
        raise IdentificationError(
            f"markers {', '.join(names) or 'none'} recorded; a body needs three that do not "
            f"lie on a line"
        )


def _subtract_centres(
    Q: np.ndarray, P: np.ndarray, *, seen: np.ndarray, count: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return visible markers from their centre, in the body and in space, and both centres."""
    is_seen = seen[:, :, None]
    # frames without a marker have no centre
    with np.errstate(invalid="ignore", divide="ignore"):
        middle_q = seen.astype(float) @ Q / count[:, None]
        middle_p = np.where(is_seen, P, 0.0).sum(axis=1) / count[:, None]
    A = np.where(is_seen, Q[None] - middle_q[:, None], 0.0)
    D = np.where(is_seen, P - middle_p[:, None], 0.0)
    return A, D, middle_q, middle_p


def _check_frames(usable: np.ndarray, names: list[str]) -> None:
    """Raise IdentificationError if no frame (frame,) determines a pose."""
    if not usable.any():
        raise IdentificationError(
            f"no frame shows three of the markers {', '.join(names)}; check names and cameras"
        )


def _best_rotation(A: np.ndarray, D: np.ndarray) -> np.ndarray:
    """Return the matrices from north, east, down to the body, by least squares of the markers.

    A and D are markers from their centre, in body axes and in space, (frame, marker, 3).
    """
    U, _, Vt = np.linalg.svd(np.einsum("nmi,nmj->nij", A, D))
    # a reflection is turned into the nearest rotation
    flip = np.linalg.det(U) * np.linalg.det(Vt)
    U[:, :, 2] *= flip[:, None]
    return U @ Vt


def _estimate_noise(squares: np.ndarray, count: np.ndarray) -> float:
    """Return the standard deviation of a coordinate from the residuals of all frames. [m]"""
    # a pose takes six degrees of freedom of each frame
    freedom = 3.0 * count - 6.0
    if not freedom.sum() > 0.0:
        raise IdentificationError(
            "no frame shows more than three markers: nothing indicates their noise; give it"
        )
    return float(np.sqrt(squares.sum() / freedom.sum()))


def _pose_covariances(
    A: np.ndarray, R: np.ndarray, middle: np.ndarray, *, count: np.ndarray, noise: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return covariances (frame, 3, 3) of the position [m2] and of a turn about body axes
    [rad2].
    """
    # the information on a turn is the inertia of unit masses at the markers
    squares = np.einsum("nmk,nmk->n", A, A)[:, None, None] * np.eye(3)
    turn = noise**2 * np.linalg.inv(squares - np.einsum("nmi,nmj->nij", A, A))
    # the origin moves with the centre of the markers, and with a turn about this centre
    arm = cross_matrices(middle)
    body = arm @ turn @ np.swapaxes(arm, 1, 2)
    centre = noise**2 / count[:, None, None] * np.eye(3)
    return centre + np.einsum("nji,njk,nkl->nil", R, body, R), turn


def _is_off_line(A: np.ndarray) -> np.ndarray:
    """Return whether the points of each frame (frame, point, 3) do not lie on a line.

    The points count from their centre.
    """
    singular = np.linalg.svd(A, compute_uv=False)
    return singular[:, 1] > _FLAT * np.maximum(singular[:, 0], np.finfo(float).tiny)


def cross_matrices(v: np.ndarray) -> np.ndarray:
    """Return the matrices (frame, 3, 3) of the cross product."""
    out = np.zeros((len(v), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return out - np.swapaxes(out, 1, 2)


def _continue_signs(q: np.ndarray) -> np.ndarray:
    """Return quaternions with the sign that is nearer to the quaternion before."""
    changes = np.einsum("ni,ni->n", q[1:], q[:-1]) < 0.0
    is_reversed = np.concatenate([[0], np.cumsum(changes)]) % 2
    return q * np.where(is_reversed, -1.0, 1.0)[:, None]
