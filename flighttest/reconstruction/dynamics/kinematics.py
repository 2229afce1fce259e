"""Kinematics of the flight path: attitude, specific force, gravity, and their derivatives, for
whole records at once.

Attitude is (phi, theta, psi), velocities are north-east-down relative to the ground.  Round, rotating Earth when the
latitude is known: Coriolis acceleration (0.01 m/s2 at 100 m/s), and the turning of the level axes that are carried along
(1.6e-5 rad/s).  Gyros are taken relative to the Earth; its rate (7e-5 rad/s) is part of their biases.  Euler angles:
|theta| below 80 degrees.
"""

from __future__ import annotations

import numpy as np

from flightmech.units import G0

EARTH_RATE = 7.292115e-5  # rad/s, WGS-84
EARTH_RADIUS = 6371000.0  # m, mean


def gravity(latitude: float | None, h: float) -> float:
    """Return the acceleration of free fall, which falls with height; standard gravity at sea level
    when the latitude is not known. [m s-2]

    Parameters
    ----------
    latitude : float or None
        Geodetic latitude. [rad]
    h : float
        Height over the ellipsoid, or over mean sea level (30 m are 1e-5 of g). [m]

    References
    ----------
    .. [NIMA] NIMA TR8350.2, WGS 84, 3rd edition, eq. (4-1) and (4-3), the height term to first order.

    Notes
    -----
    At 7500 m the fall is 0.023 m s-2: left out, it comes back as the bias of an accelerometer.

    Examples
    --------
    >>> round(gravity(None, 7500.0), 4)
    9.7836
    """
    surface = G0
    if latitude is not None:
        s2 = np.sin(latitude) ** 2
        surface = (
            9.7803253359 * (1.0 + 0.00193185265241 * s2) / np.sqrt(1.0 - 0.00669437999013 * s2)
        )
    return float(surface * (1.0 - 2.0 * h / EARTH_RADIUS))


def earth_rotation(latitude: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Return what the Earth does to a moving observer, north-east-down axes; zeros when the
    latitude is not known.

    Parameters
    ----------
    latitude : float or None
        [rad]

    Returns
    -------
    rotation : array (3,)
        Rate of the Earth. [rad s-1]
    transport : array (3, 3)
        ``transport @ v`` is the rate at which the level axes turn because they are carried along.
        [m-1]
    """
    if latitude is None:
        return np.zeros(3), np.zeros((3, 3))
    transport = (
        np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -np.tan(latitude), 0.0]]) / EARTH_RADIUS
    )
    return EARTH_RATE * np.array([np.cos(latitude), 0.0, -np.sin(latitude)]), transport


def cross_product_matrix(a: np.ndarray) -> np.ndarray:
    """Return the matrices of the cross product a x (...), shape (..., 3, 3)."""
    out = np.zeros((*np.shape(a)[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2] = -a[..., 2], a[..., 1]
    out[..., 1, 0], out[..., 1, 2] = a[..., 2], -a[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -a[..., 1], a[..., 0]
    return out


def body_to_ned_rotation(attitude: np.ndarray) -> np.ndarray:
    """Return the rotations from body to north-east-down axes.

    Parameters
    ----------
    attitude : array (time, 3)
        phi, theta, psi. [rad]

    Returns
    -------
    array (time, 3, 3)
    """
    (sf, st, sp), (cf, ct, cp) = np.sin(attitude).T, np.cos(attitude).T
    rows = [
        [ct * cp, sf * st * cp - cf * sp, cf * st * cp + sf * sp],
        [ct * sp, sf * st * sp + cf * cp, cf * st * sp - sf * cp],
        [-st, sf * ct, cf * ct],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rate_matrix(attitude: np.ndarray) -> np.ndarray:
    """Return W with omega = W (phi_dot, theta_dot, psi_dot); its columns are the axes of the three
    angles in the body.

    A body-axes image U = R' m of a fixed vector changes with the angles as dU/d(angle i) = U x
    (column i).
    """
    (sf, st, _), (cf, ct, _) = np.sin(attitude).T, np.cos(attitude).T
    zero, one = np.zeros_like(sf), np.ones_like(sf)
    rows = [[one, zero, -st], [zero, cf, sf * ct], [zero, -sf, cf * ct]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def body_rates_from_angles(
    attitude: np.ndarray, attitude_dot: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return body rates (time, 3) from the rates of the angles, and their derivative with respect
    to the angles (time, 3, 3).
    """
    W = rate_matrix(attitude)
    omega = (W @ attitude_dot[..., None])[..., 0]
    (sf, st, _), (cf, ct, _) = np.sin(attitude).T, np.cos(attitude).T
    psi_dot = attitude_dot[:, 2]
    change = np.zeros_like(W)
    change[:, 1, 0], change[:, 2, 0] = omega[:, 2], -omega[:, 1]
    change[:, 0, 1], change[:, 1, 1], change[:, 2, 1] = (
        -ct * psi_dot,
        -sf * st * psi_dot,
        -cf * st * psi_dot,
    )
    return omega, change


def ned_to_body(
    attitude: np.ndarray, vector: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return R' m for vectors in north-east-down axes, its derivative with respect to the angles,
    and R' itself.
    """
    Rt = np.swapaxes(body_to_ned_rotation(attitude), -1, -2)
    U = (Rt @ vector[..., None])[..., 0]
    return U, cross_product_matrix(U) @ rate_matrix(attitude), Rt


def in_body(
    phi, theta, psi, n, e, d
) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Return the body components of vectors given north-east-down, and those of the down axis.

    Parameters
    ----------
    phi, theta, psi : array (time,)
        Attitude. [rad]
    n, e, d : array (time,)
        Components of the vectors.

    Returns
    -------
    x, y, z : array (time,)
        Components forward, right, down: R' m.
    down : (array (time,), array (time,), array (time,))
        The same of the unit vector down.

    Examples
    --------
    >>> x, y, z, _ = in_body(0.0, 0.0, np.pi / 2.0, 0.0, 5.0, 1.0)  # heading east, moving east
    >>> [round(float(part), 12) for part in (x, y, z)]
    [5.0, 0.0, 1.0]
    """
    sf, cf, st, ct, sp, cp = (f(angle) for angle in (phi, theta, psi) for f in (np.sin, np.cos))
    along, across = (
        cp * n + sp * e,
        cp * e - sp * n,
    )  # in the vertical plane of the heading, and to its right
    up = st * along + ct * d
    return (
        ct * along - st * d,
        sf * up + cf * across,
        cf * up - sf * across,
        (-st, sf * ct, cf * ct),
    )


def incidence_rates(U, omega, free) -> tuple[np.ndarray, np.ndarray]:
    """Return alpha_dot and beta_dot from rates and accelerations, without differentiating a vane.

    Parameters
    ----------
    U : three arrays (time,)
        Air-relative velocity u, v, w. [m s-1]
    omega : three arrays (time,)
        p, q, r. [rad s-1]
    free : three arrays (time,)
        Specific force at the c.g. and gravity, in body axes. [m s-2]

    Returns
    -------
    alpha_dot, beta_dot : array (time,)
        In still or uniformly moving air. [rad s-1]

    Notes
    -----
    alpha_dot = (u w' - w u')/(u^2 + w^2), beta_dot = (v' - v V'/V)/sqrt(u^2 + w^2) with U' = force + g_b - omega x U.
    """
    (u, v, w), (p, q, r), (ax, ay, az) = U, omega, free
    u_dot, v_dot, w_dot = ax - (q * w - r * v), ay - (r * u - p * w), az - (p * v - q * u)
    plane = np.maximum(u * u + w * w, 1e-6)
    V2 = plane + v * v
    VV = u * u_dot + v * v_dot + w * w_dot
    return (u * w_dot - w * u_dot) / plane, (v_dot - v * VV / V2) / np.sqrt(plane)
