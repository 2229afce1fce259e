"""Equations of motion of a tree of bodies, on its independent coordinates.

The loads of all joints follow from the recursive Newton-Euler algorithm (RNEA) of pinocchio.

    M v' + C v + g = Q + tau                            [Grauer2010] eq. (7)

Q are the air loads that act on the vehicle (-a in the report).  The velocities v are those of the
origin of the base and its rates, both along its axes, and the rates of the independent joints.  The
left side is S' RNEA(q, S v, S v' + S' v), with S the derivative of all joint angles by the
independent ones.

References
----------
.. [Grauer2010] Grauer, Ulrich, Hubbard, Pines, Humbert, System identification of an ornithopter
   aerodynamics model, AIAA 2010-7632.
.. [Featherstone2008] Featherstone, Rigid body dynamics algorithms, Springer 2008, chapter 5.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flightmech.errors import AeromatchError, SchemaError
from flighttest.special_tests.multibody.joints import Linkage
from flighttest.special_tests.multibody.vehicle import Vehicle

# Acceleration of gravity [m s-2].
_G = 9.80665


@dataclass(frozen=True)
class JointAngles:
    """Angles of all joints of a vehicle.

    Attributes
    ----------
    angle, slope, bend : array (..., joint)
        Angle, its first and second derivative by the independent angle. [rad]
    source : array of int (joint,)
        Independent joint on which each joint depends.
    """

    angle: np.ndarray
    slope: np.ndarray
    bend: np.ndarray
    source: np.ndarray

    def rates(self, theta_dot: np.ndarray, theta_ddot: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return rates and accelerations of all joints from those of the independent ones.

        The arguments have the shape (..., independent), the results (..., joint).
        """
        rate = theta_dot[..., self.source]
        return self.slope * rate, self.slope * theta_ddot[..., self.source] + self.bend * rate**2

    def collected(self, moments: np.ndarray, independent: int) -> np.ndarray:
        """Return generalised moments (..., independent) of moments on all joints (..., joint)."""
        generalised = np.zeros((*moments.shape[:-1], independent))
        for j, k in enumerate(self.source):
            generalised[..., k] += self.slope[..., j] * moments[..., j]
        return generalised


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
        A linkage cannot close at these angles.
    """
    column = {name: j for j, name in enumerate(vehicle.joints)}
    independent = vehicle.independent
    shape = (*theta.shape[:-1], len(column))
    angle, slope, bend = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    # -1: the joint has no angle yet
    source = np.full(len(column), -1)
    for k, name in enumerate(independent):
        j = column[name]
        angle[..., j], slope[..., j], source[j] = theta[..., k], 1.0, k
    for name, linkage in vehicle.linkage.items():
        k = independent.index(linkage.crank)
        solution = _solve_four_bar(vehicle, name, linkage, phi=theta[..., k])
        for part, values in zip((linkage.coupler, linkage.rocker), solution, strict=True):
            j = column[part]
            (angle[..., j], slope[..., j], bend[..., j]), source[j] = values, k
    # a gear may follow a joint that is itself geared
    waiting = dict(vehicle.gear)
    while waiting:
        ready = [name for name, gear in waiting.items() if source[column[gear.follows]] >= 0]
        for name in ready:
            gear = waiting.pop(name)
            j, i = column[name], column[gear.follows]
            angle[..., j], source[j] = gear.ratio * angle[..., i] + gear.offset, source[i]
            slope[..., j], bend[..., j] = gear.ratio * slope[..., i], gear.ratio * bend[..., i]
    return JointAngles(angle, slope, bend=bend, source=source)


def _solve_four_bar(
    vehicle: Vehicle, name: str, linkage: Linkage, *, phi: np.ndarray
) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...]:
    """Return angle, slope and bend of the joints of coupler and rocker by the crank angle phi.

    The bars are complex numbers in the plane of the linkage. The bars of the closed loop satisfy
    crank A + coupler B = distance D of the pivots + rocker C.
    """
    crank, coupler = vehicle.body[linkage.crank], vehicle.body[linkage.coupler]
    pivots = np.subtract(vehicle.body[linkage.rocker].at, crank.at)
    bars = (coupler.at, linkage.pin_on_coupler, linkage.pin_on_rocker, pivots)
    A0, B0, C0, D = _project_on_plane(crank.axis, bars)
    a, b, c = abs(A0), abs(B0), abs(C0)
    if min(a, b, c) == 0.0:
        raise SchemaError(f"linkage.{name}", ["a bar has no length across the axis"])
    A = A0 * np.exp(1j * phi)
    # E is the vector from the pin of crank and coupler to the pivot of the rocker; the law of
    # cosines gives the angle between E and the rocker
    E = D - A
    cosine = (b**2 - np.abs(E) ** 2 - c**2) / (2.0 * np.abs(E) * c)
    if not (np.abs(cosine) < 1.0).all():
        stuck = np.degrees(phi[np.abs(cosine) >= 1.0].flat[0])
        problem = (
            f"the loop of crank {a:g}, coupler {b:g} and rocker {c:g} m cannot close at a crank "
            f"angle of {stuck:.0f} deg"
        )
        raise SchemaError(f"linkage.{name}", [problem])
    rocker_angle = np.angle(E) + linkage.branch * np.arccos(cosine)
    C = c * np.exp(1j * rocker_angle)
    B = E + C
    # first and second derivative of the loop with respect to the crank angle
    fa, fb, fc = np.angle(A), np.angle(B), np.angle(C)
    slope_b = a * np.sin(fa - fc) / (b * np.sin(fc - fb))
    slope_c = a * np.sin(fa - fb) / (c * np.sin(fc - fb))
    bend_c = (a * np.cos(fa - fb) + b * slope_b**2 - c * slope_c**2 * np.cos(fc - fb)) / (
        c * np.sin(fc - fb)
    )
    bend_b = (c * slope_c**2 - a * np.cos(fa - fc) - b * slope_b**2 * np.cos(fb - fc)) / (
        b * np.sin(fb - fc)
    )
    # joint angles count from the position at zero; the coupler turns on the crank
    turn_b, turn_c = np.angle(B / (B0 * np.exp(1j * phi))), np.angle(C / C0)
    return (turn_b, slope_b - 1.0, bend_b), (turn_c, slope_c, bend_c)


def _project_on_plane(axis: Sequence[float], vectors: Iterable[Any]) -> list[complex]:
    """Return vectors across an axis as complex numbers."""
    n = np.array(axis) / np.linalg.norm(axis)
    # the coordinate axis that is least along n has the longest cross product
    first = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
    first /= np.linalg.norm(first)
    second = np.cross(n, first)
    return [complex(np.dot(x, first), np.dot(x, second)) for x in vectors]


def inertial_loads(vehicle: Vehicle, p: np.ndarray, v: np.ndarray, v_dot: np.ndarray) -> np.ndarray:
    """Return the loads that the motion requires: inertia and weight.

    Parameters
    ----------
    vehicle : Vehicle
    p : array (time, 7 + independent)
        North, east, down of the origin of the base [m], its quaternion scalar first, angles of the
        independent joints [rad].
    v : array (time, 6 + independent)
        Velocity of the origin and rates of the base along its axes, rates of the joints. [m/s,
        rad/s]
    v_dot : array (time, 6 + independent)
        Derivatives of `v` in time.

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
    pin, model, order = _build_model(vehicle)
    data = model.createData()
    joints = joint_angles(vehicle, p[:, 7:])
    rate, acceleration = joints.rates(v[:, 6:], v_dot[:, 6:])
    q, v_all = _model_states(p, v, angle=joints.angle[:, order], rate=rate[:, order])
    a_all = np.concatenate([v_dot[:, :6], acceleration[:, order]], axis=1)
    loads = np.array([pin.rnea(model, data, *row) for row in zip(q, v_all, a_all, strict=True)])
    moments = np.empty_like(joints.angle)
    moments[:, order] = loads[:, 6:]
    generalised = joints.collected(moments, len(vehicle.independent))
    return np.concatenate([loads[:, :6], generalised], axis=1)


def _model_states(
    p: np.ndarray, v: np.ndarray, *, angle: np.ndarray, rate: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and velocities in the order of pinocchio, whose quaternion ends scalar."""
    q = np.concatenate([p[:, :3], p[:, 4:7], p[:, 3:4], angle], axis=1)
    return q, np.concatenate([v[:, :6], rate], axis=1)


def spring_loads(vehicle: Vehicle, theta: np.ndarray, theta_dot: np.ndarray) -> np.ndarray:
    """Return the moments of springs and dampers on the independent joints. [N m]"""
    joints = joint_angles(vehicle, theta)
    rate, _ = joints.rates(theta_dot, np.zeros_like(theta_dot))
    moments = np.zeros_like(joints.angle)
    for name, spring in vehicle.spring.items():
        j = vehicle.joints.index(name)
        turn = joints.angle[:, j] - spring.rest
        moments[:, j] = -spring.stiffness * turn - spring.damping * rate[:, j]
    return joints.collected(moments, len(vehicle.independent))


def actuator_loads(
    vehicle: Vehicle,
    theta: np.ndarray,
    theta_dot: np.ndarray,
    theta_ddot: np.ndarray,
    commands: dict[str, np.ndarray],
) -> np.ndarray:
    """Return the moments of the actuators on the independent joints, (time, independent). [N m]

    The moment is (B u - Ma a - Ca v - Ka p)/G, [Grauer2010] eq. (8).
    """
    moments = np.zeros_like(theta)
    for name, drive in vehicle.actuator.items():
        k = vehicle.independent.index(name)
        u = commands[drive.command] if drive.command else 0.0
        moments[:, k] = (
            drive.B * u
            - drive.Ma * theta_ddot[:, k]
            - drive.Ca * theta_dot[:, k]
            - drive.Ka * theta[:, k]
        ) / drive.G
    return moments


def energy(vehicle: Vehicle, p: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return kinetic and potential energy of bodies and springs, (time,). [J]

    The derivative of the energy is the power of air loads, dampers and actuators.  It is ``(loads *
    v).sum(axis=1)`` with the loads of `inertial_loads` less the loads with a potential.
    """
    pin, model, order = _build_model(vehicle)
    data = model.createData()
    joints = joint_angles(vehicle, p[:, 7:])
    rate, _ = joints.rates(v[:, 6:], np.zeros_like(v[:, 6:]))
    q, v_all = _model_states(p, v, angle=joints.angle[:, order], rate=rate[:, order])
    energies = []
    for position, velocity in zip(q, v_all, strict=True):
        kinetic = pin.computeKineticEnergy(model, data, position, velocity)
        energies.append(kinetic + pin.computePotentialEnergy(model, data, position))
    total = np.array(energies)
    for name, spring in vehicle.spring.items():
        turn = joints.angle[:, vehicle.joints.index(name)] - spring.rest
        total += 0.5 * spring.stiffness * turn**2
    return total


def _build_model(vehicle: Vehicle) -> tuple[Any, Any, list[int]]:
    """Return the library, its model of the tree, and the joints in its order."""
    # pinocchio is an optional extra
    try:
        import pinocchio as pin
    except ImportError as missing:
        raise AeromatchError(
            "loads of a multibody vehicle need pinocchio, which is not installed; run: pip "
            "install 'aeromatch[multibody]'"
        ) from missing
    model = pin.Model()
    # north, east, down: gravity is positive
    model.gravity.linear = np.array([0.0, 0.0, _G])
    joints: dict[str, int] = {}
    for name in vehicle.names:
        body = vehicle.body[name]
        if body.parent is None:
            joints[name] = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), name)
        else:
            axis = np.array(body.axis) / np.linalg.norm(body.axis)
            origin = pin.SE3(np.eye(3), np.array(body.at))
            joint = pin.JointModelRevoluteUnaligned(axis)
            joints[name] = model.addJoint(joints[body.parent], joint, origin, name)
        inertia = pin.Inertia(body.mass, np.array(body.cg), body.matrix)
        model.appendBodyToJoint(joints[name], inertia, pin.SE3.Identity())
    # pinocchio has its own order of the coordinates
    indices = [model.joints[joints[name]].idx_v for name in vehicle.joints]
    return pin, model, sorted(range(len(indices)), key=lambda j: indices[j])


@dataclass(frozen=True)
class Posture:
    """Tree of bodies relative to its base.

    Attributes
    ----------
    joints : JointAngles
    turn : dict of str to array (..., 3, 3)
        Matrix from axes of a body to axes of the base.
    origin : dict of str to array (..., 3)
        Origin of a body, in axes of the base. [m]
    axis : dict of str to array (..., 3)
        Unit vector of the joint of a body, in axes of the base.
    """

    vehicle: Vehicle
    joints: JointAngles
    turn: dict[str, np.ndarray]
    origin: dict[str, np.ndarray]
    axis: dict[str, np.ndarray]

    def point(self, body: str, position: tuple[float, float, float]) -> np.ndarray:
        """Return a point of a body in axes of the base (..., 3). [m]"""
        return self.origin[body] + self.turn[body] @ np.array(position)

    def jacobian(self, body: str, point: np.ndarray) -> np.ndarray:
        """Return the change of a point of a body with the independent angles. [m]

        The point has the shape (..., 3), the result (..., 3, independent).
        """
        names = self.vehicle.joints
        jacobian = np.zeros((*point.shape, len(self.vehicle.independent)))
        # every joint between the body and the base moves the point
        name: str | None = body
        while name is not None and name != self.vehicle.base:
            j = names.index(name)
            change = np.cross(self.axis[name], point - self.origin[name])
            jacobian[..., self.joints.source[j]] += self.joints.slope[..., j, None] * change
            name = self.vehicle.body[name].parent
        return jacobian


def tree_posture(vehicle: Vehicle, theta: np.ndarray) -> Posture:
    """Return the tree at independent angles (..., independent). [rad]"""
    joints = joint_angles(vehicle, theta)
    shape = theta.shape[:-1]
    turn = {vehicle.base: np.broadcast_to(np.eye(3), (*shape, 3, 3))}
    origin, axis = {vehicle.base: np.zeros((*shape, 3))}, {}
    for j, name in enumerate(vehicle.joints):
        body = vehicle.body[name]
        # every body with a joint has a parent
        assert body.parent is not None
        n = np.array(body.axis) / np.linalg.norm(body.axis)
        # Rodrigues' formula of a turn about the axis of the joint
        cross = np.array([[0.0, -n[2], n[1]], [n[2], 0.0, -n[0]], [-n[1], n[0], 0.0]])
        phi = joints.angle[..., j, None, None]
        local = np.eye(3) + np.sin(phi) * cross + (1.0 - np.cos(phi)) * (cross @ cross)
        parent = turn[body.parent]
        turn[name], axis[name] = parent @ local, parent @ n
        origin[name] = origin[body.parent] + parent @ np.array(body.at)
    return Posture(vehicle, joints, turn=turn, origin=origin, axis=axis)
