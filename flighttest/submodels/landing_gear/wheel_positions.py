"""Wheels of an aircraft, and their points of contact with the runway."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.landing_gear import Contact
from flightmech.axes import matrix_from_euler
from flightmech.errors import IdentificationError, UnknownName

# Positions that differ by less than this are mirror images. [m]
_SAME = 1e-3


@dataclass(frozen=True)
class WheelGroup:
    """Wheels that are mirror images of each other and share their constants.

    Attributes
    ----------
    names : tuple of str
        Names of the contacts in the aircraft.
    """

    names: tuple[str, ...]

    @property
    def label(self) -> str:
        """Names of the contacts, such as ``left,right``."""
        return ",".join(self.names)

    def parameter(self, constant: str) -> str:
        """Return the name of a constant of the group, ``gear.left,right.stiffness``."""
        return f"gear.{self.label}.{constant}"

    def targets(self, constant: str) -> tuple[str, ...]:
        """Return the parameters of the simulation for a constant of the group."""
        return tuple(f"gear.{name}.{constant}" for name in self.names)


def wheels_of(aircraft: Aircraft) -> tuple[Contact, ...]:
    """Return the contacts that roll.

    Raises
    ------
    IdentificationError
        The aircraft has no wheels.
    """
    contacts = aircraft.gear.contacts if aircraft.gear else ()
    wheels = tuple(contact for contact in contacts if contact.friction == 0.0)
    if not wheels:
        raise IdentificationError(
            f"{aircraft.name} has no wheels; give [[gear.contact]] with position and "
            f"side_stiffness in its file"
        )
    return wheels


def wheel_groups(aircraft: Aircraft) -> tuple[WheelGroup, ...]:
    """Return the wheels of an aircraft, with mirror images in one group."""
    groups: list[list[Contact]] = []
    for wheel in wheels_of(aircraft):
        mirrored = np.array(wheel.position) * (1.0, -1.0, 1.0)
        for group in groups:
            if np.abs(mirrored - group[0].position).max() < _SAME:
                group.append(wheel)
                break
        else:
            groups.append([wheel])
    named = []
    for group in groups:
        named.append(WheelGroup(tuple(wheel.name for wheel in group)))
    return tuple(named)


@dataclass(frozen=True)
class ContactPoints:
    """Points of contact of the wheels with the runway, and their motion over it.

    Attributes
    ----------
    down : array (time, 3)
        Unit vector down in body axes.
    forward, right : array (time, 3)
        Unit vectors of the aircraft in the plane of the runway, in body axes.
    arm : array (time, wheel, 3)
        Vector from the c.g. in body axes. [m]
    height : array (time,)
        Height of the c.g. over the runway. [m]
    v_along, v_across : array (time, wheel)
        Velocity over the runway along and across the rolling direction, the latter to the right.
        [m s-1]
    rate : array (time, wheel)
        Rate of compression along the leg from the motion of the airframe. [m s-1]
    """

    down: np.ndarray
    forward: np.ndarray
    right: np.ndarray
    arm: np.ndarray
    height: np.ndarray
    v_along: np.ndarray
    v_across: np.ndarray
    rate: np.ndarray


def state_column(states: xr.Dataset, name: str, default: float | None = None) -> np.ndarray:
    """Return a state over time, or its default if the record does not have it.

    Raises
    ------
    UnknownName
        The state is missing and has no default.
    """
    if name not in states:
        if default is None:
            raise UnknownName(
                name, map(str, states.data_vars), "state", "the landing gear needs it"
            )
        return np.full(states.sizes["time"], float(default))
    return np.broadcast_to(np.asarray(states[name].values, float), (states.sizes["time"],))


def wheel_places(states: xr.Dataset, aircraft: Aircraft, steering: np.ndarray) -> ContactPoints:
    """Return the points of contact of the wheels and their motion.

    The leg is along body z as in the kernel (docs/explanation/simulation/landing-gear.md).

    Parameters
    ----------
    states : Dataset (time,)
        ``phi theta psi p q r vn ve vd``, ``gear.<wheel>.compression``. [SI]
    aircraft : Aircraft
        Aircraft with wheels.
    steering : array (time,)
        Angle of the steering, to the right. [rad]
    """
    wheels = wheels_of(aircraft)
    C = matrix_from_euler(*(state_column(states, name) for name in ("phi", "theta", "psi")))
    # Third row of the direction cosines: the vertical in body axes.
    down = C[:, :, 2]
    omega = _state_vector(states, ("p", "q", "r"))
    v = np.einsum("tij,tj->ti", C, _state_vector(states, ("vn", "ve", "vd")))
    cg = _centre_of_gravity(states, aircraft)
    arms = []
    for wheel in wheels:
        compression = state_column(states, f"gear.{wheel.name}.compression")
        arms.append(_contact_arm(wheel, down, cg=cg, compression=compression))
    arm = np.stack(arms, axis=1)
    # The leg compresses so fast that the point of contact does not move vertically.
    speed = v[:, None, :] + np.cross(omega[:, None, :], arm)
    rate = np.einsum("twi,ti->tw", speed, down) / down[:, None, 2]
    speed[:, :, 2] -= rate
    forward, right = _plane_axes(down, np.zeros(len(down)))
    along, across = np.empty(rate.shape), np.empty(rate.shape)
    for k, wheel in enumerate(wheels):
        ahead, aside = _plane_axes(down, wheel.steering * steering)
        along[:, k] = np.einsum("ti,ti->t", speed[:, k], ahead)
        across[:, k] = np.einsum("ti,ti->t", speed[:, k], aside)
    height = np.einsum("twi,ti->tw", arm, down).mean(axis=1)
    return ContactPoints(
        down=down,
        forward=forward,
        right=right,
        arm=arm,
        height=height,
        v_along=along,
        v_across=across,
        rate=rate,
    )


def _state_vector(states: xr.Dataset, names: tuple[str, ...]) -> np.ndarray:
    """Return three states as a vector (time, 3)."""
    return np.stack([state_column(states, name) for name in names], axis=1)


def _centre_of_gravity(states: xr.Dataset, aircraft: Aircraft) -> np.ndarray:
    """Return the c.g. (time, 3) in body axes, by default that of the aircraft. [m]"""
    columns = [
        state_column(states, f"{axis}_cg_b", value) for axis, value in zip("xyz", aircraft.cg)
    ]
    return np.stack(columns, axis=1)


def _contact_arm(
    wheel: Contact, down: np.ndarray, cg: np.ndarray, compression: np.ndarray
) -> np.ndarray:
    """Return the point of contact: lowest point of the round tyre, up by the compression."""
    in_plane = np.hypot(down[:, 0], down[:, 2])
    rim = wheel.radius * np.stack(
        [down[:, 0] / in_plane, np.zeros(len(down)), down[:, 2] / in_plane - 1.0], axis=1
    )
    arm = np.asarray(wheel.position, float) + rim - cg
    arm[:, 2] -= compression
    return arm


def _plane_axes(down: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return forward and right in the plane of the runway of a wheel at an angle about body z."""
    heading = np.stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))], axis=1)
    forward = heading - np.einsum("ti,ti->t", heading, down)[:, None] * down
    forward /= np.linalg.norm(forward, axis=1)[:, None]
    return forward, np.cross(down, forward)
