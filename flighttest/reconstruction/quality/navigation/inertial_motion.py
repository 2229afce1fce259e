"""Ground velocity, airspeed and flow angles of a record against its accelerometers and gyros.

The fits of this module are made once.  Delays, heading and airspeed are judged from them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from flightmech.units import G0
from flighttest.reconstruction.quality.checks.formed_channels import source_channels
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.navigation.inertial_fit import (
    InertialFit,
    fit_inertial,
    integrate,
)

_ATTITUDE = ("phi", "theta")
_FORCES = ("ax_imu", "ay_imu", "az_imu")
AIRSPEEDS = ("V", "q_c", "V_cas", "mach", "V_eas")
"""Channels of the airspeed, in the order in which they are compared with inertial motion."""

# Lengths of stretches and largest delays. A stretch of airspeed must hold an acceleration, one of
# a flow angle only a short-period motion. [s]
_GROUND, _GROUND_DELAY = 30.0, 4.0
_AIR, _AIR_DELAY = 60.0, 5.0
_FLOW, _FLOW_DELAY = 12.0, 2.4
_SHORTEST_AIR = 20.0
_ANGLE_LIMIT = 0.6  # rad, of a flow angle that the equations use


@dataclass(frozen=True)
class MotionFits:
    """Fits by channel, and the recorded channel behind the airspeed.

    `ground` has vn, ve, vd; `air` the airspeeds, each judged alone; `flow` the vanes.
    """

    ground: dict[str, InertialFit]
    air: dict[str, InertialFit]
    flow: dict[str, InertialFit]

    @property
    def all(self) -> dict[str, InertialFit]:
        """All fits by channel."""
        return {**self.ground, **self.air, **self.flow}


def fit_motion(signals: ResampledChannels) -> MotionFits:
    """Return the fits that a record allows.

    Parameters
    ----------
    signals : ResampledChannels
        Without mistakes of signs, units and axes; accelerometers and vanes at the c.g.
    """
    if not {*_ATTITUDE, *_FORCES} <= set(signals.values):
        return MotionFits({}, {}, {})
    return MotionFits(
        _fit_ground(signals), dict(_fit_airspeeds(signals)), dict(_fit_vanes(signals))
    )


def airspeed_alone(signals: ResampledChannels, name: str) -> ResampledChannels:
    """Return the signals with the true airspeed of one channel, as `V`."""
    others = [other for other in AIRSPEEDS if other != name]
    return signals.without(others).completed(("V",))


def velocity_axes(signals: ResampledChannels, body: tuple[np.ndarray, ...]) -> np.ndarray:
    """Return a vector of body axes ahead, to the right and down, in level axes (3, time)."""
    sf, cf = np.sin(signals["phi"]), np.cos(signals["phi"])
    st, ct = np.sin(signals["theta"]), np.cos(signals["theta"])
    x, y, z = body
    # First the bank about x, then the pitch about y.
    below = sf * y + cf * z
    return np.stack([ct * x + st * below, cf * y - sf * z, ct * below - st * x])


def _fit_ground(signals: ResampledChannels) -> dict[str, InertialFit]:
    """Return the fits of vn, ve and vd.

    North and east velocity depend on both horizontal accelerations, so that an error of the
    heading is not taken for a delay.
    """
    ahead, right, down = velocity_axes(signals, tuple(signals[name] for name in _FORCES))
    needs: tuple[str, ...] = (*_ATTITUDE, *_FORCES)
    references: dict[str, tuple[np.ndarray, ...]] = {}
    if "psi" in signals:
        sp, cp = np.sin(signals["psi"]), np.cos(signals["psi"])
        north = integrate(cp * ahead - sp * right, signals.step)
        east = integrate(sp * ahead + cp * right, signals.step)
        references = {"vn": (north, east), "ve": (east, north)}
        needs = (*needs, "psi")
    references["vd"] = (integrate(down + G0, signals.step),)
    fits = {}
    for name, sides in references.items():
        if name not in signals:
            continue
        fit = fit_inertial(
            signals[name],
            sides,
            mask=signals.mask((*needs, name)),
            step=signals.step,
            stretch=_length(signals, _GROUND),
            longest=_GROUND_DELAY,
        )
        if fit is not None:
            fits[name] = fit
    return fits


def _length(signals: ResampledChannels, usual: float) -> float:
    """Return the length of a stretch, shorter in a short record. [s]"""
    return min(usual, 0.7 * float(signals.flying.sum()) * signals.step)


def _flow_angles(signals: ResampledChannels) -> tuple[np.ndarray, np.ndarray]:
    """Return alpha and beta of the vanes; zero without them. [rad]"""
    angles = []
    for name in ("alpha_vane", "beta_vane"):
        angle = signals.values.get(name, np.zeros_like(signals.time))
        angles.append(np.clip(angle, -_ANGLE_LIMIT, _ANGLE_LIMIT))
    return angles[0], angles[1]


def _accelerations(signals: ResampledChannels) -> tuple[np.ndarray, ...]:
    """Return specific force plus gravity along the body axes, three arrays. [m s-2]"""
    sf, cf = np.sin(signals["phi"]), np.cos(signals["phi"])
    st, ct = np.sin(signals["theta"]), np.cos(signals["theta"])
    gravity = (-G0 * st, G0 * ct * sf, G0 * ct * cf)
    return tuple(signals[name] + part for name, part in zip(_FORCES, gravity, strict=True))


def _fit_airspeeds(signals: ResampledChannels) -> Iterator[tuple[str, InertialFit]]:
    """Yield the fit of each airspeed against the acceleration along the path.

    V_dot = (ax cos(alpha) + az sin(alpha)) cos(beta) + ay sin(beta), in air of constant wind. A
    wind that changes linearly with height adds terms of the height: a phugoid exchanges height and
    speed, and a shear of 0.01/s would look like a scale error of 9 %.
    """
    ax, ay, az = _accelerations(signals)
    alpha, beta = _flow_angles(signals)
    along = (ax * np.cos(alpha) + az * np.sin(alpha)) * np.cos(beta) + ay * np.sin(beta)
    references = (integrate(along, signals.step), *_wind_shear(signals))
    stretch = _length(signals, _AIR)
    if stretch < _SHORTEST_AIR:
        return
    for name in AIRSPEEDS:
        if name not in signals:
            continue
        alone = airspeed_alone(signals, name)
        if "V" not in alone or (
            name != "V" and name not in source_channels("V", alone_names(alone))
        ):
            continue
        fit = fit_inertial(
            alone["V"],
            references,
            mask=alone.mask((*_ATTITUDE, *_FORCES, "V")),
            step=signals.step,
            stretch=stretch,
            longest=_AIR_DELAY,
        )
        if fit is not None:
            yield name, fit


def _wind_shear(signals: ResampledChannels) -> tuple[np.ndarray, ...]:
    """Return the terms of a wind that changes with height; none without a height."""
    height = signals.values.get("h_baro", signals.values.get("h_gps"))
    if height is None:
        return ()
    if "psi" not in signals:
        return (height,)
    return height * np.cos(signals["psi"]), height * np.sin(signals["psi"])


def alone_names(signals: ResampledChannels) -> set[str]:
    """Return the recorded channels of signals with a formed airspeed."""
    return set(signals.values) - {"V"}


def _fit_vanes(signals: ResampledChannels) -> Iterator[tuple[str, InertialFit]]:
    """Yield the fits of the vanes.

    w_dot = q u - p v + az and v_dot = p w - r u + ay, with the accelerations of gravity added.
    """
    completed = signals.completed(("V",))
    if "V" not in completed or not {"p", "q", "r"} <= set(signals.values):
        return
    V = completed["V"]
    alpha, beta = _flow_angles(signals)
    _, ay, az = _accelerations(signals)
    # Velocity in body axes, of the flow angles and the airspeed.
    u, v, w = (V * np.cos(alpha) * np.cos(beta), V * np.sin(beta), V * np.sin(alpha))
    rates = {
        "alpha_vane": signals["q"] * u - signals["p"] * v + az,
        "beta_vane": signals["p"] * w - signals["r"] * u + ay,
    }
    for name, rate in rates.items():
        if name not in signals:
            continue
        fit = fit_inertial(
            V * np.sin(signals[name]),
            (integrate(rate, signals.step),),
            mask=completed.mask((*_ATTITUDE, *_FORCES, "p", "q", "r", "V", name)),
            step=signals.step,
            stretch=_length(signals, _FLOW),
            longest=_FLOW_DELAY,
        )
        if fit is not None:
            yield name, fit
