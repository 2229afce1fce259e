"""Kinematics of the flight path: rotations, gravity and rates of incidence, with derivatives.

All functions work on complete records. Attitude is (phi, theta, psi). Velocities are north-east-
down relative to the ground. Euler angles serve for |theta| below 80 degrees.

If the latitude is known, the Earth is round and rotates. This adds the Coriolis acceleration
(0.01 m/s2 at 100 m/s) and the rotation of the level axes that move along with the aeroplane
(1.6e-5 rad/s). Gyros measure rates relative to the Earth; the rate of the Earth (7e-5 rad/s) is
part of their biases.
"""

from __future__ import annotations

import numpy as np

from flightmech.units import G0

EARTH_RATE = 7.292115e-5  # rad/s, WGS-84
EARTH_RADIUS = 6371000.0  # m, mean
_LEAST_SQUARE = 1e-6  # m2 s-2


def gravity(latitude: float | None, h: float) -> float:
    """Return the acceleration of free fall at a height. [m s-2]

    Parameters
    ----------
    latitude : float or None
        Geodetic latitude. Without it, gravity at sea level is standard gravity. [rad]
    h : float
        Height over the ellipsoid, or over mean sea level (30 m are 1e-5 of g). [m]

    References
    ----------
    .. [NIMA] NIMA TR8350.2, WGS 84, 3rd edition, eq. (4-1) and (4-3), the height term to
       first order.

    Notes
    -----
    At 7500 m the decrease is 0.023 m s-2. If it is neglected, it appears as the bias of an
    accelerometer.

    Examples
    --------
    >>> round(gravity(None, 7500.0), 4)
    9.7836
    """
    surface = G0
    if latitude is not None:
        # Somigliana's formula, eq. (4-1) of [NIMA]
        s2 = np.sin(latitude) ** 2
        surface = (
            9.7803253359 * (1.0 + 0.00193185265241 * s2) / np.sqrt(1.0 - 0.00669437999013 * s2)
        )
    return float(surface * (1.0 - 2.0 * h / EARTH_RADIUS))


def earth_rotation(latitude: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Return the rotation of the Earth in north-east-down axes; zeros without a latitude.

    Parameters
    ----------
    latitude : float or None
        [rad]

    Returns
    -------
    rotation : array (3,)
        Rate of the Earth. [rad s-1]
    transport : array (3, 3)
        ``transport @ v`` is the rate of turn of the level axes that move with velocity v. [m-1]
    """
    if latitude is None:
        return np.zeros(3), np.zeros((3, 3))
    rotation = EARTH_RATE * np.array([np.cos(latitude), 0.0, -np.sin(latitude)])
    # rate of the level axes over the Earth: (v_e, -v_n, -v_e tan(latitude))/R
    rows = [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -np.tan(latitude), 0.0]]
    return rotation, np.array(rows) / EARTH_RADIUS


def cross_product_matrix(a: np.ndarray) -> np.ndarray:
    """Return the matrices of the cross product a x (...), shape (..., 3, 3)."""
    matrix = np.zeros((*np.shape(a)[:-1], 3, 3))
    matrix[..., 0, 1] = -a[..., 2]
    matrix[..., 0, 2] = a[..., 1]
    matrix[..., 1, 0] = a[..., 2]
    matrix[..., 1, 2] = -a[..., 0]
    matrix[..., 2, 0] = -a[..., 1]
    matrix[..., 2, 1] = a[..., 0]
    return matrix


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
    # sines and cosines of phi (f), theta (t), psi (p)
    sf, st, sp = np.sin(attitude).T
    cf, ct, cp = np.cos(attitude).T
    rows = [
        [ct * cp, sf * st * cp - cf * sp, cf * st * cp + sf * sp],
        [ct * sp, sf * st * sp + cf * cp, cf * st * sp - sf * cp],
        [-st, sf * ct, cf * ct],
    ]
    return _stack_matrix(rows)


def _stack_matrix(rows: list[list[np.ndarray]]) -> np.ndarray:
    """Return matrices (time, 3, 3) from their elements (time,)."""
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rate_matrix(attitude: np.ndarray) -> np.ndarray:
    """Return W with omega = W (phi_dot, theta_dot, psi_dot) (time, 3, 3).

    The columns of W are the axes of the three angles in the body. A fixed vector m has the
    components U = R' m in the body. They change with the angles as dU/d(angle i) = U x (column i).
    """
    sf, st, _ = np.sin(attitude).T
    cf, ct, _ = np.cos(attitude).T
    zeros, ones = np.zeros_like(sf), np.ones_like(sf)
    return _stack_matrix([[ones, zeros, -st], [zeros, cf, sf * ct], [zeros, -sf, cf * ct]])


def body_rates_from_angles(
    attitude: np.ndarray, attitude_dot: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return body rates from the rates of the angles, and their derivative by the angles.

    Returns
    -------
    omega : array (time, 3)
        p, q, r. [rad s-1]
    derivative : array (time, 3, 3)
        By phi, theta, psi. [s-1]
    """
    W = rate_matrix(attitude)
    omega = (W @ attitude_dot[..., None])[..., 0]
    sf, st, _ = np.sin(attitude).T
    cf, ct, _ = np.cos(attitude).T
    psi_dot = attitude_dot[:, 2]
    derivative = np.zeros_like(W)
    # by phi: dq/dphi = r, dr/dphi = -q
    derivative[:, 1, 0] = omega[:, 2]
    derivative[:, 2, 0] = -omega[:, 1]
    # by theta: only the column of psi_dot depends on it; nothing depends on psi
    derivative[:, 0, 1] = -ct * psi_dot
    derivative[:, 1, 1] = -sf * st * psi_dot
    derivative[:, 2, 1] = -cf * st * psi_dot
    return omega, derivative


def ned_to_body(
    attitude: np.ndarray, vector: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return vectors in body axes from vectors m in north-east-down axes.

    Returns
    -------
    U : array (time, 3)
        R' m.
    derivative : array (time, 3, 3)
        Of U by phi, theta, psi.
    Rt : array (time, 3, 3)
        R', the derivative of U by m.
    """
    Rt = np.swapaxes(body_to_ned_rotation(attitude), -1, -2)
    U = (Rt @ vector[..., None])[..., 0]
    # dU/d(angle i) = U x (column i of W)
    return U, cross_product_matrix(U) @ rate_matrix(attitude), Rt


def in_body(
    phi, theta, psi, n, e, d
) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Return the body components of north-east-down vectors, and of the down axis.

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
        Body components of the unit vector down.

    Examples
    --------
    >>> x, y, z, _ = in_body(0.0, 0.0, np.pi / 2.0, 0.0, 5.0, 1.0)  # heading east, moving east
    >>> [round(float(part), 12) for part in (x, y, z)]
    [5.0, 0.0, 1.0]
    """
    sf, cf = np.sin(phi), np.cos(phi)
    st, ct = np.sin(theta), np.cos(theta)
    sp, cp = np.sin(psi), np.cos(psi)
    # turned by psi: along the heading and to the right of it
    along = cp * n + sp * e
    across = cp * e - sp * n
    # turned by theta: down in the plane of symmetry without bank
    below = st * along + ct * d
    x = ct * along - st * d
    # turned by phi
    y = sf * below + cf * across
    z = cf * below - sf * across
    return x, y, z, (-st, sf * ct, cf * ct)


def incidence_rates(U, omega, free) -> tuple[np.ndarray, np.ndarray]:
    """Return alpha_dot and beta_dot from rates and accelerations, without a derivative of a vane.

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
    alpha_dot = (u w' - w u')/(u^2 + w^2) and beta_dot = (v' - v V'/V)/sqrt(u^2 + w^2), with
    U' = force + g_b - omega x U.
    """
    u, v, w = U
    p, q, r = omega
    ax, ay, az = free
    u_dot = ax - (q * w - r * v)
    v_dot = ay - (r * u - p * w)
    w_dot = az - (p * v - q * u)
    # square of the speed in the plane of symmetry, positive at rest too
    plane = np.maximum(u * u + w * w, _LEAST_SQUARE)
    V2 = plane + v * v
    # V V'
    VV = u * u_dot + v * v_dot + w * w_dot
    alpha_dot = (u * w_dot - w * u_dot) / plane
    beta_dot = (v_dot - v * VV / V2) / np.sqrt(plane)
    return alpha_dot, beta_dot
