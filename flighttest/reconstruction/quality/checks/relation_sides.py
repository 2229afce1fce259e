"""Both sides of each relation between the channels of a record.

Every function takes the channels and returns two time histories of one quantity, which rest on
different channels.  Axes are body axes (x forward, y right, z down) and Earth axes (north, east,
down).  Accelerometers measure specific force, which excludes gravity.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from flightmech.air import GAMMA, R_AIR, mach_number
from flightmech.units import G0
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.records.signals.differentiation import derivative

Sides = tuple[np.ndarray, np.ndarray]

_ALPHA_LIMIT = 0.6  # rad, of an angle of attack that the relations use
_SMALLEST_COSINE = 0.1  # of pitch, below which the Euler rates are singular
_FINE_STEP = 0.15  # s, below which a derivative of fourth order is not too wide


def rate_of(s: ResampledChannels, name: str) -> np.ndarray:
    """Return the time derivative of a channel."""
    if s.step < _FINE_STEP:
        order = 4
    else:
        order = 2
    return derivative(s[name], s.step, window=5, order=order)


def mach_of_pressures(s: ResampledChannels) -> np.ndarray:
    """Return the Mach number of impact pressure and static pressure. [1]"""
    return mach_number(np.clip(s["q_c"], 0.0, 1e6), np.clip(s["p_static"], 1e2, 1e9))


def speed_of_sound(s: ResampledChannels) -> np.ndarray:
    """Return the speed of sound of the static temperature. [m s-1]"""
    return np.sqrt(GAMMA * R_AIR * np.clip(s["temperature"], 1.0, 1e5))


def bank_rate(s: ResampledChannels) -> Sides:
    """Return the rate of bank, and p + (q sin(phi) + r cos(phi)) tan(theta). [rad s-1]"""
    sf, cf, st, ct = _attitude_functions(s)
    kinematic = s["p"] + (s["q"] * sf + s["r"] * cf) * st / _divisor(ct)
    return rate_of(s, "phi"), kinematic


def pitch_rate(s: ResampledChannels) -> Sides:
    """Return the rate of pitch attitude, and q cos(phi) - r sin(phi). [rad s-1]"""
    sf, cf, _, _ = _attitude_functions(s)
    return rate_of(s, "theta"), s["q"] * cf - s["r"] * sf


def heading_rate(s: ResampledChannels) -> Sides:
    """Return the rate of heading, and (q sin(phi) + r cos(phi)) / cos(theta). [rad s-1]"""
    sf, cf, _, ct = _attitude_functions(s)
    return rate_of(s, "psi"), (s["q"] * sf + s["r"] * cf) / _divisor(ct)


def inertial_force(axis: int, channel: str) -> Callable[[ResampledChannels], Sides]:
    """Return the sides of one body axis: the accelerometer, and the ground velocity. [m s-2]"""

    def sides(s: ResampledChannels) -> Sides:
        return s[channel], _force_of_ground_velocity(s)[axis]

    return sides


def vertical_acceleration(s: ResampledChannels) -> Sides:
    """Return the acceleration of pressure height, and of the accelerometers. [m s-2]"""
    sf, cf, st, ct = _attitude_functions(s)
    upward_force = st * s["ax_imu"] - ct * (sf * s["ay_imu"] + cf * s["az_imu"])
    acceleration = derivative(rate_of(s, "h_baro"), s.step, window=5, order=2)
    return acceleration, upward_force - G0


def airspeed_rate(s: ResampledChannels) -> Sides:
    """Return the rate of airspeed, and the acceleration along the path in still air. [m s-2]"""
    _, cf, st, ct = _attitude_functions(s)
    alpha = _angle_of_attack(s)
    forward = s["ax_imu"] - G0 * st
    downward = s["az_imu"] + G0 * ct * cf
    return rate_of(s, "V"), forward * np.cos(alpha) + downward * np.sin(alpha)


def lateral_turn(s: ResampledChannels) -> Sides:
    """Return yaw rate times airspeed, and the side component of gravity and force. [m s-2]"""
    sf, _, _, ct = _attitude_functions(s)
    alpha = _angle_of_attack(s)
    side_force = s.values.get("ay_imu", np.zeros_like(alpha))
    stability_yaw_rate = s["r"] * np.cos(alpha) - s["p"] * np.sin(alpha)
    return s["V"] * stability_yaw_rate, G0 * ct * sf + side_force


def pull_up(s: ResampledChannels) -> Sides:
    """Return pitch rate times airspeed, and the upward acceleration. [m s-2]"""
    _, cf, _, ct = _attitude_functions(s)
    return s["q"] * s["V"], -(s["az_imu"] + G0 * ct * cf)


def vane_heave(s: ResampledChannels) -> Sides:
    """Return the rate of w = V sin(alpha), and q u + az + gravity. [m s-2]"""
    _, cf, _, ct = _attitude_functions(s)
    V, alpha = s["V"], s["alpha_vane"]
    w_rate = derivative(V * np.sin(alpha), s.step, window=5, order=2)
    return w_rate, s["q"] * V * np.cos(alpha) + s["az_imu"] + G0 * ct * cf


def vane_attitude(s: ResampledChannels) -> Sides:
    """Return the angle of the alpha vane, and that of attitude and climb. [rad]"""
    return s["alpha_vane"], _angle_of_attack_of_path(s)


def vane_slip(s: ResampledChannels) -> Sides:
    """Return the rate of v = V sin(beta), and p w - r u + ay + gravity. [m s-2]"""
    sf, _, _, ct = _attitude_functions(s)
    alpha = _angle_of_attack(s)
    turning = s["V"] * (s["p"] * np.sin(alpha) - s["r"] * np.cos(alpha))
    v_rate = derivative(s["V"] * np.sin(s["beta_vane"]), s.step, window=5, order=2)
    return v_rate, turning + G0 * ct * sf + s["ay_imu"]


def _divisor(cosine: np.ndarray) -> np.ndarray:
    """Return the cosine of pitch, limited where the Euler rates are singular."""
    return np.where(np.abs(cosine) < _SMALLEST_COSINE, _SMALLEST_COSINE, cosine)


def _attitude_functions(s: ResampledChannels) -> tuple[np.ndarray, ...]:
    """Return the sine and cosine of bank, and of pitch."""
    return np.sin(s["phi"]), np.cos(s["phi"]), np.sin(s["theta"]), np.cos(s["theta"])


def _angle_of_attack(s: ResampledChannels) -> np.ndarray:
    """Return the vane; without it the angle of attitude and climb; without these zero."""
    if "alpha_vane" in s:
        return np.clip(s["alpha_vane"], -_ALPHA_LIMIT, _ALPHA_LIMIT)
    if {"h_baro", "V"} <= set(s.values):
        return np.clip(_angle_of_attack_of_path(s), -_ALPHA_LIMIT, _ALPHA_LIMIT)
    return np.zeros_like(s.time)


def _angle_of_attack_of_path(s: ResampledChannels) -> np.ndarray:
    """Return the angle of attack that attitude and climb give without sideslip."""
    _, cf, st, ct = _attitude_functions(s)
    sine = rate_of(s, "h_baro") / np.maximum(np.abs(s["V"]), 1.0)
    sine = np.clip(sine, -1.0, 1.0)
    # sin(gamma) = cos(alpha) sin(theta) - sin(alpha) cos(phi) cos(theta) is a single sine of
    # amplitude (sin(theta)^2 + (cos(phi) cos(theta))^2)^(1/2), which is solved for alpha
    amplitude = np.maximum(np.hypot(st, cf * ct), 1e-3)
    return np.arctan2(st, cf * ct) - np.arcsin(np.clip(sine / amplitude, -1.0, 1.0))


def _force_of_ground_velocity(s: ResampledChannels) -> np.ndarray:
    """Return the acceleration of the ground velocity less gravity, body axes (3, time)."""
    sf, cf, st, ct = _attitude_functions(s)
    sp, cp = np.sin(s["psi"]), np.cos(s["psi"])
    north, east = rate_of(s, "vn"), rate_of(s, "ve")
    down = rate_of(s, "vd") - G0
    # rotations by heading, then pitch, then bank
    ahead, right = cp * north + sp * east, cp * east - sp * north
    below = st * ahead + ct * down
    return np.stack([ct * ahead - st * down, cf * right + sf * below, cf * below - sf * right])
