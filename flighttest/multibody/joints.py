"""Angles of all joints from the independent ones, with first and second derivatives: gears and planar four-bars.

Each joint depends on one independent angle at most.  In the plane of a four-bar, A + B = D + C with the bars A, B, C of crank, coupler and
rocker as complex numbers and D from the pivot of the crank to that of the rocker.  Rocker and coupler follow in closed form from the angle
of the crank; the other way round the equation is singular where the rocker reverses, so the crank is the coordinate [Grauer2010].

References
----------
.. [Grauer2010] Grauer, Ulrich, Hubbard, Pines, Humbert, System identification of an ornithopter aerodynamics model, AIAA 2010-7632.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flightmech.errors import SchemaError

from .vehicle import Linkage, Vehicle


@dataclass(frozen=True)
class JointAngles:
    """Angles of all joints of a vehicle.

    Attributes
    ----------
    angle, slope, bend : array (..., joint)
        Angle, its first and second derivative by the independent angle. [rad]
    source : array of int (joint,)
        Independent joint on which each depends.
    """

    angle: np.ndarray
    slope: np.ndarray
    bend: np.ndarray
    source: np.ndarray

    def rates(self, theta_dot: np.ndarray, theta_ddot: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return rates and accelerations of all joints from those of the independent ones (..., independent)."""
        rate = theta_dot[..., self.source]
        return self.slope * rate, self.slope * theta_ddot[..., self.source] + self.bend * rate**2

    def collected(self, moments: np.ndarray, independent: int) -> np.ndarray:
        """Return the generalised moments (..., independent) of moments on all joints (..., joint)."""
        found = np.zeros((*moments.shape[:-1], independent))
        for j, k in enumerate(self.source):
            found[..., k] += self.slope[..., j] * moments[..., j]
        return found


def joint_angles(vehicle: Vehicle, theta: np.ndarray) -> JointAngles:
    """Return the angles of all joints.

    Parameters
    ----------
    vehicle : Vehicle
    theta : array (..., independent)
        Angles of `Vehicle.independent`. [rad]

    Raises
    ------
    SchemaError
        A linkage that cannot close at these angles.
    """
    places, independent = {name: j for j, name in enumerate(vehicle.joints)}, vehicle.independent
    angle, slope, bend = (np.zeros((*theta.shape[:-1], len(places))) for _ in range(3))
    source = np.full(len(places), -1)
    for k, name in enumerate(independent):
        j = places[name]
        angle[..., j], slope[..., j], source[j] = theta[..., k], 1.0, k
    for name, linkage in vehicle.linkage.items():
        k = independent.index(linkage.crank)
        found = _four_bar(vehicle, name, linkage, theta[..., k])
        for part, values in zip((linkage.coupler, linkage.rocker), found):
            j = places[part]
            (angle[..., j], slope[..., j], bend[..., j]), source[j] = values, k
    waiting = dict(vehicle.gear)
    while waiting:
        for name in [name for name, gear in waiting.items() if source[places[gear.follows]] >= 0]:
            gear = waiting.pop(name)
            j, i = places[name], places[gear.follows]
            angle[..., j], source[j] = gear.ratio * angle[..., i] + gear.offset, source[i]
            slope[..., j], bend[..., j] = gear.ratio * slope[..., i], gear.ratio * bend[..., i]
    return JointAngles(angle, slope, bend, source)


def _four_bar(vehicle: Vehicle, name: str, linkage: Linkage, phi: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...]:
    """Angle, slope and bend of the joints of coupler and rocker."""
    crank, coupler, rocker = (vehicle.body[part] for part in (linkage.crank, linkage.coupler, linkage.rocker))
    n = np.array(crank.axis) / np.linalg.norm(crank.axis)
    first = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
    first /= np.linalg.norm(first)
    second = np.cross(n, first)
    A0, B0, C0, D = (
        complex(np.dot(x, first), np.dot(x, second))
        for x in (coupler.at, linkage.pin_on_coupler, linkage.pin_on_rocker, np.subtract(rocker.at, crank.at))
    )
    a, b, c = abs(A0), abs(B0), abs(C0)
    if min(a, b, c) == 0.0:
        raise SchemaError(f"linkage.{name}", ["a bar has no length across the axis"])
    A = A0 * np.exp(1j * phi)
    E = D - A
    cosine = (b**2 - np.abs(E) ** 2 - c**2) / (2.0 * np.abs(E) * c)
    if not (np.abs(cosine) < 1.0).all():
        stuck = np.degrees(phi[np.abs(cosine) >= 1.0].flat[0])
        raise SchemaError(
            f"linkage.{name}",
            [f"the loop of crank {a:g}, coupler {b:g} and rocker {c:g} m cannot close at a crank angle of {stuck:.0f} deg"],
        )
    arm = np.angle(E) + linkage.branch * np.arccos(cosine)  # of the rocker bar
    C = c * np.exp(1j * arm)
    B = E + C
    fa, fb, fc = np.angle(A), np.angle(B), np.angle(C)
    slope_b = a * np.sin(fa - fc) / (b * np.sin(fc - fb))
    slope_c = a * np.sin(fa - fb) / (c * np.sin(fc - fb))
    bend_c = (a * np.cos(fa - fb) + b * slope_b**2 - c * slope_c**2 * np.cos(fc - fb)) / (c * np.sin(fc - fb))
    bend_b = (c * slope_c**2 - a * np.cos(fa - fc) - b * slope_b**2 * np.cos(fb - fc)) / (b * np.sin(fb - fc))
    turn_b, turn_c = np.angle(B / (B0 * np.exp(1j * phi))), np.angle(C / C0)
    return (turn_b, slope_b - 1.0, bend_b), (turn_c, slope_c, bend_c)
