"""Axis changes on arrays: Euler angles and quaternions, stability and body axes, moment transfer,
lever arms.

Body axes x forward, y right, z down; stability axes are body axes turned by alpha about y.  Vectors
run along the last axis of an array; angles broadcast against the leading axes.

References
----------
.. [Etkin] Etkin, Dynamics of Atmospheric Flight, 1972, chapter 4.
.. [Klein2006] Klein and Morelli, Aircraft System Identification, AIAA 2006, chapter 3 and 10.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation


class Euler(NamedTuple):
    """Euler angles 3-2-1: phi, theta, psi. [rad]"""

    phi: np.ndarray
    theta: np.ndarray
    psi: np.ndarray


def matrix_from_euler(phi: ArrayLike, theta: ArrayLike, psi: ArrayLike) -> np.ndarray:
    """Return the matrix (..., 3, 3) that turns north-east-down to body axes. [Etkin] eq. (4.5,4)

    Examples
    --------
    Heading east, the nose points along +east:

    >>> (rotation(0.0, 0.0, np.pi / 2)[0] @ [0.0, 1.0, 0.0]).tolist()
    1.0
    """
    phi, theta, psi = np.broadcast_arrays(
        *(np.asarray(angle, float) for angle in (phi, theta, psi))
    )
    cf, sf, ct, st, cp, sp = (
        np.cos(phi),
        np.sin(phi),
        np.cos(theta),
        np.sin(theta),
        np.cos(psi),
        np.sin(psi),
    )
    rows = (
        (ct * cp, ct * sp, -st),
        (sf * st * cp - cf * sp, sf * st * sp + cf * cp, sf * ct),
        (cf * st * cp + sf * sp, cf * st * sp - sf * cp, cf * ct),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def euler_from_matrix(C: ArrayLike) -> Euler:
    """Return the Euler angles of a rotation (..., 3, 3); theta in -pi/2 ... pi/2, phi and psi in
    -pi ... pi.
    """
    C = np.asarray(C, float)
    theta = np.arctan2(-C[..., 0, 2], np.hypot(C[..., 0, 0], C[..., 0, 1]))
    return Euler(
        np.arctan2(C[..., 1, 2], C[..., 2, 2]), theta, np.arctan2(C[..., 0, 1], C[..., 0, 0])
    )


def quaternion_from_matrix(C: ArrayLike) -> np.ndarray:
    """Return the unit quaternion (..., 4), scalar first and not negative, of a rotation (..., 3,
    3).
    """

    C = np.asarray(C, float)
    turned = Rotation.from_matrix(np.swapaxes(C.reshape(-1, 3, 3), 1, 2)).as_quat(canonical=True)
    return np.roll(turned, 1, axis=-1).reshape(*C.shape[:-2], 4)


def matrix_from_quaternion(q: ArrayLike) -> np.ndarray:
    """Return the rotation (..., 3, 3) of a quaternion (..., 4), scalar first; its length does not
    matter.
    """

    q = np.asarray(q, float)
    turned = Rotation.from_quat(np.roll(q.reshape(-1, 4), -1, axis=-1)).as_matrix()
    return np.swapaxes(turned, 1, 2).reshape(*q.shape[:-1], 3, 3)


def stability_to_body(vector: ArrayLike, alpha: ArrayLike) -> np.ndarray:
    """Return a vector (..., 3) of stability axes in body axes, e.g. (CX, CY, CZ) of (-CD, CY, -CL)
    or (Cl, Cm, Cn).
    """
    x, y, z = np.moveaxis(np.asarray(vector, float), -1, 0)
    c, s = np.cos(alpha), np.sin(alpha)
    return np.stack(np.broadcast_arrays(x * c - z * s, y, x * s + z * c), axis=-1)


def to_stability(vector: ArrayLike, alpha: ArrayLike) -> np.ndarray:
    """Return a vector (..., 3) of body axes in stability axes, the inverse of `stability_to_body`."""
    return stability_to_body(vector, -np.asarray(alpha, float))


def lift_drag(CX: ArrayLike, CZ: ArrayLike, alpha: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return lift and drag coefficient of the body-axis force coefficients CX (forward) and CZ
    (down).
    """
    CX, CZ, c, s = np.asarray(CX, float), np.asarray(CZ, float), np.cos(alpha), np.sin(alpha)
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
        The same in body axes: moments and rates turn together, T D T'.

    Examples
    --------
    >>> rate_derivatives_to_body([[-0.4, 0.1], [-0.03, -0.15]], np.pi / 2).round(12).tolist()
    [[-0.15, 0.03], [-0.1, -0.4]]
    """
    c, s = np.cos(np.asarray(alpha, float)), np.sin(np.asarray(alpha, float))
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
    A force up, one metre ahead of the new point, pitches the nose up:

    >>> transfer_moment([0, 0, 0], [0, 0, -1], [1, 0, 0], [0, 0, 0]).tolist()
    [0.0, 1.0, 0.0]
    """
    arm = np.asarray(old, float) - np.asarray(new, float)
    return np.asarray(moment, float) + np.cross(arm, np.asarray(force, float))


def acceleration_at(
    acceleration: ArrayLike, rate: ArrayLike, rate_dot: ArrayLike, position: ArrayLike
) -> np.ndarray:
    """Return the specific force (..., 3) that an accelerometer at `position` from the c.g. shows.
    [m s-2]

    Parameters
    ----------
    acceleration : array (..., 3)
        Specific force at the c.g. [m s-2]
    rate, rate_dot : array (..., 3)
        p, q, r [rad s-1] and their rates [rad s-2].
    position : array (3,)
        Of the sensor from the c.g., body axes; the opposite position leads back to the c.g. [m]

    References
    ----------
    .. [Klein2006] eq. (10.5).
    """
    w, arm = np.asarray(rate, float), np.asarray(position, float)
    return (
        np.asarray(acceleration, float)
        + np.cross(np.asarray(rate_dot, float), arm)
        + np.cross(w, np.cross(w, arm))
    )


def velocity_at_position(velocity: ArrayLike, rate: ArrayLike, position: ArrayLike) -> np.ndarray:
    """Return the air-relative velocity (..., 3) at `position` [m] from the c.g., as vanes and
    probes feel it. [m s-1]
    """
    return np.asarray(velocity, float) + np.cross(
        np.asarray(rate, float), np.asarray(position, float)
    )
