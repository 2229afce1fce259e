"""Pose of a rigid body from the positions of its markers, frame by frame: least squares over rotation and translation.

    min over R, r of sum |p_i - r - R' q_i|^2

with p_i the marker in north-east-down and q_i where it sits in body axes.  The rotation follows from the singular values of
sum (q_i - q_mean)(p_i - p_mean)' [Kabsch1976], [Umeyama1991].  With noise of variance s^2 in each coordinate, a small turn about body axes
has the covariance s^2 [sum (|a_i|^2 E - a_i a_i')]^-1, a_i = q_i - q_mean, and the mean of the n markers s^2/n.

References
----------
.. [Kabsch1976] Kabsch, A solution for the best rotation to relate two sets of vectors, Acta Cryst. A32, 1976.
.. [Umeyama1991] Umeyama, Least-squares estimation of transformation parameters between two point patterns, IEEE PAMI 13, 1991.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from flightmech.axes import quaternion
from flightmech.errors import IdentificationError

_FLAT = 1e-6  # second singular value of the marker positions over the first, below which they lie on a line


def poses(positions: xr.DataArray, markers: Mapping[str, tuple[float, float, float]], noise: float | None = None) -> xr.Dataset:
    """Return the pose of a body in every frame.

    Parameters
    ----------
    positions : DataArray (time, marker, axis)
        North, east, down of the markers; NaN where the cameras did not see one. [m]
    markers : mapping of str to (x, y, z)
        Where each marker sits in the body, x forward, y right, z down, from the point whose motion is wanted. [m]
    noise : float, optional
        Standard deviation of each coordinate of a marker; by default what the frames with more than three markers show. [m]

    Returns
    -------
    Dataset (time,)
        ``r (time, axis)`` [m], ``q (time, component)``, scalar first and without jumps of sign; ``r_stderr (time, axis)`` [m] and
        ``turn_stderr (time, axis)``, of a turn about body axes [rad]; ``seen (time,)``, markers; ``residual (time,)``, rms of a
        coordinate [m].  NaN in frames with fewer than three markers, or three on a line.  Attribute ``noise`` [m].

    Raises
    ------
    IdentificationError
        Fewer than three markers off a line, no frame that shows them, or no way to know the noise.
    """
    names = [name for name in map(str, positions["marker"].values) if name in markers]
    Q = np.array([markers[name] for name in names], float).reshape(-1, 3)
    if len(names) < 3 or not _spread(Q[None])[0]:
        raise IdentificationError(f"markers {', '.join(names) or 'none'} recorded; a body needs three that do not lie on a line")
    P = positions.sel(marker=names).transpose("time", "marker", "axis").values.astype(float)
    seen = np.isfinite(P).all(axis=2)
    weight = seen.astype(float)
    count = weight.sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        middle_q, middle_p = weight @ Q / count[:, None], np.where(seen[:, :, None], P, 0.0).sum(axis=1) / count[:, None]
    A = np.where(seen[:, :, None], Q[None] - middle_q[:, None], 0.0)
    good = (count >= 3) & _spread(A)
    if not good.any():
        raise IdentificationError(f"no frame shows three of the markers {', '.join(names)}; check their names and the cameras")
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
            raise IdentificationError("no frame shows more than three markers: nothing indicates their noise; give it")
        noise = float(np.sqrt(squares.sum() / freedom.sum()))
    inertia = np.einsum("nmk,nmk->n", A, A)[:, None, None] * np.eye(3) - np.einsum("nmi,nmj->nij", A, A)
    turn = noise**2 * np.linalg.inv(inertia)
    arm = _skew(middle_q)
    body = arm @ turn @ np.swapaxes(arm, 1, 2)
    where = noise**2 / count[good][:, None, None] * np.eye(3) + np.einsum("nji,njk,nkl->nil", R, body, R)
    found = {
        "r": (("time", "axis"), r), "q": (("time", "component"), _continuous(quaternion(R))),
        "r_stderr": (("time", "axis"), np.sqrt(np.einsum("nii->ni", where))),
        "turn_stderr": (("time", "axis"), np.sqrt(np.einsum("nii->ni", turn))),
        "residual": ("time", np.sqrt(squares / (3.0 * count[good]))),
    }  # fmt: skip
    time = positions["time"].values
    part = xr.Dataset(found, {"time": time[good], "axis": ["north", "east", "down"]}, {"noise": noise})
    return part.reindex(time=time).assign(seen=("time", count.astype(int)))


def _spread(A: np.ndarray) -> np.ndarray:
    """Whether the points of each frame (frame, point, 3) do not lie on a line."""
    singular = np.linalg.svd(A - A.mean(axis=1, keepdims=True) if len(A) == 1 else A, compute_uv=False)
    return singular[:, 1] > _FLAT * np.maximum(singular[:, 0], np.finfo(float).tiny)


def _skew(v: np.ndarray) -> np.ndarray:
    out = np.zeros((len(v), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return out - np.swapaxes(out, 1, 2)


def _continuous(q: np.ndarray) -> np.ndarray:
    """Quaternions of the sign that lies nearer to the one before."""
    turned = np.einsum("ni,ni->n", q[1:], q[:-1]) < 0.0
    return q * np.where(np.concatenate([[0], np.cumsum(turned)]) % 2, -1.0, 1.0)[:, None]
