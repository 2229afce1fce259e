"""Forces and moments on the airframe along a flight path, and their coefficients.

Equation of motion of a rigid aeroplane with spinning rotors, solved for the aerodynamic force and
moment::

    F_A = m a - F_T
    M_A = I omega_dot + omega x (I omega + h_e) - M_T           about the c.g.
    M_ref = M_A + (r_cg - r_ref) x F_A                          about the moment reference point

`a` is the specific force at the c.g., so gravity does not appear. Positions count from the moment
reference point.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.engine import Engine
from flightmech.errors import AeromatchError, IdentificationError
from flightmech.names import quantity_attributes
from flighttest.reconstruction.dynamics.propeller_loads import (
    propeller_load,
    with_engine_channels,
)
from flighttest.reconstruction.dynamics.reduced_rates import (
    Columns,
    center_of_gravity,
    read_column,
    read_columns,
    stack_columns,
)
from flighttest.records.signals.differentiation import WINDOW, derivative
from flighttest.records.signals.resampling import GAP

_RATES = ("p", "q", "r")
_LEAST_QBAR = 1.0  # Pa, as in the simulation
_UNIFORM = 0.01  # relative range of the steps of a clock that counts as uniform


def external_load(states: xr.Dataset, aircraft: Aircraft) -> tuple[np.ndarray, np.ndarray]:
    """Return force and moment on the airframe without weight and thrust.

    They are the loads of the air and of the runway.

    Parameters
    ----------
    states : Dataset (time,)
        As for `coefficients`.
    aircraft : Aircraft
        Mass where the states have none, inertia, engines.

    Returns
    -------
    F, M : array (time, 3)
        Body axes, M about the c.g. [N, N m]
    """
    return air_load(read_columns(with_engine_channels(states, aircraft)), aircraft)


def air_load(columns: Columns, aircraft: Aircraft) -> tuple[np.ndarray, np.ndarray]:
    """Return `external_load` of plain columns."""
    F, M = inertial_load(columns, aircraft)
    F_thrust, M_thrust = sum_loads(engine_loads(columns, aircraft))
    return F - F_thrust, M - M_thrust


def known_moment(states: xr.Dataset, aircraft: Aircraft) -> np.ndarray:
    """Return the moment of thrust and rotors on the airframe about the c.g.

    The moment of the rotors is -omega x h_e.

    Parameters
    ----------
    states : Dataset (time,)
        `p q r`, and `engineN.thrust` of every engine; `x_cg_b`, `y_cg_b`, `z_cg_b` where they
        change. [SI]
    aircraft : Aircraft
        Engines.

    Returns
    -------
    array (time, 3)
        Body axes. [N m]
    """
    columns = read_columns(with_engine_channels(states, aircraft))
    # M_T - omega x h_e
    moment = -np.cross(stack_columns(columns, _RATES), _rotor_momentum(aircraft))
    total = np.zeros(3)
    for _, engine_moment in engine_loads(columns, aircraft):
        total = total + engine_moment
    return moment + total


def inertia_matrix(aircraft: Aircraft) -> np.ndarray:
    """Return the tensor of inertia about the c.g., body axes. [kg m2]"""
    return np.array(
        [
            [aircraft.Ixx, -aircraft.Ixy, -aircraft.Ixz],
            [-aircraft.Ixy, aircraft.Iyy, -aircraft.Iyz],
            [-aircraft.Ixz, -aircraft.Iyz, aircraft.Izz],
        ]
    )


def inertial_load(columns: Columns, aircraft: Aircraft) -> tuple[np.ndarray, np.ndarray]:
    """Return m a and I omega_dot + omega x (I omega + h_e), body axes, about the c.g. [N, N m]"""
    omega = stack_columns(columns, _RATES)
    omega_dot = np.stack([_angular_acceleration(columns, name) for name in _RATES], axis=1)
    inertia = inertia_matrix(aircraft)
    mass = read_column(columns, "mass", aircraft.mass)
    force = mass[:, None] * stack_columns(columns, ("ax", "ay", "az"))
    gyroscopic = np.cross(omega, omega @ inertia + _rotor_momentum(aircraft))
    return force, omega_dot @ inertia + gyroscopic


def engine_loads(columns: Columns, aircraft: Aircraft) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the force of each engine and its moment about the c.g., body axes. [N, N m]

    The rotor of a propeller is included where its speed is known, its torque and inflow where they
    are known (`propeller_loads`).
    """
    loads = []
    for i, engine in enumerate(aircraft.engines):
        thrust = read_column(columns, f"engine{i + 1}.thrust")
        force = thrust[:, None] * np.asarray(engine.direction, float)
        cg = center_of_gravity(columns, aircraft)
        arm = np.asarray(engine.position, float) - cg
        moment = np.zeros_like(force)
        propeller = propeller_load(columns, engine, i + 1, cg)
        if propeller is not None:
            force, moment = force + propeller[0], propeller[1]
        moment = np.cross(arm, force) + moment
        if f"engine{i + 1}.ram_drag" in columns and engine.deck is not None:
            added = _ram_load(columns, engine, i + 1, cg)
            force, moment = force + added[0], moment + added[1]
        loads.append((force, moment))
    return loads


def _ram_load(
    columns: Columns, engine: Engine, number: int, cg: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return what the direction and the place of the ram drag add to the net thrust.

    The net thrust counts the ram drag along the thrust line. It acts against the airspeed, at the
    inlet: R (d - v / V), as in `kernel/src/propulsion/engine.c`.
    """
    ram = read_column(columns, f"engine{number}.ram_drag")[:, None]
    line = np.asarray(engine.direction, float)
    position = np.asarray(engine.position, float)
    inlet = position
    if engine.deck is not None and engine.deck.inlet is not None:
        inlet = np.asarray(engine.deck.inlet, float)
    al = read_column(columns, "alpha")
    be = read_column(columns, "beta", 0.0)
    against = -np.stack([np.cos(al) * np.cos(be), np.sin(be), np.sin(al) * np.cos(be)], axis=1)
    force = ram * (line + against)
    moment = np.cross(position - cg, ram * line) + np.cross(inlet - cg, ram * against)
    return force, moment


def sum_loads(
    loads: list[tuple[np.ndarray, np.ndarray]],
) -> tuple[np.ndarray | int, np.ndarray | int]:
    """Return the sum of forces and the sum of moments; zero without loads."""
    return sum(force for force, _ in loads), sum(moment for _, moment in loads)


def thrust_coefficient(
    columns: Columns, aircraft: Aircraft, engine: int | None = None
) -> np.ndarray:
    """Return the net thrust of one engine, or of all, over qbar S (time,). [1]"""
    engines = range(len(aircraft.engines))
    if engine is not None:
        engines = range(engine, engine + 1)
    total = np.zeros(1)
    for i in engines:
        total = total + read_column(columns, f"engine{i + 1}.thrust")
    return total / (np.maximum(read_column(columns, "qbar"), _LEAST_QBAR) * aircraft.S)


def with_propeller_thrust_coefficient(states: xr.Dataset, aircraft: Aircraft) -> xr.Dataset:
    """Return states with ``CT`` of propellers without a recorded thrust.

    Terms of the slipstream along a path need it where no aircraft file is at hand. States with a
    recorded thrust of each engine, or whose channels do not give the thrust, are not changed.

    Parameters
    ----------
    states : Dataset (time,)
        As of `with_engine_channels`. [SI]
    aircraft : Aircraft
    """
    names = [f"engine{number}.thrust" for number in range(1, len(aircraft.engines) + 1)]
    if all(name in states for name in names):
        return states
    try:
        complete = with_engine_channels(states, aircraft)
    except AeromatchError:
        # the path itself does not depend on the propeller
        return states
    if not all(name in complete for name in names):
        return states
    CT = thrust_coefficient(read_columns(complete), aircraft)
    return states.assign(CT=("time", CT, quantity_attributes("CT")))


def load_coefficients(
    F: np.ndarray, M: np.ndarray, columns: Columns, aircraft: Aircraft
) -> dict[str, np.ndarray]:
    """Return the coefficients of a force and a moment about the c.g. (time, 3)."""
    qbar_S = read_column(columns, "qbar") * aircraft.S
    M_ref = M + np.cross(center_of_gravity(columns, aircraft), F)
    # No coefficient at standstill: NaN or infinity, which the mask of flight removes.
    with np.errstate(divide="ignore", invalid="ignore"):
        C_force = F / qbar_S[:, None]
        C_moment = M_ref / qbar_S[:, None]
    CX, CY, CZ = C_force.T
    # lengths: span, mean chord, span
    Cl, Cm, Cn = (C_moment / np.array([aircraft.b, aircraft.cbar, aircraft.b])).T
    # stability axes: turned by alpha about body y
    al = read_column(columns, "alpha")
    return {
        "CL": CX * np.sin(al) - CZ * np.cos(al),
        "CD": -CX * np.cos(al) - CZ * np.sin(al),
        "CX": CX,
        "CY": CY,
        "CZ": CZ,
        "Cl": Cl,
        "Cm": Cm,
        "Cn": Cn,
    }


def is_airborne(columns: Columns, margin: float) -> np.ndarray:
    """Return the samples (time,) without a wheel on the ground within `margin` seconds.

    Why a margin: a filter spreads the shock of a touch-down.
    """
    wheels = [values > 0.5 for name, values in columns.items() if name.startswith("wow_")]
    if not wheels:
        return np.ones(len(columns["time"]), bool)
    time, on_ground = columns["time"], np.any(wheels, axis=0)
    if not on_ground.any():
        return ~on_ground
    # nearest sample on the ground before and after each sample
    ground_time = time[on_ground]
    following = np.searchsorted(ground_time, time)
    before = ground_time[np.maximum(following - 1, 0)]
    after = ground_time[np.minimum(following, len(ground_time) - 1)]
    distance = np.minimum(np.abs(time - before), np.abs(after - time))
    return ~on_ground & (distance > margin)


def _rotor_momentum(aircraft: Aircraft) -> np.ndarray:
    """Return the angular momentum of all rotors, body axes (3,). [kg m2 s-1]"""
    total = np.zeros(3)
    for engine in aircraft.engines:
        total = total + engine.angular_momentum * np.asarray(engine.direction, float)
    return total


def _angular_acceleration(columns: Columns, name: str) -> np.ndarray:
    """Return the derivative of a body rate (time,); NaN in short stretches at gaps. [rad s-2]"""
    if f"{name}_dot" in columns:
        return columns[f"{name}_dot"]
    rate = read_column(columns, name)
    steps = np.diff(columns["time"])
    step = float(np.median(steps))
    slope = np.full(rate.shape, np.nan)
    # a derivative across a gap would be a straight line through what nobody recorded
    for part in np.split(np.arange(len(rate)), np.flatnonzero(steps > GAP * step) + 1):
        within = np.diff(columns["time"][part])
        if len(within) and np.ptp(within) > _UNIFORM * step:
            raise IdentificationError(
                f"{name}_dot is missing and {name} steps by {within.min():.4g} ... "
                f"{within.max():.4g} s; cut and resample first"
            )
        if len(part) >= WINDOW or len(part) == len(rate):
            slope[part] = derivative(rate[part], step)
    return slope
