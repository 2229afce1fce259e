"""Corrections for position, upwash and static pressure, from sensor readings to the c.g.

All positions `arm` are from the c.g. to the sensor in body axes.  With `position` and c.g. from the
moment reference point, arm = position - c.g.  In the reconstruction the vane corrections are part
of the output equations, so that a reading is corrected once and with the reconstructed rates.
"""

from __future__ import annotations

import numpy as np


def force_at_cg(force, omega, omega_dot, arm) -> np.ndarray:
    """Return the specific force at the c.g. from the specific force at an accelerometer.

    Parameters
    ----------
    force : array (time, 3)
        Specific force at the sensor: forward, right, down. [m s-2]
    omega, omega_dot : array (time, 3)
        p, q, r and their rates. [rad s-1], [rad s-2]
    arm : array (3,) or (time, 3)
        Sensor from the c.g. [m]

    Returns
    -------
    array (time, 3)

    Notes
    -----
    a_cg = a_s - omega_dot x r - omega x (omega x r); exact for a rigid aeroplane.

    Examples
    --------
    >>> force_at_cg([[0.0, 0.0, -9.8]], [[0.0, 0.0, 0.0]], [[0.0, 0.5, 0.0]], [2.0, 0.0, 0.0])[0]
    array([ 0. ,  0. , -8.8])
    """
    omega = np.asarray(omega, float)
    tangential = np.cross(omega_dot, arm)
    centripetal = np.cross(omega, np.cross(omega, arm))
    return np.asarray(force, float) - tangential - centripetal


def velocity_at(velocity, omega, arm) -> np.ndarray:
    """Return the air-relative velocity at a probe, (u, v, w) + omega x arm.

    Parameters
    ----------
    velocity : array (time, 3)
        u, v, w at the c.g. [m s-1]
    omega : array (time, 3)
        p, q, r. [rad s-1]
    arm : array (3,) or (time, 3)
        Probe from the c.g. [m]

    Returns
    -------
    array (time, 3)
    """
    return np.asarray(velocity, float) + np.cross(omega, arm)


def vane_angles(velocity, omega, arm) -> tuple[np.ndarray, np.ndarray]:
    """Return the readings of ideal vanes at `arm`: atan(w/u), and the flank angle atan(v/u).

    Parameters are the same as in `velocity_at`.

    Returns
    -------
    alpha, flank : array (time,)
        tan(flank) = tan(beta)/cos(alpha): a vane that turns in the x-y plane does not measure beta.
        [rad]
    """
    u, v, w = velocity_at(velocity, omega, arm).T
    return np.arctan2(w, u), np.arctan2(v, u)


def vane_at_cg(alpha_vane, flank, V, omega, arm) -> tuple[np.ndarray, np.ndarray]:
    """Return alpha and the flank angle at the c.g. from vane angles, for small angles.

    Parameters
    ----------
    alpha_vane, flank : array (time,)
        Vane angles, corrected for factor, offset and lag. [rad]
    V : array (time,)
        True airspeed. [m s-1]
    omega : array (time, 3)
        p, q, r. [rad s-1]
    arm : array (3,)
        Vanes from the c.g. [m]

    Returns
    -------
    alpha, flank : array (time,)
        The error is of second order in the angles and in omega arm/V.  The reconstruction uses the
        exact output instead. [rad]
    """
    p, q, r = np.asarray(omega, float).T
    x, y, z = np.moveaxis(np.asarray(arm, float), -1, 0)
    return alpha_vane + (q * x - p * y) / V, flank - (r * x - p * z) / V


def vane_true(alpha_vane, factor: float = 1.0, offset: float = 0.0) -> np.ndarray:
    """Return the angle of the flow at a vane without upwash and offset. [rad]

    The reading of the vane is factor times the angle plus the offset.

    Examples
    --------
    >>> round(float(vane_true(0.118, factor=1.08, offset=0.01)), 3)
    0.1
    """
    return (np.asarray(alpha_vane, float) - offset) / factor


def incidence_at_cg(alpha_vane, flank, V, omega, arm) -> tuple[np.ndarray, np.ndarray]:
    """Return alpha and beta at the c.g. from true vane angles, exactly.

    Parameters
    ----------
    alpha_vane, flank : array (time,)
        atan(w/u) and atan(v/u) at the vanes, free of upwash, offset and lag: see `vane_true`. [rad]
    V : array (time,)
        True airspeed at the c.g. [m s-1]
    omega : array (time, 3)
        p, q, r. [rad s-1]
    arm : array (3,) or (time, 3)
        Vanes from the c.g. [m]

    Returns
    -------
    alpha, beta : array (time,)
        beta = asin(v/V), which is not a flank angle. [rad]

    Notes
    -----
    The flow at the vanes is s d with d = (1, tan flank, tan alpha).  The velocity of the c.g. is
    U = s d - omega x arm, and |U| = V gives s.
    """
    d = np.stack(np.broadcast_arrays(1.0, np.tan(flank), np.tan(alpha_vane)), axis=-1)
    rotation = np.cross(omega, arm)
    # |s d - r|^2 = V^2 is quadratic in s: dd s^2 - 2 dr s + rr - V^2 = 0; its larger root.
    dd = (d * d).sum(axis=-1)
    dr = (d * rotation).sum(axis=-1)
    rr = (rotation * rotation).sum(axis=-1)
    s = (dr + np.sqrt(np.maximum(dr**2 - dd * (rr - np.asarray(V, float) ** 2), 0.0))) / dd
    u, v, w = np.moveaxis(s[..., None] * d - rotation, -1, 0)
    return np.arctan2(w, u), np.arcsin(np.clip(v / V, -1.0, 1.0))


def true_pressures(p_static, q_c, static_error: float) -> tuple[np.ndarray, np.ndarray]:
    """Return static and impact pressure without the error of the static port.

    The total pressure is assumed to be exact.

    Parameters
    ----------
    p_static, q_c : array (time,)
        Readings. [Pa]
    static_error : float
        Error of the static pressure over true impact pressure, as `reconstruct` estimates it. [1]

    Returns
    -------
    p_static, q_c : array (time,)
        [Pa]

    Examples
    --------
    >>> [round(float(x), 1) for x in true_pressures(90100.0, 4900.0, 0.02)]
    [90000.0, 5000.0]
    """
    # p + q_c is the total pressure of the readings and of the truth.
    q_true = np.asarray(q_c, float) / (1.0 - static_error)
    return np.asarray(p_static, float) - static_error * q_true, q_true
