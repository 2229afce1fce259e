"""Equations of motion of the tree by the recursive Newton-Euler algorithm of pinocchio, collected on the independent coordinates.

M v' + C v + g = Q + tau                                  [Grauer2010] eq. (7), with Q the air loads that act on the vehicle (-a there)

Velocities v are those of the origin of the base and its rates, both along its axes, and the rates of the independent joints.  The loads
of the left side are S' RNEA(q, S v, S v' + S' v) with S the derivative of all joint angles by the independent ones.

References
----------
.. [Grauer2010] Grauer, Ulrich, Hubbard, Pines, Humbert, System identification of an ornithopter aerodynamics model, AIAA 2010-7632.
.. [Featherstone2008] Featherstone, Rigid body dynamics algorithms, Springer 2008, chapter 5.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flightmech.errors import AeromatchError

from .joints import joint_angles
from .vehicle import Vehicle

_G = 9.80665


def inertial_loads(vehicle: Vehicle, p: np.ndarray, v: np.ndarray, v_dot: np.ndarray) -> np.ndarray:
    """Return the loads that the motion needs: inertia and weight.

    Parameters
    ----------
    vehicle : Vehicle
    p : array (time, 7 + independent)
        North, east, down of the origin of the base [m], its quaternion scalar first, angles of the independent joints [rad].
    v : array (time, 6 + independent)
        Velocity of that origin and rates of the base along its axes, rates of the joints. [m/s, rad/s]
    v_dot : array (time, 6 + independent)
        Their derivatives in time.

    Returns
    -------
    array (time, 6 + independent)
        Force and moment about the origin of the base along its axes [N, N m], moments on the independent joints [N m]: equal to the sum
        of air loads, springs and actuators.

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
    return np.concatenate([found[:, :6], joints.collected(moments, len(vehicle.independent))], axis=1)


def spring_loads(vehicle: Vehicle, theta: np.ndarray, theta_dot: np.ndarray) -> np.ndarray:
    """Return the moments of springs and dampers on the independent joints, (time, independent). [N m]"""
    joints = joint_angles(vehicle, theta)
    rate, _ = joints.rates(theta_dot, np.zeros_like(theta_dot))
    moments = np.zeros_like(joints.angle)
    for name, spring in vehicle.spring.items():
        j = vehicle.joints.index(name)
        moments[:, j] = -spring.stiffness * (joints.angle[:, j] - spring.rest) - spring.damping * rate[:, j]
    return joints.collected(moments, len(vehicle.independent))


def actuator_loads(
    vehicle: Vehicle, theta: np.ndarray, theta_dot: np.ndarray, theta_ddot: np.ndarray, commands: dict[str, np.ndarray]
) -> np.ndarray:
    """Return the moments of the actuators on the independent joints, (B u - Ma a - Ca v - Ka p)/G of eq. (8), (time, independent). [N m]"""
    found = np.zeros_like(theta)
    for name, drive in vehicle.actuator.items():
        k = vehicle.independent.index(name)
        u = commands[drive.command] if drive.command else 0.0
        found[:, k] = (drive.B * u - drive.Ma * theta_ddot[:, k] - drive.Ca * theta_dot[:, k] - drive.Ka * theta[:, k]) / drive.G
    return found


def energy(vehicle: Vehicle, p: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return kinetic and potential energy of bodies and springs, (time,). [J]

    Its derivative is the power of air loads, dampers and actuators, ``(loads * v).sum(axis=1)`` with the loads of `inertial_loads` less
    those that have a potential.
    """
    pin, model, order = _model(vehicle)
    data = model.createData()
    joints = joint_angles(vehicle, p[:, 7:])
    rate, _ = joints.rates(v[:, 6:], np.zeros_like(v[:, 6:]))
    q = np.concatenate([p[:, :3], p[:, 4:7], p[:, 3:4], joints.angle[:, order]], axis=1)
    v_all = np.concatenate([v[:, :6], rate[:, order]], axis=1)
    found = np.array([pin.computeKineticEnergy(model, data, a, b) + pin.computePotentialEnergy(model, data, a) for a, b in zip(q, v_all)])
    for name, spring in vehicle.spring.items():
        found += 0.5 * spring.stiffness * (joints.angle[:, vehicle.joints.index(name)] - spring.rest) ** 2
    return found


def _model(vehicle: Vehicle) -> tuple[Any, Any, list[int]]:
    """The library, its model of the tree, and the joint of each of its coordinates after the base."""
    try:
        import pinocchio as pin
    except ImportError as missing:
        raise AeromatchError(
            "loads of a multibody vehicle need pinocchio, which is not installed; run: pip install 'aeromatch[multibody]'"
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
            places[name] = model.addJoint(places[body.parent], pin.JointModelRevoluteUnaligned(axis), where, name)
        model.appendBodyToJoint(places[name], pin.Inertia(body.mass, np.array(body.cg), body.matrix), pin.SE3.Identity())
    order = sorted(range(len(vehicle.joints)), key=lambda j: model.joints[places[vehicle.joints[j]]].idx_v)
    return pin, model, order
