"""Axis transformations of arrays: attitude, stability and body axes, moment transfer, lever arms.

Body axes have x forward, y right and z down. Stability axes are body axes turned by alpha about y.
The components of a vector are the last axis of an array. Angles broadcast against the leading axes.

References
----------
.. [Etkin] Etkin, Dynamics of Atmospheric Flight, 1972, chapter 4.
.. [Klein2006] Klein and Morelli, Aircraft System Identification, AIAA 2006, chapter 3 and 10.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike


class Euler(NamedTuple):
    """Euler angles 3-2-1: phi, theta, psi. [rad]"""

    phi: np.ndarray
    theta: np.ndarray
    psi: np.ndarray


def matrix_from_euler(phi: ArrayLike, theta: ArrayLike, psi: ArrayLike) -> np.ndarray:
    """Return the matrix (..., 3, 3) from north-east-down to body axes. [Etkin] eq. (4.5,4)

    Examples
    --------
    At heading east the nose points along +east:

    >>> (matrix_from_euler(0.0, 0.0, np.pi / 2)[0] @ [0.0, 1.0, 0.0]).tolist()
    1.0
    """
    phi, theta, psi = np.broadcast_arrays(
        *(np.asarray(angle, float) for angle in (phi, theta, psi))
    )
    # cosine and sine of phi (f), theta (t) and psi (p)
    cf, sf = np.cos(phi), np.sin(phi)
    ct, st = np.cos(theta), np.sin(theta)
    cp, sp = np.cos(psi), np.sin(psi)
    rows = (
        (ct * cp, ct * sp, -st),
        (sf * st * cp - cf * sp, sf * st * sp + cf * cp, sf * ct),
        (cf * st * cp + sf * sp, cf * st * sp - sf * cp, cf * ct),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def euler_from_matrix(C: ArrayLike) -> Euler:
    """Return the Euler angles of a rotation (..., 3, 3).

    theta lies in -pi/2 ... pi/2, phi and psi in -pi ... pi.
    """
    C = np.asarray(C, float)
    phi = np.arctan2(C[..., 1, 2], C[..., 2, 2])
    # arctan2 with the horizontal length is accurate near theta = +-pi/2, where arcsin is not
    theta = np.arctan2(-C[..., 0, 2], np.hypot(C[..., 0, 0], C[..., 0, 1]))
    psi = np.arctan2(C[..., 0, 1], C[..., 0, 0])
    return Euler(phi, theta, psi)


def quaternion_from_matrix(C: ArrayLike) -> np.ndarray:
    """Return the unit quaternion (..., 4) of a rotation (..., 3, 3).

    The scalar part is the first component, and it is not negative.
    """
    C = np.asarray(C, float)
    # SciPy rotates vectors, C rotates axes: one matrix is the transpose of the other. SciPy has the
    # scalar part last.
    transposed = np.swapaxes(C.reshape(-1, 3, 3), 1, 2)
    scalar_last = scipy.spatial.transform.Rotation.from_matrix(transposed).as_quat(canonical=True)
    return np.roll(scalar_last, 1, axis=-1).reshape(*C.shape[:-2], 4)


def matrix_from_quaternion(q: ArrayLike) -> np.ndarray:
    """Return the rotation (..., 3, 3) of a quaternion (..., 4) of any length, scalar first."""
    q = np.asarray(q, float)
    # conventions of SciPy: see quaternion_from_matrix
    scalar_last = np.roll(q.reshape(-1, 4), -1, axis=-1)
    transposed = scipy.spatial.transform.Rotation.from_quat(scalar_last).as_matrix()
    return np.swapaxes(transposed, 1, 2).reshape(*q.shape[:-1], 3, 3)


def stability_to_body(vector: ArrayLike, alpha: ArrayLike) -> np.ndarray:
    """Return a vector (..., 3) of stability axes in body axes.

    Examples are (-CD, CY, -CL), which gives (CX, CY, CZ), and the moments (Cl, Cm, Cn).
    """
    x, y, z = np.moveaxis(np.asarray(vector, float), -1, 0)
    c, s = np.cos(alpha), np.sin(alpha)
    return np.stack(np.broadcast_arrays(x * c - z * s, y, x * s + z * c), axis=-1)


def to_stability(vector: ArrayLike, alpha: ArrayLike) -> np.ndarray:
    """Return a vector (..., 3) of body axes in stability axes, the inverse of
    `stability_to_body`.
    """
    return stability_to_body(vector, -np.asarray(alpha, float))


def lift_drag(CX: ArrayLike, CZ: ArrayLike, alpha: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return CL and CD from the force coefficients CX (forward) and CZ (down) in body axes."""
    CX, CZ = np.asarray(CX, float), np.asarray(CZ, float)
    c, s = np.cos(alpha), np.sin(alpha)
    return CX * s - CZ * c, -CX * c - CZ * s


def rate_derivatives_to_body(derivatives: ArrayLike, alpha: ArrayLike) -> np.ndarray:
    """Return roll and yaw derivatives with respect to roll and yaw rate in body axes.

    Parameters
    ----------
    derivatives : array (..., 2, 2)
        ``[[Cl_p, Cl_r], [Cn_p, Cn_r]]`` in stability axes, both rates made dimensionless with b/2V.
    alpha : array (...)
        Angle of attack of the stability axes. [rad]

    Returns
    -------
    array (..., 2, 2)
        The derivatives in body axes, T D T', because moments and rates turn together.

    Examples
    --------
    >>> rate_derivatives_to_body([[-0.4, 0.1], [-0.03, -0.15]], np.pi / 2).round(12).tolist()
    [[-0.15, 0.03], [-0.1, -0.4]]
    """
    c, s = np.cos(np.asarray(alpha, float)), np.sin(np.asarray(alpha, float))
    # rotation of the components (x, z) from stability to body axes
    T = np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)
    return T @ np.asarray(derivatives, float) @ np.swapaxes(T, -1, -2)


def transfer_moment(
    moment: ArrayLike, force: ArrayLike, old: ArrayLike, new: ArrayLike
) -> np.ndarray:
    """Return the moment (..., 3) about the point `new` of a force and a moment about `old`.

    Parameters
    ----------
    moment, force : array (..., 3)
        Body axes. [N m, N]
    old, new : array (..., 3)
        Positions of the points in body axes. [m]

    Examples
    --------
    An upward force one metre ahead of the new point gives a nose-up moment:

    >>> transfer_moment([0, 0, 0], [0, 0, -1], [1, 0, 0], [0, 0, 0]).tolist()
    [0.0, 1.0, 0.0]
    """
    arm = np.asarray(old, float) - np.asarray(new, float)
    return np.asarray(moment, float) + np.cross(arm, np.asarray(force, float))


def acceleration_at(
    acceleration: ArrayLike, rate: ArrayLike, rate_dot: ArrayLike, position: ArrayLike
) -> np.ndarray:
    """Return the specific force (..., 3) at an accelerometer outside the c.g. [m s-2]

    Parameters
    ----------
    acceleration : array (..., 3)
        Specific force at the c.g. [m s-2]
    rate, rate_dot : array (..., 3)
        p, q, r [rad s-1] and their rates [rad s-2].
    position : array (3,)
        Sensor relative to the c.g., body axes. The negative position converts back. [m]

    References
    ----------
    .. [Klein2006] eq. (10.5).
    """
    w, arm = np.asarray(rate, float), np.asarray(position, float)
    # tangential and centripetal acceleration
    return (
        np.asarray(acceleration, float)
        + np.cross(np.asarray(rate_dot, float), arm)
        + np.cross(w, np.cross(w, arm))
    )


def velocity_at_position(velocity: ArrayLike, rate: ArrayLike, position: ArrayLike) -> np.ndarray:
    """Return the air-relative velocity (..., 3) at a vane or probe. [m s-1]

    `position` is relative to the c.g. [m]
    """
    return np.asarray(velocity, float) + np.cross(
        np.asarray(rate, float), np.asarray(position, float)
    )
