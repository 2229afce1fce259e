"""Forces of the runway from the measured motion, and the load of every wheel (LR-743 4.5.4,
explicit identification).

    F_G = m a - F_T - F_A,      M_G = I omega_dot + omega x (I omega + h_e) - M_T - M_A        about the c.g.

All points of contact lie in the plane of the runway, a height H below the c.g., so what the forces
in that plane contribute to rolling and pitching moment is H down x F_plane, whichever wheel they
act on: three equations without unknown friction give the loads of three wheels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import xarray as xr

import aerodb
from aerodb.store.schema import database_coefficients
from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.landing_gear import Contact
from flightmech.axes import matrix_from_euler, stability_to_body
from flightmech.errors import IdentificationError, UnknownName
from flighttest.reconstruction.dynamics.force_coefficients import external_load, smooth_states
from flighttest.reconstruction.smoother import FlightPath
from flighttest.records.signals.differentiation import derivative
from flighttest.submodels.control_loading.motion import estimate_white_noise

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
    found = tuple(
        contact
        for contact in (aircraft.gear.contacts if aircraft.gear else ())
        if contact.friction == 0.0
    )
    if not found:
        raise IdentificationError(
            f"{aircraft.name} has no wheels; give [[gear.contact]] with position and "
            f"side_stiffness in its file"
        )
    return found


def wheel_groups(aircraft: Aircraft) -> tuple[WheelGroup, ...]:
    """Return the wheels of an aircraft, mirror images together."""
    groups: list[list[Contact]] = []
    for wheel in wheels_of(aircraft):
        mirrored = np.array(wheel.position) * (1.0, -1.0, 1.0)
        like = next(
            (group for group in groups if np.abs(mirrored - group[0].position).max() < _SAME), None
        )
        if like is None:
            groups.append([wheel])
        else:
            like.append(wheel)
    return tuple(WheelGroup(tuple(wheel.name for wheel in group)) for group in groups)


@dataclass(frozen=True)
class ContactPoints:
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
        Velocity over the runway along and across the rolling direction, the latter to the right. [m
        s-1]
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


def state_column(states: xr.Dataset, name: str, default: float | None = None) -> np.ndarray:
    """Return a state over time, or its default where the record has none.

    Raises
    ------
    UnknownName
        It is missing and has no default.
    """
    if name not in states:
        if default is None:
            raise UnknownName(
                name, map(str, states.data_vars), "state", "the landing gear needs it"
            )
        return np.full(states.sizes["time"], float(default))
    return np.broadcast_to(np.asarray(states[name].values, float), (states.sizes["time"],))


def wheel_places(states: xr.Dataset, aircraft: Aircraft, steering: np.ndarray) -> ContactPoints:
    """Return where the wheels stand, with leg along body z as the kernel has it
    (docs/explanation/simulation/landing-gear.md).

    Parameters
    ----------
    states : Dataset (time,)
        ``phi theta psi p q r vn ve vd``, ``gear.<wheel>.compression``. [SI]
    aircraft : Aircraft
    steering : array (time,)
        Angle of the steering, to the right. [rad]
    """
    wheels = wheels_of(aircraft)
    C = matrix_from_euler(*(state_column(states, name) for name in ("phi", "theta", "psi")))
    down = C[:, :, 2]
    omega = np.stack([state_column(states, name) for name in ("p", "q", "r")], axis=1)
    v = np.einsum(
        "tij,tj->ti",
        C,
        np.stack([state_column(states, name) for name in ("vn", "ve", "vd")], axis=1),
    )
    cg = np.stack(
        [state_column(states, f"{axis}_cg_b", value) for axis, value in zip("xyz", aircraft.cg)],
        axis=1,
    )
    arm = np.stack(
        [
            _arm(wheel, down, cg, state_column(states, f"gear.{wheel.name}.compression"))
            for wheel in wheels
        ],
        axis=1,
    )
    speed = v[:, None, :] + np.cross(omega[:, None, :], arm)
    rate = np.einsum("twi,ti->tw", speed, down) / down[:, None, 2]
    speed[:, :, 2] -= rate
    forward, right = _plane_axes(down, np.zeros(len(down)))
    along, across = np.empty(rate.shape), np.empty(rate.shape)
    for k, wheel in enumerate(wheels):
        ahead, aside = _plane_axes(down, wheel.steering * steering)
        along[:, k], across[:, k] = (
            np.einsum("ti,ti->t", speed[:, k], axis) for axis in (ahead, aside)
        )
    height = np.einsum("twi,ti->tw", arm, down).mean(axis=1)
    return ContactPoints(down, forward, right, arm, height, along, across, rate)


def _arm(wheel: Contact, down: np.ndarray, cg: np.ndarray, compression: np.ndarray) -> np.ndarray:
    """The point where the leg stands: lowest point of the round tyre, moved up the leg by its
    compression.
    """
    in_plane = np.hypot(down[:, 0], down[:, 2])
    rim = wheel.radius * np.stack(
        [down[:, 0] / in_plane, np.zeros(len(down)), down[:, 2] / in_plane - 1.0], axis=1
    )
    arm = np.asarray(wheel.position, float) + rim - cg
    arm[:, 2] -= compression
    return arm


def _plane_axes(down: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Forward and right in the plane of the runway of a wheel that is turned by an angle about body
    z.
    """
    heading = np.stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))], axis=1)
    forward = heading - np.einsum("ti,ti->t", heading, down)[:, None] * down
    forward /= np.linalg.norm(forward, axis=1)[:, None]
    return forward, np.cross(down, forward)


PLANE = ("Fx", "Fy", "Mz")
RHO = 1.225  # where the states have no density [kg m-3]
CUTOFF = 4.0  # low-pass of all states [Hz]
TOUCHING = 2e-3  # compression of a wheel that carries load [m]
ERRORS = {
    "lift": 0.3,
    "drag": 0.03,
    "pitching": 0.1,
    "thrust": 0.02,
}  # standard errors of CL, CD, Cm; relative
# of the mass and the full pedal, relative; of the specific force along the runway, attitude
# included [m s-2]; between clocks [s]
SYSTEMATIC = {"mass": 0.005, "pedal": 0.002, "along": 0.002, "timing": 0.002}
WIND_ERROR = 5.0  # of the wind of a record without air data [m s-1]
_SLOWEST = 3.0  # air speed below which angles and reduced rates are those at this speed [m s-1]
# rate of a leg and vertical velocity of the airframe above it that contradict each other [m s-1]
_APART = 0.2
_BLOCKED = 12.0  # times the power of the noise of its rate below which a leg is at rest


class GroundRecord(NamedTuple):
    """A ground run as a file holds it: reconstructed states, and the constants with the errors of
    the wind, if any.
    """

    states: xr.Dataset
    biases: xr.Dataset | None = None


def states_of(path: FlightPath | GroundRecord | xr.Dataset) -> xr.Dataset:
    """Return the states of a record."""
    return path if isinstance(path, xr.Dataset) else path.states


def wheel_loads(
    path: FlightPath | GroundRecord | xr.Dataset,
    aircraft: Aircraft,
    database: xr.DataTree | None = None,
    wind: tuple[float, float] = (0.0, 0.0),
    cutoff: float = CUTOFF,
) -> xr.Dataset:
    """Return the load of every wheel and the force of the runway, sample by sample.

    Parameters
    ----------
    path : Path or Dataset (time,)
        A reconstruction, or its states: ``phi theta psi p q r ax ay az vn ve vd`` at the c.g.,
        ``rho``, ``engineN.thrust``, ``gear.<wheel>.compression``; ``gear.steering``, without it
        ``delta_nw``, is taken for the angle of the nose wheel; ``brake_left``, ``brake_right``
        where there are any. [SI]
    aircraft : Aircraft
        Mass, inertia, engines and the places of the wheels; none of the constants of its gear is
        used.
    database : DataTree, optional
        Aerodynamics; without it the air exerts no force.
    wind : (north, east)
        Added to the wind of the states. [m s-1]
    cutoff : float
        Low-pass of all states alike. [Hz]

    Returns
    -------
    Dataset (time, output, wheel, source)
        ``force`` (time, output): the load of every wheel, 0 in the air and NaN while none touches
        or where the airframe does not move as its legs do, then force forward and to the right in
        the plane of the runway [N] and moment about its normal and the c.g. [N m]; ``change``
        (time, output, source): what CL, CD and Cm that are wrong by 1, thrust by its own size, and
        a wind by 1 m/s change in it; ``compression`` [m], ``rate`` [m s-1], ``along``, ``across``
        (velocity over the runway in the axes of the wheel) [m s-1], ``angle`` (of the wheel, to the
        right) [rad], ``pedal`` [1], ``x``, ``y`` (from the c.g.) [m], all (time, wheel); ``speed``
        (time,) [m s-1].

    Raises
    ------
    UnknownName
        A state that is needed and missing.
    IdentificationError
        The aircraft has no wheels, or none touches the ground.
    """
    states = states_of(path)
    data = smooth_states(states, cutoff)
    angle = state_column(data, "gear.steering" if "gear.steering" in data else "delta_nw", 0.0)
    at = wheel_places(data, aircraft, angle)
    wheels = wheels_of(aircraft)
    compression = np.stack(
        [state_column(data, f"gear.{wheel.name}.compression") for wheel in wheels], axis=1
    )
    touching = compression > TOUCHING
    if not touching.any():
        raise IdentificationError(
            f"{states.attrs.get('record', 'record')}: no wheel is compressed by more than "
            f"{TOUCHING:g} m; give ground runs or landings"
        )
    F, M = external_load(data, aircraft)
    F_air, M_air = air_load(data, aircraft, database, wind)
    step = float(np.median(np.diff(data["time"].values)))
    changes = _changes(data, aircraft, database, wind, at)
    force = ground_forces(F - F_air, M - M_air, at, touching)
    force[_contradicting(at, compression, touching, step)] = np.nan
    columns: dict = {
        "force": (("time", "output"), force),
        "change": (
            ("time", "output", "source"),
            np.stack([ground_forces(f, m, at, touching) for f, m in changes.values()], axis=2),
        ),
        "speed": ("time", np.hypot(at.v_along[:, 0], at.v_across[:, 0])),
    }
    each = {
        "compression": compression,
        "rate": _rates(states, aircraft, compression, step, cutoff),
        "along": at.v_along,
        "across": at.v_across,
        "angle": np.stack([wheel.steering * angle for wheel in wheels], axis=1),
        "pedal": np.stack([_pedal(data, wheel.position[1]) for wheel in wheels], axis=1),
        "x": np.einsum("twi,ti->tw", at.arm, at.forward),
        "y": np.einsum("twi,ti->tw", at.arm, at.right),
    }
    columns |= {name: (("time", "wheel"), values) for name, values in each.items()}
    names = [wheel.name for wheel in wheels]
    coords = {
        "time": data["time"].values,
        "wheel": names,
        "output": [f"load.{name}" for name in names] + list(PLANE),
        "source": list(changes),
    }
    return xr.Dataset(
        columns,
        coords,
        {
            "record": str(states.attrs.get("record", "")),
            "step": step,
            "wind_n": wind[0],
            "wind_e": wind[1],
        },
    )


def _changes(
    data, aircraft: Aircraft, database, wind, at: ContactPoints
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Force and moment of the ground, by source, for one unit of its error."""
    zero = np.zeros_like(at.down)
    qS = 0.5 * state_column(data, "rho", RHO) * (at.v_along[:, 0] ** 2) * aircraft.S
    thrust = [
        x - y
        for x, y in zip(
            external_load(data, replace(aircraft, engines=())), external_load(data, aircraft)
        )
    ]
    found = {
        "lift": (qS[:, None] * at.down, zero),
        "drag": (qS[:, None] * at.forward, zero),
        "pitching": (zero, -(qS * aircraft.cbar)[:, None] * (0.0, 1.0, 0.0)),
        "thrust": (-thrust[0], -thrust[1]),
    }
    for name, by in (("wind_n", (0.5, 0.0)), ("wind_e", (0.0, 0.5))):
        (F1, M1), (F0, M0) = (
            air_load(data, aircraft, database, (wind[0] + side * by[0], wind[1] + side * by[1]))
            for side in (1.0, -1.0)
        )
        found[name] = (F0 - F1, M0 - M1)
    return found


def air_load(
    data: xr.Dataset, aircraft: Aircraft, database: xr.DataTree | None, wind: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Return force and moment of the air about the c.g., body axes, with wind added to that of the
    states. [N, N m]
    """
    count = data.sizes["time"]
    if database is None:
        return np.zeros((count, 3)), np.zeros((count, 3))

    turn = matrix_from_euler(*(state_column(data, name) for name in ("phi", "theta", "psi")))
    over = [
        state_column(data, f"wind_{axis}", 0.0) + more for axis, more in zip("ned", (*wind, 0.0))
    ]
    motion = np.stack(
        [state_column(data, name) - blows for name, blows in zip(("vn", "ve", "vd"), over)], axis=1
    )
    u, v, w = np.einsum("tij,tj->it", turn, motion)
    V = np.sqrt(u**2 + v**2 + w**2)
    slow = np.maximum(V, _SLOWEST)
    at: dict[str, np.ndarray] = {
        str(name): state_column(data, str(name))
        for name, item in data.data_vars.items()
        if item.dims in (("time",), ())
    }
    at |= {
        "alpha": np.arctan2(w, np.maximum(u, _SLOWEST)),
        "beta": np.arcsin(np.clip(v / slow, -1.0, 1.0)),
    }
    lengths = (("phat", "p", aircraft.b), ("qhat", "q", aircraft.cbar), ("rhat", "r", aircraft.b))
    at |= {name: at[rate] * length / (2.0 * slow) for name, rate, length in lengths}
    at |= {
        "alphadothat": np.zeros(count),
        "betadothat": np.zeros(count),
        "gear": state_column(data, "gear", 1.0),
        "V": slow,
    }
    forces = {
        name: np.broadcast_to(aerodb.evaluate(database, name, "clamp", **at), count)
        for name in database_coefficients(database)
    }
    qS = (0.5 * state_column(data, "rho", RHO) * V**2 * aircraft.S)[:, None]
    if "CL" in forces:
        F = qS * stability_to_body(
            np.stack([-forces["CD"], forces["CY"], -forces["CL"]], axis=1), at["alpha"]
        )
    else:
        F = qS * np.stack([forces[name] for name in ("CX", "CY", "CZ")], axis=1)
    M = (
        qS
        * np.stack([forces[name] for name in ("Cl", "Cm", "Cn")], axis=1)
        * (aircraft.b, aircraft.cbar, aircraft.b)
    )
    cg = np.stack(
        [state_column(data, f"{axis}_cg_b", value) for axis, value in zip("xyz", aircraft.cg)],
        axis=1,
    )
    return F, M - np.cross(cg, F)


def ground_forces(
    F: np.ndarray, M: np.ndarray, at: ContactPoints, touching: np.ndarray
) -> np.ndarray:
    """Return loads and in-plane components (time, wheel + 3) of a force and a moment of the ground
    about the c.g.
    """
    total = -np.einsum("ti,ti->t", F, at.down)
    plane = F + total[:, None] * at.down
    left = M - at.height[:, None] * np.cross(at.down, plane)
    lever = -np.cross(at.arm, at.down[:, None, :])
    rows = [
        np.ones(touching.shape),
        *(np.einsum("twi,ti->tw", lever, axis) for axis in (at.forward, at.right)),
    ]
    A = np.stack(rows, axis=1)  # balance of forces, of rolling and of pitching moment
    b = np.stack(
        [total, *(np.einsum("ti,ti->t", left, axis) for axis in (at.forward, at.right))], axis=1
    )
    load = np.full(touching.shape, np.nan)
    for pattern in np.unique(touching, axis=0):
        use, count = (touching == pattern).all(axis=1), min(int(pattern.sum()), 3)
        if count:
            load[use] = 0.0
            load[np.ix_(use, pattern)] = np.einsum(
                "tij,tj->ti", np.linalg.pinv(A[use][:, :count][:, :, pattern]), b[use][:, :count]
            )
    across = [
        np.einsum("ti,ti->t", x, axis) for x, axis in ((F, at.forward), (F, at.right), (M, at.down))
    ]
    return np.column_stack([load, *across])


def _derivatives(compression: np.ndarray, step: float) -> np.ndarray:
    """By a quartic through nine samples: central differences are 4 % low at 4 Hz and 50 samples per
    second.
    """
    return np.column_stack([derivative(x, step) for x in compression.T])


def _contradicting(
    at: ContactPoints, compression: np.ndarray, touching: np.ndarray, step: float
) -> np.ndarray:
    """Samples in which the airframe does not move as its legs do: accelerations that were not
    there.
    """
    apart = np.abs(np.where(touching, at.rate - _derivatives(compression, step), 0.0))
    return apart.max(axis=1) > _APART


def _rates(
    states: xr.Dataset, aircraft: Aircraft, compression: np.ndarray, step: float, cutoff: float
) -> np.ndarray:
    """Rates of compression; zero while they are not above their noise, which would bias the
    damping.
    """
    rate = _derivatives(compression, step)
    # white noise behind the low-pass and a derivative: its power over frequency, from 0 to the
    # cut-off
    for k, wheel in enumerate(wheels_of(aircraft)):
        white = estimate_white_noise(state_column(states, f"gear.{wheel.name}.compression"))
        loud = white * 2.0 * np.pi * cutoff * np.sqrt(2.0 * cutoff * step / 3.0)
        width = max(1, round(0.5 / step))
        power = np.convolve(rate[:, k] ** 2, np.ones(2 * width + 1), mode="same") / (2 * width + 1)
        rate[power < _BLOCKED * loud**2, k] = 0.0
    return rate


def _pedal(data: xr.Dataset, y: float) -> np.ndarray:
    left, right = (
        np.clip(state_column(data, f"brake_{side}", 0.0), 0.0, 1.0) for side in ("left", "right")
    )
    return left if y < 0.0 else right if y > 0.0 else 0.5 * (left + right)
