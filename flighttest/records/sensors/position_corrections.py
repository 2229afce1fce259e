"""Corrections of position, upwash and static pressure: from what a sensor shows to what is true at
the centre of gravity.

All positions `arm` are from the c.g. to the sensor in body axes; with `position` and c.g. given
from the moment reference point, arm = position - c.g.  In the reconstruction the vane corrections
are part of the output equations, so that a reading is corrected once and with the reconstructed
rates.
"""

from __future__ import annotations

import numpy as np


def force_at_cg(force, omega, omega_dot, arm) -> np.ndarray:
    """Return the specific force at the c.g. from the one at an accelerometer.

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
    return (
        np.asarray(force, float) - np.cross(omega_dot, arm) - np.cross(omega, np.cross(omega, arm))
    )


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
    """Return what perfect vanes at `arm` would show: atan(w/u), and the flank angle atan(v/u).

    Parameters as in `velocity_at`.

    Returns
    -------
    alpha, flank : array (time,)
        tan(flank) = tan(beta)/cos(alpha): a vane that turns in the x-y plane does not show beta.
        [rad]
    """
    u, v, w = velocity_at(velocity, omega, arm).T
    return np.arctan2(w, u), np.arctan2(v, u)


def vane_at_cg(alpha_vane, flank, V, omega, arm) -> tuple[np.ndarray, np.ndarray]:
    """Return alpha and the flank angle at the c.g. from vane angles free of factor, offset and lag,
    for small angles.

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
        Error of second order in the angles and in omega arm/V; the reconstruction uses the exact
        output instead. [rad]
    """
    p, q, r = np.asarray(omega, float).T
    x, y, z = np.moveaxis(np.asarray(arm, float), -1, 0)
    return alpha_vane + (q * x - p * y) / V, flank - (r * x - p * z) / V


def vane_true(alpha_vane, factor: float = 1.0, offset: float = 0.0) -> np.ndarray:
    """Return the angle of the flow at a vane without upwash and offset; the vane shows factor times
    the angle plus the offset. [rad]

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
        beta = asin(v/V): not a flank angle any more. [rad]

    Notes
    -----
    The flow at the vanes is s (1, tan flank, tan alpha); the c.g. moves with U = s d - omega x arm, and |U| = V gives s.
    """
    d = np.stack(np.broadcast_arrays(1.0, np.tan(flank), np.tan(alpha_vane)), axis=-1)
    turn = np.cross(omega, arm)
    dd, dt, tt = ((a * b).sum(axis=-1) for a, b in ((d, d), (d, turn), (turn, turn)))
    s = (dt + np.sqrt(np.maximum(dt**2 - dd * (tt - np.asarray(V, float) ** 2), 0.0))) / dd
    u, v, w = np.moveaxis(s[..., None] * d - turn, -1, 0)
    return np.arctan2(w, u), np.arcsin(np.clip(v / V, -1.0, 1.0))


def true_pressures(p_static, q_c, static_error: float) -> tuple[np.ndarray, np.ndarray]:
    """Return static and impact pressure free of an error of the static port; the total pressure is
    taken as exact.

    Parameters
    ----------
    p_static, q_c : array (time,)
        As shown. [Pa]
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
    q_true = np.asarray(q_c, float) / (1.0 - static_error)
    return np.asarray(p_static, float) - static_error * q_true, q_true
