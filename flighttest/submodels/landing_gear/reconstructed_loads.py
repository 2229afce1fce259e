"""Forces of the runway from the measured motion, and the load of every wheel (LR-743 4.5.4,
explicit identification).

    F_G = m a - F_T - F_A                                               about the c.g.
    M_G = I omega_dot + omega x (I omega + h_e) - M_T - M_A

All points of contact lie in the plane of the runway, a height H below the c.g.  The forces in that
plane therefore contribute H down x F_plane to rolling and pitching moment, for any wheel on which
they act.  Three equations without unknown friction give the loads of three wheels.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import xarray as xr

import aerodb
from aerodb.store.schema import database_coefficients
from flightmech.aircraft.aircraft import Aircraft
from flightmech.axes import matrix_from_euler, stability_to_body
from flightmech.errors import IdentificationError
from flightmech.names import REDUCED_RATES
from flighttest.reconstruction.dynamics.force_coefficients import smooth_states
from flighttest.reconstruction.dynamics.loads import external_load
from flighttest.reconstruction.flight_path import FlightPath
from flighttest.records.signals.differentiation import derivative
from flighttest.records.signals.white_noise import estimate_white_noise
from flighttest.submodels.landing_gear.wheel_positions import (
    ContactPoints,
    _centre_of_gravity,
    state_column,
    wheel_places,
    wheels_of,
)

PLANE = ("Fx", "Fy", "Mz")
# Density if the states have none. [kg m-3]
RHO = 1.225
# Cut-off frequency of the low-pass filter of all states. [Hz]
CUTOFF = 4.0
# Compression of a wheel that carries load. [m]
TOUCHING = 2e-3
# Standard errors of CL, CD and Cm; relative standard error of the thrust.
ERRORS = {
    "lift": 0.3,
    "drag": 0.03,
    "pitching": 0.1,
    "thrust": 0.02,
}
# Standard errors of the mass and the full pedal (relative), of the specific force along the runway
# with the error of attitude [m s-2], and between clocks [s].
SYSTEMATIC = {"mass": 0.005, "pedal": 0.002, "along": 0.002, "timing": 0.002}
# Standard error of the wind of a record without air data. [m s-1]
WIND_ERROR = 5.0
# Below this air speed, angles and reduced rates are computed with this speed. [m s-1]
_SLOWEST = 3.0
# Largest difference between rate of a leg and vertical velocity of the airframe above it. [m s-1]
_APART = 0.2
# A leg is at rest below this multiple of the noise power of its rate.
_BLOCKED = 12.0


class GroundRecord(NamedTuple):
    """Contents of a file of a ground run.

    The fields are the reconstructed states, and the constants with the errors of the wind, if any.
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
        ``rho``, ``engineN.thrust``, ``gear.<wheel>.compression``; ``gear.steering``, or else
        ``delta_nw``, as angle of the nose wheel; ``brake_left``, ``brake_right``, or ``brake`` of
        both, if recorded. [SI]
    aircraft : Aircraft
        Mass, inertia, engines and positions of the wheels. The constants of its gear are not used.
    database : DataTree, optional
        Aerodynamics. Without it the air exerts no force.
    wind : (north, east)
        Wind in addition to that of the states. [m s-1]
    cutoff : float
        Cut-off frequency of the low-pass filter of all states. [Hz]

    Returns
    -------
    Dataset (time, output, wheel, source)
        ``force`` (time, output): the load of every wheel, then force forward and to the right in
        the plane of the runway [N] and moment about its normal and the c.g. [N m]. The load is 0 in
        the air. It is NaN if no wheel touches, or if airframe and legs do not move alike.
        ``change`` (time, output, source): change of the force for an error of 1 of CL, CD and Cm,
        of the thrust by its own size, and of the wind by 1 m/s. ``compression`` [m], ``rate``
        [m s-1], ``along``, ``across`` (velocity over the runway in the axes of the wheel) [m s-1],
        ``angle`` (of the wheel, to the right) [rad], ``pedal`` [1], ``x``, ``y`` (from the c.g.)
        [m], all (time, wheel). ``speed`` (time,) [m s-1].

    Raises
    ------
    UnknownName
        A required state is missing.
    IdentificationError
        The aircraft has no wheels, or none touches the ground.
    """
    states = states_of(path)
    data = smooth_states(states, cutoff)
    angle = state_column(data, "gear.steering" if "gear.steering" in data else "delta_nw", 0.0)
    points = wheel_places(data, aircraft, angle)
    wheels = wheels_of(aircraft)
    channels = [f"gear.{wheel.name}.compression" for wheel in wheels]
    compression = np.stack([state_column(data, channel) for channel in channels], axis=1)
    touching = compression > TOUCHING
    if not touching.any():
        raise IdentificationError(
            f"{states.attrs.get('record', 'record')}: no wheel is compressed by more than "
            f"{TOUCHING:g} m; give ground runs or landings"
        )
    # F_G = m a - F_T - F_A; the external load is m a - F_T.
    F, M = external_load(data, aircraft)
    F_air, M_air = air_load_on_ground(data, aircraft, database=database, wind=wind)
    step = float(np.median(np.diff(data["time"].values)))
    force = ground_forces(F - F_air, M - M_air, at=points, touching=touching)
    force[_contradicting_samples(points, compression, touching=touching, step=step)] = np.nan
    changes = _error_effects(data, aircraft, database=database, wind=wind, at=points)
    effects = [ground_forces(f, m, at=points, touching=touching) for f, m in changes.values()]
    columns: dict = {
        "force": (("time", "output"), force),
        "change": (("time", "output", "source"), np.stack(effects, axis=2)),
        "speed": ("time", np.hypot(points.v_along[:, 0], points.v_across[:, 0])),
    }
    by_wheel = _wheel_motion(data, aircraft, points=points, angle=angle)
    by_wheel["compression"] = compression
    by_wheel["rate"] = _rates(states, aircraft, compression=compression, step=step, cutoff=cutoff)
    for name, values in by_wheel.items():
        columns[name] = ("time", "wheel"), values
    names = [wheel.name for wheel in wheels]
    coords = {
        "time": data["time"].values,
        "wheel": names,
        "output": [f"load.{name}" for name in names] + list(PLANE),
        "source": list(changes),
    }
    attrs = {
        "record": str(states.attrs.get("record", "")),
        "step": step,
        "wind_n": wind[0],
        "wind_e": wind[1],
    }
    return xr.Dataset(columns, coords, attrs)


def _wheel_motion(
    data: xr.Dataset, aircraft: Aircraft, points: ContactPoints, angle: np.ndarray
) -> dict[str, np.ndarray]:
    """Return velocities, angle, pedal and position of every wheel, (time, wheel)."""
    wheels = wheels_of(aircraft)
    return {
        "along": points.v_along,
        "across": points.v_across,
        "angle": np.stack([wheel.steering * angle for wheel in wheels], axis=1),
        "pedal": np.stack([_pedal(data, wheel.position[1]) for wheel in wheels], axis=1),
        "x": np.einsum("twi,ti->tw", points.arm, points.forward),
        "y": np.einsum("twi,ti->tw", points.arm, points.right),
    }


def _error_effects(
    data, aircraft: Aircraft, database, wind, at: ContactPoints
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return force and moment of the ground, by source, for one unit of its error."""
    zero = np.zeros_like(at.down)
    qS = 0.5 * state_column(data, "rho", RHO) * (at.v_along[:, 0] ** 2) * aircraft.S
    # The external load without engines less the external load is the load of the thrust.
    F_free, M_free = external_load(data, replace(aircraft, engines=()))
    F, M = external_load(data, aircraft)
    effects = {
        "lift": (qS[:, None] * at.down, zero),
        "drag": (qS[:, None] * at.forward, zero),
        "pitching": (zero, -(qS * aircraft.cbar)[:, None] * (0.0, 1.0, 0.0)),
        "thrust": (-(F_free - F), -(M_free - M)),
    }
    # Central differences over half a unit of wind to either side.
    for name, (north, east) in (("wind_n", (0.5, 0.0)), ("wind_e", (0.0, 0.5))):
        up = (wind[0] + north, wind[1] + east)
        down = (wind[0] - north, wind[1] - east)
        F1, M1 = air_load_on_ground(data, aircraft, database=database, wind=up)
        F0, M0 = air_load_on_ground(data, aircraft, database=database, wind=down)
        effects[name] = (F0 - F1, M0 - M1)
    return effects


def air_load_on_ground(
    data: xr.Dataset, aircraft: Aircraft, database: xr.DataTree | None, wind: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Return force and moment of the air about the c.g. in body axes. [N, N m]

    `wind` is in addition to the wind of the states.
    """
    count = data.sizes["time"]
    if database is None:
        return np.zeros((count, 3)), np.zeros((count, 3))
    u, v, w = _air_velocity(data, wind)
    V = np.sqrt(u**2 + v**2 + w**2)
    slow = np.maximum(V, _SLOWEST)
    variables: dict[str, np.ndarray] = {}
    for name, item in data.data_vars.items():
        if item.dims in (("time",), ()):
            variables[str(name)] = state_column(data, str(name))
    variables |= {
        "alpha": np.arctan2(w, np.maximum(u, _SLOWEST)),
        "beta": np.arcsin(np.clip(v / slow, -1.0, 1.0)),
    }
    # Reduced rates, such as q cbar / 2 V.
    for name in ("phat", "qhat", "rhat"):
        rate, length = REDUCED_RATES[name]
        variables[name] = variables[rate] * getattr(aircraft, length) / (2.0 * slow)
    variables |= {
        "alphadothat": np.zeros(count),
        "betadothat": np.zeros(count),
        "gear": state_column(data, "gear", 1.0),
        "V": slow,
    }
    forces = {
        name: np.broadcast_to(aerodb.evaluate(database, name, "clamp", **variables), count)
        for name in database_coefficients(database)
    }
    qS = (0.5 * state_column(data, "rho", RHO) * V**2 * aircraft.S)[:, None]
    if "CL" in forces:
        stability = np.stack([-forces["CD"], forces["CY"], -forces["CL"]], axis=1)
        F = qS * stability_to_body(stability, variables["alpha"])
    else:
        F = qS * np.stack([forces[name] for name in ("CX", "CY", "CZ")], axis=1)
    M = (
        qS
        * np.stack([forces[name] for name in ("Cl", "Cm", "Cn")], axis=1)
        * (aircraft.b, aircraft.cbar, aircraft.b)
    )
    # From the reference point of the database to the c.g.
    return F, M - np.cross(_centre_of_gravity(data, aircraft), F)


def _air_velocity(
    data: xr.Dataset, wind: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the velocity through the air (time,) along the body axes. [m s-1]"""
    motion = []
    for name, axis, added in zip(("vn", "ve", "vd"), "ned", (*wind, 0.0)):
        air = state_column(data, f"wind_{axis}", 0.0) + added
        motion.append(state_column(data, name) - air)
    attitude = matrix_from_euler(*(state_column(data, name) for name in ("phi", "theta", "psi")))
    u, v, w = np.einsum("tij,tj->it", attitude, np.stack(motion, axis=1))
    return u, v, w


def ground_forces(
    F: np.ndarray, M: np.ndarray, at: ContactPoints, touching: np.ndarray
) -> np.ndarray:
    """Return loads and in-plane components (time, wheel + 3) of a force and moment of the ground.

    The moment is about the c.g.
    """
    total = -np.einsum("ti,ti->t", F, at.down)
    plane = F + total[:, None] * at.down
    # Without the moment of the forces in the plane, H down x F_plane, only the loads contribute.
    load_moment = M - at.height[:, None] * np.cross(at.down, plane)
    lever = -np.cross(at.arm, at.down[:, None, :])
    # Balance of forces, of rolling and of pitching moment: A (time, equation, wheel) load = b.
    A = np.stack(
        [
            np.ones(touching.shape),
            np.einsum("twi,ti->tw", lever, at.forward),
            np.einsum("twi,ti->tw", lever, at.right),
        ],
        axis=1,
    )
    b = np.stack(
        [
            total,
            np.einsum("ti,ti->t", load_moment, at.forward),
            np.einsum("ti,ti->t", load_moment, at.right),
        ],
        axis=1,
    )
    load = np.full(touching.shape, np.nan)
    # Fewer than three wheels on the ground need fewer equations.
    for pattern in np.unique(touching, axis=0):
        use, count = (touching == pattern).all(axis=1), min(int(pattern.sum()), 3)
        if count:
            load[use] = 0.0
            load[np.ix_(use, pattern)] = np.einsum(
                "tij,tj->ti", np.linalg.pinv(A[use][:, :count][:, :, pattern]), b[use][:, :count]
            )
    return np.column_stack(
        [
            load,
            np.einsum("ti,ti->t", F, at.forward),
            np.einsum("ti,ti->t", F, at.right),
            np.einsum("ti,ti->t", M, at.down),
        ]
    )


def _derivatives(compression: np.ndarray, step: float) -> np.ndarray:
    """Return the derivatives of the columns by a quartic through nine samples.

    Central differences are 4 % low at 4 Hz and 50 samples per second.
    """
    return np.column_stack([derivative(x, step) for x in compression.T])


def _contradicting_samples(
    at: ContactPoints, compression: np.ndarray, touching: np.ndarray, step: float
) -> np.ndarray:
    """Return the samples at which airframe and legs do not move alike, from false accelerations."""
    apart = np.abs(np.where(touching, at.rate - _derivatives(compression, step), 0.0))
    return apart.max(axis=1) > _APART


def _rates(
    states: xr.Dataset, aircraft: Aircraft, compression: np.ndarray, step: float, cutoff: float
) -> np.ndarray:
    """Return rates of compression; zero where they do not exceed their noise.

    The noise would bias the damping.
    """
    rate = _derivatives(compression, step)
    # White noise after low-pass and derivative: its power integrated from 0 to the cut-off.
    for k, wheel in enumerate(wheels_of(aircraft)):
        white = estimate_white_noise(state_column(states, f"gear.{wheel.name}.compression"))
        loud = white * 2.0 * np.pi * cutoff * np.sqrt(2.0 * cutoff * step / 3.0)
        width = max(1, round(0.5 / step))
        power = np.convolve(rate[:, k] ** 2, np.ones(2 * width + 1), mode="same") / (2 * width + 1)
        rate[power < _BLOCKED * loud**2, k] = 0.0
    return rate


def brake_pedals(states: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Return the left and right brake pedals (time,), 0 to 1.

    One recorded ``brake`` is that of each side without its own; without any they are free.
    """
    both = state_column(states, "brake", 0.0)
    pedals = []
    for name in ("brake_left", "brake_right"):
        pedal = state_column(states, name) if name in states else both
        pedals.append(np.clip(pedal, 0.0, 1.0))
    return pedals[0], pedals[1]


def _pedal(data: xr.Dataset, y: float) -> np.ndarray:
    """Return the brake pedal (time,) of a wheel at the lateral position y, 0 to 1."""
    left, right = brake_pedals(data)
    if y < 0.0:
        return left
    if y > 0.0:
        return right
    return 0.5 * (left + right)
