"""Thrust, torque and regressors of propellers along a flight without a channel of thrust.

A record of a propeller aircraft has the speed of the propeller, and torque, manifold pressure or n1.
The tables of the aircraft file turn them into thrust and torque, and into the regressors ``J``,
``CT_prop``, ``CP_prop`` and ``CT`` of the effects of power.  The loads are those of the kernel
(`kernel/src/propulsion/propeller.c`), with the thrust line d, the rotation r and the velocity v of
the hub through the air::

    F = T d - CN rho n^2 D^4 v_across / V
    M = - r Q_e d - omega x (r I w d) - r CM rho n^2 D^5 v_across / V      at the hub
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.engine import Engine
from flightmech.errors import IdentificationError
from flightmech.names import quantity_attributes
from flighttest.reconstruction.dynamics.reduced_rates import (
    Columns,
    read_column,
    read_columns,
    stack_columns,
)
from flighttest.reconstruction.dynamics.shaft_condition import (
    Condition,
    air_of,
    blade_setting,
    power_of,
    power_unit,
    propeller_of,
    shaft_condition,
    table_at,
    thrust_unit,
)

_SLOWEST = 1.0  # of the shaft [rad s-1], and of the air [m s-1]


def with_propeller_channels(states: xr.Dataset, aircraft: Aircraft) -> xr.Dataset:
    """Return states with thrust, torque and the coefficients of propellers.

    Recorded channels are not changed. States without ``engineN.rpm`` and engines without a propeller
    get no channels.

    Parameters
    ----------
    states : Dataset (time,)
        ``V``, ``engineN.rpm`` or ``engineN.engine_rpm``, the air (`air_of`, or ``qbar``), and for
        the power ``engineN.torque``, or what the tables of the engine depend on. [SI]
    aircraft : Aircraft

    Raises
    ------
    IdentificationError
        A governed propeller without a measured power and without a recorded thrust.
    """
    numbers = [
        number
        for number, engine in enumerate(aircraft.engines, 1)
        if engine.propeller is not None and _has_speed(states, number)
    ]
    if not numbers:
        return states
    columns = read_columns(states)
    columns = _with_air(columns)
    added = {}
    for number in numbers:
        for name, values in propeller_channels(
            columns, aircraft.engines[number - 1], number
        ).items():
            full = f"engine{number}.{name}"
            if full not in states:
                added[full] = ("time", values, quantity_attributes(full))
    return states.assign(added)


def _has_speed(states: xr.Dataset, number: int) -> bool:
    return f"engine{number}.rpm" in states or f"engine{number}.engine_rpm" in states


def _with_air(columns: Columns) -> Columns:
    """Return columns with the air; the density is that of dynamic pressure and airspeed."""
    columns = {**columns, **air_of(columns)}
    if "qbar" in columns:
        V = np.maximum(columns["V"], _SLOWEST)
        density = 2.0 * columns["qbar"] / V**2
        columns["rho"] = np.where(columns["V"] > _SLOWEST, density, columns["rho"])
    return columns


def propeller_channels(columns: Columns, engine: Engine, number: int) -> dict[str, np.ndarray]:
    """Return thrust, torque and coefficients of one engine with a propeller, by their last word.

    Parameters
    ----------
    columns : dict of str to array (time,)
        As `shaft_condition`, and ``time``. [SI]
    engine : Engine
    number : int
        1 for the first.

    Raises
    ------
    IdentificationError
        The speed is missing, or a governed propeller has neither a measured power nor a thrust.
    """
    propeller = propeller_of(engine, number)
    at = shaft_condition(columns, engine, number)
    spin_up = propeller.inertia * np.gradient(at["rpm"], columns["time"])
    power = _engine_power(at, engine)
    if propeller.turns_blades:
        if power is None:
            if f"engine{number}.thrust" in columns:
                return {"J": at["J"]}
            raise IdentificationError(
                f"engine {number}: the blade angle of its propeller follows from the power, and "
                f"neither torque nor what its tables need is recorded; map engine{number}.torque, "
                f"manifold_pressure, n1 or throttle"
            )
        angle = blade_setting(propeller, at, power - spin_up * at["rpm"]).angle
        at = at | {"blade_angle": angle}
    CT, CP = (table_at(propeller.tables[name], at) for name in ("CT_prop", "CP_prop"))
    speed = np.maximum(at["rpm"], _SLOWEST)
    if power is None:
        # torque of the engine: that of the air and the acceleration of the shaft
        power = CP * power_unit(propeller, at) + spin_up * speed
    channels = {
        "thrust": CT * thrust_unit(propeller, at),
        "torque": power / speed,
        "J": at["J"],
        "CT_prop": CT,
        "CP_prop": CP,
        "shaft_power": power,
    }
    if "blade_angle" in at:
        channels["blade_angle"] = at["blade_angle"]
    return channels


def _engine_power(at: Condition, engine: Engine) -> np.ndarray | None:
    """Return the power at the shaft: torque, else the tables of the engine; None without both. [W]"""
    if "torque" in at:
        return at["torque"] * at["rpm"]
    tabled = power_of(engine, at)
    return None if tabled is None else tabled.gross - tabled.losses


def propeller_load(
    columns: Columns, engine: Engine, number: int
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the loads of a propeller in addition to its thrust, body axes, at its hub.

    Parameters
    ----------
    columns : dict of str to array (time,)
        As `with_propeller_channels`, with ``p q r alpha``, and ``beta`` where it exists.
    engine : Engine
    number : int

    Returns
    -------
    F, M : array (time, 3)
        Force in the disk, and moment of torque, rotor and P-factor. [N, N m] None for an engine
        without a propeller or states without its torque.
    """
    propeller = engine.propeller
    prefix = f"engine{number}."
    if propeller is None or f"{prefix}torque" not in columns or f"{prefix}J" not in columns:
        return None
    line = np.asarray(engine.direction, float)
    rpm = columns.get(f"{prefix}rpm")
    if rpm is None:
        rpm = columns[f"{prefix}engine_rpm"] / propeller.gear_ratio
    omega = stack_columns(columns, ("p", "q", "r"))
    momentum = propeller.rotation * propeller.inertia * rpm[:, None] * line
    moment = -propeller.rotation * columns[f"{prefix}torque"][:, None] * line
    moment = moment - np.cross(omega, momentum)
    force = np.zeros_like(moment)
    if not {"CN_prop", "CM_prop"} & set(propeller.tables):
        return force, moment
    across, at, load = _inflow(columns, engine, number)
    for name, target in (("CN_prop", 0), ("CM_prop", 1)):
        if name not in propeller.tables:
            continue
        size = (load * table_at(propeller.tables[name], at))[:, None] * across
        if target == 0:
            force = force - size
        else:
            moment = moment - propeller.rotation * propeller.diameter * size
    return force, moment


def _inflow(
    columns: Columns, engine: Engine, number: int
) -> tuple[np.ndarray, Condition, np.ndarray]:
    """Return v_across / V at the c.g. (time, 3), the condition, and rho n^2 D^4 [N]."""
    al = read_column(columns, "alpha")
    be = read_column(columns, "beta", 0.0)
    along = np.stack([np.cos(al) * np.cos(be), np.sin(be), np.sin(al) * np.cos(be)], axis=1)
    line = np.asarray(engine.direction, float)
    across = along - (along @ line)[:, None] * line
    at = shaft_condition(_with_air(columns), engine, number)
    assert engine.propeller is not None
    return across, at, thrust_unit(engine.propeller, at)
