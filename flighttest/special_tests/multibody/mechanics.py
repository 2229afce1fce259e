"""Equations of motion of the tree by the recursive Newton-Euler algorithm of pinocchio, collected
on the independent coordinates.

M v' + C v + g = Q + tau                                  [Grauer2010] eq. (7), with Q the air loads that act on the vehicle (-a there)

Velocities v are those of the origin of the base and its rates, both along its axes, and the rates
of the independent joints.  The loads of the left side are S' RNEA(q, S v, S v' + S' v) with S the
derivative of all joint angles by the independent ones.

References
----------
.. [Grauer2010] Grauer, Ulrich, Hubbard, Pines, Humbert, System identification of an ornithopter aerodynamics model, AIAA 2010-7632.
.. [Featherstone2008] Featherstone, Rigid body dynamics algorithms, Springer 2008, chapter 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flightmech.errors import AeromatchError, SchemaError
from flighttest.special_tests.multibody.vehicle import Linkage, Vehicle


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
        """Return rates and accelerations of all joints from those of the independent ones (...,
        independent).
        """
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


def _four_bar(
    vehicle: Vehicle, name: str, linkage: Linkage, phi: np.ndarray
) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...]:
    """Angle, slope and bend of the joints of coupler and rocker."""
    crank, coupler, rocker = (
        vehicle.body[part] for part in (linkage.crank, linkage.coupler, linkage.rocker)
    )
    n = np.array(crank.axis) / np.linalg.norm(crank.axis)
    first = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
    first /= np.linalg.norm(first)
    second = np.cross(n, first)
    A0, B0, C0, D = (
        complex(np.dot(x, first), np.dot(x, second))
        for x in (
            coupler.at,
            linkage.pin_on_coupler,
            linkage.pin_on_rocker,
            np.subtract(rocker.at, crank.at),
        )
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
            [
                f"the loop of crank {a:g}, coupler {b:g} and rocker {c:g} m cannot close at "
                f"a crank angle of {stuck:.0f} deg"
            ],
        )
    arm = np.angle(E) + linkage.branch * np.arccos(cosine)  # of the rocker bar
    C = c * np.exp(1j * arm)
    B = E + C
    fa, fb, fc = np.angle(A), np.angle(B), np.angle(C)
    slope_b = a * np.sin(fa - fc) / (b * np.sin(fc - fb))
    slope_c = a * np.sin(fa - fb) / (c * np.sin(fc - fb))
    bend_c = (a * np.cos(fa - fb) + b * slope_b**2 - c * slope_c**2 * np.cos(fc - fb)) / (
        c * np.sin(fc - fb)
    )
    bend_b = (c * slope_c**2 - a * np.cos(fa - fc) - b * slope_b**2 * np.cos(fb - fc)) / (
        b * np.sin(fb - fc)
    )
    turn_b, turn_c = np.angle(B / (B0 * np.exp(1j * phi))), np.angle(C / C0)
    return (turn_b, slope_b - 1.0, bend_b), (turn_c, slope_c, bend_c)


_G = 9.80665


def inertial_loads(vehicle: Vehicle, p: np.ndarray, v: np.ndarray, v_dot: np.ndarray) -> np.ndarray:
    """Return the loads that the motion needs: inertia and weight.

    Parameters
    ----------
    vehicle : Vehicle
    p : array (time, 7 + independent)
        North, east, down of the origin of the base [m], its quaternion scalar first, angles of the
        independent joints [rad].
    v : array (time, 6 + independent)
        Velocity of that origin and rates of the base along its axes, rates of the joints. [m/s,
        rad/s]
    v_dot : array (time, 6 + independent)
        Their derivatives in time.

    Returns
    -------
    array (time, 6 + independent)
        Force and moment about the origin of the base along its axes [N, N m], moments on the
        independent joints [N m]: equal to the sum of air loads, springs and actuators.

    Raises
    ------
    AeromatchError
        pinocchio is not installed.
    """
    pin, model, order = _model(vehicle)
    data = model.createData()
    joints = joint_angles(vehicle, p[:, 7:])
    rate, bend = joints.rates(v[:, 6:], v_dot[:, 6:])
    q = np.concatenate([p[:, :3], p[:, 4:7], p[:, 3:4], joints.angle[:, order]], axis=1)
    v_all = np.concatenate([v[:, :6], rate[:, order]], axis=1)
    a_all = np.concatenate([v_dot[:, :6], bend[:, order]], axis=1)
    found = np.array([pin.rnea(model, data, *row) for row in zip(q, v_all, a_all)])
    moments = np.empty_like(joints.angle)
    moments[:, order] = found[:, 6:]
    return np.concatenate(
        [found[:, :6], joints.collected(moments, len(vehicle.independent))], axis=1
    )


def spring_loads(vehicle: Vehicle, theta: np.ndarray, theta_dot: np.ndarray) -> np.ndarray:
    """Return the moments of springs and dampers on the independent joints, (time, independent). [N
    m]
    """
    joints = joint_angles(vehicle, theta)
    rate, _ = joints.rates(theta_dot, np.zeros_like(theta_dot))
    moments = np.zeros_like(joints.angle)
    for name, spring in vehicle.spring.items():
        j = vehicle.joints.index(name)
        moments[:, j] = (
            -spring.stiffness * (joints.angle[:, j] - spring.rest) - spring.damping * rate[:, j]
        )
    return joints.collected(moments, len(vehicle.independent))


def actuator_loads(
    vehicle: Vehicle,
    theta: np.ndarray,
    theta_dot: np.ndarray,
    theta_ddot: np.ndarray,
    commands: dict[str, np.ndarray],
) -> np.ndarray:
    """Return the moments of the actuators on the independent joints, (B u - Ma a - Ca v - Ka p)/G
    of eq. (8), (time, independent). [N m]
    """
    found = np.zeros_like(theta)
    for name, drive in vehicle.actuator.items():
        k = vehicle.independent.index(name)
        u = commands[drive.command] if drive.command else 0.0
        found[:, k] = (
            drive.B * u
            - drive.Ma * theta_ddot[:, k]
            - drive.Ca * theta_dot[:, k]
            - drive.Ka * theta[:, k]
        ) / drive.G
    return found


def energy(vehicle: Vehicle, p: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return kinetic and potential energy of bodies and springs, (time,). [J]

    Its derivative is the power of air loads, dampers and actuators, ``(loads * v).sum(axis=1)``
    with the loads of `inertial_loads` less those that have a potential.
    """
    pin, model, order = _model(vehicle)
    data = model.createData()
    joints = joint_angles(vehicle, p[:, 7:])
    rate, _ = joints.rates(v[:, 6:], np.zeros_like(v[:, 6:]))
    q = np.concatenate([p[:, :3], p[:, 4:7], p[:, 3:4], joints.angle[:, order]], axis=1)
    v_all = np.concatenate([v[:, :6], rate[:, order]], axis=1)
    found = np.array(
        [
            pin.computeKineticEnergy(model, data, a, b) + pin.computePotentialEnergy(model, data, a)
            for a, b in zip(q, v_all)
        ]
    )
    for name, spring in vehicle.spring.items():
        found += (
            0.5
            * spring.stiffness
            * (joints.angle[:, vehicle.joints.index(name)] - spring.rest) ** 2
        )
    return found


def _model(vehicle: Vehicle) -> tuple[Any, Any, list[int]]:
    """The library, its model of the tree, and the joint of each of its coordinates after the base."""
    try:
        import pinocchio as pin
    except ImportError as missing:
        raise AeromatchError(
            "loads of a multibody vehicle need pinocchio, which is not installed; run: pip "
            "install 'aeromatch[multibody]'"
        ) from missing
    model = pin.Model()
    model.gravity.linear = np.array([0.0, 0.0, _G])  # north, east, down
    places = {}
    for name in vehicle.names:
        body = vehicle.body[name]
        if body.parent is None:
            places[name] = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), name)
        else:
            axis = np.array(body.axis) / np.linalg.norm(body.axis)
            where = pin.SE3(np.eye(3), np.array(body.at))
            places[name] = model.addJoint(
                places[body.parent], pin.JointModelRevoluteUnaligned(axis), where, name
            )
        model.appendBodyToJoint(
            places[name], pin.Inertia(body.mass, np.array(body.cg), body.matrix), pin.SE3.Identity()
        )
    order = sorted(
        range(len(vehicle.joints)), key=lambda j: model.joints[places[vehicle.joints[j]]].idx_v
    )
    return pin, model, order


@dataclass(frozen=True)
class Posture:
    """The tree relative to the base.

    Attributes
    ----------
    joints : JointAngles
    turn : dict of str to array (..., 3, 3)
        From axes of a body to those of the base.
    origin : dict of str to array (..., 3)
        Of a body, in axes of the base. [m]
    axis : dict of str to array (..., 3)
        Unit vector of the joint of a body, in axes of the base.
    """

    vehicle: Vehicle
    joints: JointAngles
    turn: dict[str, np.ndarray]
    origin: dict[str, np.ndarray]
    axis: dict[str, np.ndarray]

    def point(self, body: str, place: tuple[float, float, float]) -> np.ndarray:
        """Return a point of a body in axes of the base (..., 3). [m]"""
        return self.origin[body] + self.turn[body] @ np.array(place)

    def jacobian(self, body: str, point: np.ndarray) -> np.ndarray:
        """Return the change of a point (..., 3) of a body with the independent angles (..., 3,
        independent). [m]
        """
        names = self.vehicle.joints
        found = np.zeros((*point.shape, len(self.vehicle.independent)))
        name: str | None = body
        while name is not None and name != self.vehicle.base:
            j = names.index(name)
            moved = np.cross(self.axis[name], point - self.origin[name])
            found[..., self.joints.source[j]] += self.joints.slope[..., j, None] * moved
            name = self.vehicle.body[name].parent
        return found


def tree_posture(vehicle: Vehicle, theta: np.ndarray) -> Posture:
    """Return the tree at independent angles (..., independent). [rad]"""
    joints = joint_angles(vehicle, theta)
    shape = theta.shape[:-1]
    turn = {vehicle.base: np.broadcast_to(np.eye(3), (*shape, 3, 3))}
    origin, axis = {vehicle.base: np.zeros((*shape, 3))}, {}
    for j, name in enumerate(vehicle.joints):
        body = vehicle.body[name]
        assert body.parent is not None  # of a joint
        n = np.array(body.axis) / np.linalg.norm(body.axis)
        cross = np.array([[0.0, -n[2], n[1]], [n[2], 0.0, -n[0]], [-n[1], n[0], 0.0]])
        phi = joints.angle[..., j, None, None]
        local = np.eye(3) + np.sin(phi) * cross + (1.0 - np.cos(phi)) * (cross @ cross)
        up = turn[body.parent]
        turn[name], axis[name] = up @ local, up @ n
        origin[name] = origin[body.parent] + up @ np.array(body.at)
    return Posture(vehicle, joints, turn, origin, axis)
