"""Wheels of an aircraft: which share their constants, where they stand and how their points on the runway move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech import Aircraft
from flightmech.aircraft.systems.landing_gear import Contact
from flightmech.axes import rotation
from flightmech.errors import IdentificationError, UnknownName

_SAME = 1e-3  # two positions that differ by less are mirror images [m]


@dataclass(frozen=True)
class WheelGroup:
    """Wheels that are mirror images of each other and share their constants.

    Attributes
    ----------
    names : tuple of str
        Contacts of the aircraft.
    """

    names: tuple[str, ...]

    @property
    def label(self) -> str:
        """``left,right``."""
        return ",".join(self.names)

    def parameter(self, constant: str) -> str:
        """Return the name of a constant of the group: ``gear.left,right.stiffness``."""
        return f"gear.{self.label}.{constant}"

    def targets(self, constant: str) -> tuple[str, ...]:
        """Return the parameters of the simulation that it stands for."""
        return tuple(f"gear.{name}.{constant}" for name in self.names)


def wheels_of(aircraft: Aircraft) -> tuple[Contact, ...]:
    """Return the contacts that roll.

    Raises
    ------
    IdentificationError
        The aircraft has no wheels.
    """
    found = tuple(contact for contact in (aircraft.gear.contacts if aircraft.gear else ()) if contact.friction == 0.0)
    if not found:
        raise IdentificationError(f"{aircraft.name} has no wheels; give [[gear.contact]] with position and side_stiffness in its file")
    return found


def wheel_groups(aircraft: Aircraft) -> tuple[WheelGroup, ...]:
    """Return the wheels of an aircraft, mirror images together."""
    groups: list[list[Contact]] = []
    for wheel in wheels_of(aircraft):
        mirrored = np.array(wheel.position) * (1.0, -1.0, 1.0)
        like = next((group for group in groups if np.abs(mirrored - group[0].position).max() < _SAME), None)
        if like is None:
            groups.append([wheel])
        else:
            like.append(wheel)
    return tuple(WheelGroup(tuple(wheel.name for wheel in group)) for group in groups)


@dataclass(frozen=True)
class Places:
    """Points where wheels touch the runway, and their motion over it.

    Attributes
    ----------
    down : array (time, 3)
        Unit vector, body axes.
    forward, right : array (time, 3)
        Of the aircraft in the plane of the runway, body axes.
    arm : array (time, wheel, 3)
        From the c.g., body axes. [m]
    height : array (time,)
        Of the c.g. over the runway. [m]
    v_along, v_across : array (time, wheel)
        Velocity over the runway along and across the rolling direction, the latter to the right. [m s-1]
    rate : array (time, wheel)
        Of compression along the leg as the motion of the airframe gives it. [m s-1]
    """

    down: np.ndarray
    forward: np.ndarray
    right: np.ndarray
    arm: np.ndarray
    height: np.ndarray
    v_along: np.ndarray
    v_across: np.ndarray
    rate: np.ndarray


def column(states: xr.Dataset, name: str, default: float | None = None) -> np.ndarray:
    """Return a state over time, or its default where the record has none.

    Raises
    ------
    UnknownName
        It is missing and has no default.
    """
    if name not in states:
        if default is None:
            raise UnknownName(name, map(str, states.data_vars), "state", "the landing gear needs it")
        return np.full(states.sizes["time"], float(default))
    return np.broadcast_to(np.asarray(states[name].values, float), (states.sizes["time"],))


def places(states: xr.Dataset, aircraft: Aircraft, steering: np.ndarray) -> Places:
    """Return where the wheels stand, with leg along body z as the kernel has it (docs/landing-gear.md).

    Parameters
    ----------
    states : Dataset (time,)
        ``phi theta psi p q r vn ve vd``, ``gear.<wheel>.compression``. [SI]
    aircraft : Aircraft
    steering : array (time,)
        Angle of the steering, to the right. [rad]
    """
    wheels = wheels_of(aircraft)
    C = rotation(*(column(states, name) for name in ("phi", "theta", "psi")))
    down = C[:, :, 2]
    omega = np.stack([column(states, name) for name in ("p", "q", "r")], axis=1)
    v = np.einsum("tij,tj->ti", C, np.stack([column(states, name) for name in ("vn", "ve", "vd")], axis=1))
    cg = np.stack([column(states, f"{axis}_cg_b", value) for axis, value in zip("xyz", aircraft.cg)], axis=1)
    arm = np.stack([_arm(wheel, down, cg, column(states, f"gear.{wheel.name}.compression")) for wheel in wheels], axis=1)
    speed = v[:, None, :] + np.cross(omega[:, None, :], arm)
    rate = np.einsum("twi,ti->tw", speed, down) / down[:, None, 2]
    speed[:, :, 2] -= rate
    forward, right = _plane_axes(down, np.zeros(len(down)))
    along, across = np.empty(rate.shape), np.empty(rate.shape)
    for k, wheel in enumerate(wheels):
        ahead, aside = _plane_axes(down, wheel.steering * steering)
        along[:, k], across[:, k] = (np.einsum("ti,ti->t", speed[:, k], axis) for axis in (ahead, aside))
    height = np.einsum("twi,ti->tw", arm, down).mean(axis=1)
    return Places(down, forward, right, arm, height, along, across, rate)


def _arm(wheel: Contact, down: np.ndarray, cg: np.ndarray, compression: np.ndarray) -> np.ndarray:
    """The point where the leg stands: lowest point of the round tyre, moved up the leg by its compression."""
    in_plane = np.hypot(down[:, 0], down[:, 2])
    rim = wheel.radius * np.stack([down[:, 0] / in_plane, np.zeros(len(down)), down[:, 2] / in_plane - 1.0], axis=1)
    arm = np.asarray(wheel.position, float) + rim - cg
    arm[:, 2] -= compression
    return arm


def _plane_axes(down: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Forward and right in the plane of the runway of a wheel that is turned by an angle about body z."""
    heading = np.stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))], axis=1)
    forward = heading - np.einsum("ti,ti->t", heading, down)[:, None] * down
    forward /= np.linalg.norm(forward, axis=1)[:, None]
    return forward, np.cross(down, forward)
