"""Position corrections: from where a sensor sits to the centre of gravity.

All positions `arm` are from the c.g. to the sensor in body axes; with `position` and c.g. given from the moment
reference point, arm = position - c.g.  In the reconstruction the vane corrections are part of the output equations, so
that a reading is corrected once and with the reconstructed rates.
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
    return np.asarray(force, float) - np.cross(omega_dot, arm) - np.cross(omega, np.cross(omega, arm))


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
        tan(flank) = tan(beta)/cos(alpha): a vane that turns in the x-y plane does not show beta. [rad]
    """
    u, v, w = velocity_at(velocity, omega, arm).T
    return np.arctan2(w, u), np.arctan2(v, u)


def vane_at_cg(alpha_vane, flank, V, omega, arm) -> tuple[np.ndarray, np.ndarray]:
    """Return alpha and the flank angle at the c.g. from vane angles free of factor, offset and lag, for small angles.

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
        Error of second order in the angles and in omega arm/V; the reconstruction uses the exact output instead. [rad]
    """
    p, q, r = np.asarray(omega, float).T
    x, y, z = np.moveaxis(np.asarray(arm, float), -1, 0)
    return alpha_vane + (q * x - p * y) / V, flank - (r * x - p * z) / V
