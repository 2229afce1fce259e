"""Where points of the bodies are relative to the base, and how that changes with the independent angles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .joints import JointAngles, joint_angles
from .vehicle import Vehicle


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
        """Return the change of a point (..., 3) of a body with the independent angles (..., 3, independent). [m]"""
        names = self.vehicle.joints
        found = np.zeros((*point.shape, len(self.vehicle.independent)))
        name: str | None = body
        while name is not None and name != self.vehicle.base:
            j = names.index(name)
            moved = np.cross(self.axis[name], point - self.origin[name])
            found[..., self.joints.source[j]] += self.joints.slope[..., j, None] * moved
            name = self.vehicle.body[name].parent
        return found


def posture(vehicle: Vehicle, theta: np.ndarray) -> Posture:
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
