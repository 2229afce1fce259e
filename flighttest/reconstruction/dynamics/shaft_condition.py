"""Condition of a propeller and of the engine that turns it: advance ratio, coefficients, power.

The equations are those of the kernel (docs/explanation/simulation/propellers.md)::

    n* = max(n, V_a / (J_end D))     J = V_a / (n* D)       n: revolutions per second
    T  = CT rho n*^2 D^4             P = CP rho n*^3 D^5

Power of a piston engine or a gas turbine is ``gross - losses``: gross is that of the chart, of the
fuel, or of the table of shaft power.  A blade angle that is not recorded follows from the power.
"""

from __future__ import annotations

from collections.abc import Container, Hashable, Mapping
from typing import NamedTuple

import numpy as np
import xarray as xr

from flightmech.air import GAMMA, P_SEA, R_AIR, RHO_SEA, T_SEA, atmosphere
from flightmech.aircraft.engine import Engine
from flightmech.aircraft.propulsion.piston_engine import PistonEngine
from flightmech.aircraft.propulsion.propeller import Propeller
from flightmech.errors import IdentificationError
from flightmech.terms import evaluate_term

TWO_PI = 2.0 * np.pi
# Least revolutions per second of an advance ratio, as in the kernel.
_LEAST_TURNS = 1e-3
# Ratio of specific heats of the burnt gas [1], exponent of temperature over pressure in the
# troposphere [1], temperature of the tropopause [K]: constants of `kernel/src/propulsion/piston.c`.
_HEAT_RATIO, _LAPSE_EXPONENT, _T_TROPOPAUSE = 1.3, 0.190263, 216.65
# Speed of the shaft below which the torque of a power is not larger. [rad s-1]
_SLOW_SHAFT = 1.0
# Speed of a propeller that counts as stopped. [rad s-1]
STOPPED = 5.0

Condition = dict[str, np.ndarray]


class EnginePower(NamedTuple):
    """Power of an engine by its tables (point,).

    Attributes
    ----------
    gross, losses : array
        Power at the shaft is gross less losses. [W]
    tabled_flow, flow_of_power : array
        Fuel flow of a table, and of a specific consumption times the gross power. [kg/s]
    metered_flow : array
        Fuel flow of air and mixture, which makes the power itself. [kg/s]
    """

    gross: np.ndarray
    losses: np.ndarray
    tabled_flow: np.ndarray
    flow_of_power: np.ndarray
    metered_flow: np.ndarray


def air_of(columns: Mapping[str, np.ndarray]) -> Condition:
    """Return ``rho``, ``p_static``, ``temperature`` and ``a_sound`` at points.

    Parameters
    ----------
    columns : mapping of str to array (point,)
        ``p_static`` [Pa] and ``temperature`` [K]; or ``h`` [m], in standard air or with
        ``temperature``.

    Raises
    ------
    IdentificationError
        Neither pressure nor height.
    """
    if "p_static" not in columns and "h" not in columns:
        raise IdentificationError(
            "the density of the air needs p_static and temperature, or h; map one of them"
        )
    if "p_static" in columns:
        pressure = columns["p_static"]
    else:
        # Without a pressure: standard atmosphere with the mean deviation of the temperature.
        standard = np.asarray(atmosphere(columns["h"]).temperature)
        warmer = float(np.mean(columns.get("temperature", standard) - standard))
        pressure = np.asarray(atmosphere(columns["h"], delta_T=warmer).p_static)
    if "temperature" in columns:
        T = columns["temperature"]
    elif "h" in columns:
        T = np.asarray(atmosphere(columns["h"]).temperature)
    else:
        raise IdentificationError("p_static without temperature or h; map the temperature")
    # Ideal gas; speed of sound sqrt(gamma R T).
    return {
        "rho": pressure / (R_AIR * T),
        "p_static": np.asarray(pressure, float),
        "temperature": np.asarray(T, float),
        "a_sound": np.sqrt(GAMMA * R_AIR * T),
    }


def shaft_speed(columns: Mapping[str, np.ndarray], engine: Engine, number: int) -> np.ndarray:
    """Return the speed of a propeller (point,): that of its shaft, or of the crankshaft over the
    gear ratio. [rad/s]

    Parameters
    ----------
    columns : mapping of str to array (point,)
        ``engineN.rpm`` or ``engineN.engine_rpm``. [rad/s]
    engine : Engine
        With a propeller.
    number : int
        N.

    Raises
    ------
    IdentificationError
        Neither speed is recorded.
    """
    if f"engine{number}.rpm" in columns:
        return columns[f"engine{number}.rpm"]
    if f"engine{number}.engine_rpm" in columns:
        return columns[f"engine{number}.engine_rpm"] / propeller_of(engine, number).gear_ratio
    raise IdentificationError(
        f"engine{number}.rpm is missing: thrust and power of a propeller need its speed; map the "
        f"column of the tachometer"
    )


def has_shaft_speed(names: Container[Hashable], number: int) -> bool:
    """Return whether the speed of a propeller is among the names of channels."""
    return f"engine{number}.rpm" in names or f"engine{number}.engine_rpm" in names


def hub_velocity(
    columns: Mapping[str, np.ndarray], engine: Engine, cg: np.ndarray | tuple[float, ...]
) -> np.ndarray:
    """Return the velocity of a hub through the air, body axes (point, 3). [m/s]

    V (cos alpha cos beta, sin beta, sin alpha cos beta) + omega x (hub - c.g.), in air without
    rotation of its own.

    Parameters
    ----------
    columns : mapping of str to array (point,)
        ``V`` [m/s]; ``alpha``, ``beta`` [rad] and ``p``, ``q``, ``r`` [rad/s] where they exist.
    engine : Engine
        Its position is that of the hub.
    cg : array (point, 3) or (3,)
        Centre of gravity. [m]
    """
    V = columns["V"]
    al, be = (columns.get(name, 0.0 * V) for name in ("alpha", "beta"))
    along = (np.cos(al) * np.cos(be), np.sin(be), np.sin(al) * np.cos(be))
    velocity = V[:, None] * np.stack(along, axis=1)
    if not {"p", "q", "r"} <= set(columns):
        return velocity
    omega = np.stack([columns[name] for name in ("p", "q", "r")], axis=1)
    return velocity + np.cross(omega, np.asarray(engine.position, float) - np.asarray(cg))


def shaft_condition(
    columns: Mapping[str, np.ndarray],
    engine: Engine,
    number: int,
    cg: np.ndarray | tuple[float, ...],
) -> Condition:
    """Return the variables that tables of one engine may depend on, from its recorded channels.

    Parameters
    ----------
    columns : mapping of str to array (point,)
        ``V`` [m/s], ``rho``, ``p_static``, ``temperature``, ``a_sound`` as `air_of`, ``alpha``,
        ``beta`` [rad], ``p``, ``q``, ``r`` [rad/s] as `hub_velocity`, and ``engineN.rpm`` or
        ``engineN.engine_rpm`` [rad/s]; further channels of the engine as recorded.
    engine : Engine
        With a propeller.
    number : int
        N.
    cg : array (point, 3) or (3,)
        Centre of gravity, for the velocity of the hub in a rotation. [m]

    Returns
    -------
    dict of str to array (point,)
        Also ``turns``, the revolutions per second with which the coefficients count. [1/s]

    Raises
    ------
    IdentificationError
        The speed of the propeller is missing.
    """
    propeller = propeller_of(engine, number)
    prefix = f"engine{number}."
    own = {key.removeprefix(prefix): x for key, x in columns.items() if key.startswith(prefix)}
    rpm = np.maximum(shaft_speed(columns, engine, number), 0.0)
    axial = hub_velocity(columns, engine, cg) @ np.asarray(engine.direction, float)
    least = np.maximum(axial / (propeller.J_end * propeller.diameter), _LEAST_TURNS)
    turns = np.maximum(rpm / TWO_PI, least)
    tip = 0.5 * rpm * propeller.diameter
    given = {key: x for key, x in columns.items() if "." not in key}
    qbar = 0.5 * columns["rho"] * columns["V"] ** 2
    delta = columns["p_static"] / P_SEA
    condition = {
        **given,
        "mixture": np.ones_like(rpm),
        "prop_command": np.ones_like(rpm),
        **own,
        "rpm": rpm,
        "turns": turns,
        "J": axial / (turns * propeller.diameter),
        "engine_rpm": rpm * propeller.gear_ratio,
        "tip_mach": np.sqrt(tip**2 + axial**2) / columns["a_sound"],
        "mach": columns["V"] / columns["a_sound"],
        "V_eas": np.sqrt(2.0 * qbar / RHO_SEA),
        "qbar": qbar,
        "pressure_ratio": delta,
        "density_ratio": columns["rho"] / RHO_SEA,
    }
    if engine.deck is not None:
        condition |= _spool_condition(engine, condition)
    return condition


def propeller_of(engine: Engine, number: int) -> Propeller:
    """Return the propeller of an engine.

    Raises
    ------
    IdentificationError
        The engine has none.
    """
    if engine.propeller is None:
        raise IdentificationError(
            f"engine {number} of the aircraft file has no propeller; add [engine.propeller]"
        )
    return engine.propeller


def _spool_condition(engine: Engine, condition: Condition) -> Condition:
    """Return speeds and ratios of a gas generator with the definitions of the deck."""
    theta = condition["temperature"] / T_SEA * (1.0 + 0.2 * condition["mach"] ** 2)
    added = {"temperature_ratio": theta}
    deck = engine.deck
    if deck is not None and deck.coupled:
        added["n1"] = condition["engine_rpm"] / abs(deck.n1_rated)
    speeds = condition | added
    for name in ("n1", "n2"):
        if name in speeds:
            added[f"corrected_{name}"] = speeds[name] / np.sqrt(theta)
    return added


def power_of(engine: Engine, at: Condition) -> EnginePower | None:
    """Return power and fuel flow of an engine by its tables; None if they need other channels.

    Parameters
    ----------
    engine : Engine
        With a piston engine or a table of shaft power.
    at : dict of str to array (point,)
        As `shaft_condition` returns it. A piston engine needs ``manifold_pressure`` [Pa], a table
        of shaft power its axes.
    """
    if engine.piston is not None:
        if "manifold_pressure" not in at:
            return None
        return _piston_power(engine.piston, at)
    if engine.motor is not None or engine.propeller is None:
        return None
    return _turbine_power(engine.propeller, at)


def _turbine_power(propeller: Propeller, at: Condition) -> EnginePower | None:
    """Return the settled power of the tables of shaft power, within their limits."""
    tables = propeller.tables
    gross = np.zeros_like(at["rpm"])
    for name in ("shaft_power", "corrected_shaft_power"):
        if name not in tables:
            continue
        if not set(map(str, tables[name]["value"].dims)) <= set(at):
            return None
        factor: np.ndarray | float = 1.0
        if name.startswith("corrected"):
            factor = at["pressure_ratio"] * np.sqrt(at["temperature_ratio"])
        gross = gross + factor * table_at(tables[name], at)
    # a limit that does not act is the largest double, whose product overflows
    with np.errstate(over="ignore"):
        most = propeller.torque_limit * np.maximum(at["rpm"], _SLOW_SHAFT)
    gross = np.minimum(np.minimum(gross, propeller.power_limit), most)
    zero, flow = np.zeros_like(gross), np.zeros_like(gross)
    if "shaft_bsfc" in tables and set(map(str, tables["shaft_bsfc"]["value"].dims)) <= set(at):
        flow = table_at(tables["shaft_bsfc"], at) * np.maximum(gross, 0.0)
    return EnginePower(gross, zero, zero, flow_of_power=flow, metered_flow=zero)


def _piston_power(piston: PistonEngine, at: Condition) -> EnginePower:
    """Return the power of a burning piston engine (`kernel/src/propulsion/piston.c`)."""
    tables, delta, speed = piston.tables, at["pressure_ratio"], at["engine_rpm"]
    at = at | {
        "fuel_air_ratio": piston.full_rich
        * delta**-piston.enrichment
        * np.maximum(at["mixture"], 0.0)
    }

    def table(name: str) -> np.ndarray:
        if name not in tables:
            return np.zeros_like(speed)
        return table_at(tables[name], at)

    # Taylor's charge of air, exhaust at ambient pressure.
    swept = piston.displacement * speed / (2.0 * TWO_PI)
    manifold, most = np.maximum(at["manifold_pressure"], 1.0), piston.compression_ratio
    ratio = np.minimum(at["p_static"] / manifold, most)
    filled = (_HEAT_RATIO - 1.0) / _HEAT_RATIO + (most - ratio) / (_HEAT_RATIO * (most - 1.0))
    air = swept * piston.volumetric_efficiency * filled * manifold / (R_AIR * at["temperature"])
    mixed = air * at["fuel_air_ratio"]
    # The chart belongs to the standard temperature of the ambient pressure.
    standard = np.maximum(T_SEA * delta**_LAPSE_EXPONENT, _T_TROPOPAUSE)
    chart = table("power") + table("corrected_power") * np.sqrt(standard / at["temperature"])
    gross = chart + table("fuel_work") * mixed
    boost: np.ndarray | float = 1.0
    if piston.boost_rpm > 0.0:
        boost = speed / piston.boost_rpm
    unboosted = manifold / (1.0 + (piston.boost_ratio - 1.0) * boost)
    losses = (
        swept * table("friction_pressure")
        + table("friction_power")
        - piston.pumping * swept * (unboosted - at["p_static"])
    )
    flow_of_power = table("bsfc") * np.maximum(chart, 0.0)
    return EnginePower(gross, losses, table("fuel_flow"), flow_of_power, metered_flow=mixed)


def table_at(leaf: xr.Dataset, at: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return a table at points (point,), beyond its ends by its own rule."""
    shape = at["rpm"].shape
    return np.broadcast_to(evaluate_term(leaf, at, outside="clamp"), shape).astype(float)


class BladeSetting(NamedTuple):
    """Blade angle that takes a power (point,) [rad], and where a stop holds the blades."""

    angle: np.ndarray
    at_stop: np.ndarray


def blade_setting(propeller: Propeller, at: Condition, power: np.ndarray) -> BladeSetting:
    """Return the blade angle at which the propeller takes a power.

    The governor works between the stops, where CP grows with the blade angle. The solution is that
    of the first rise from the lower stop. A feathered propeller has its own angle.

    Parameters
    ----------
    propeller : Propeller
        With blades that turn.
    at : dict of str to array (point,)
        As `shaft_condition` returns it.
    power : array (point,)
        Power at the shaft. [W]
    """
    if "blade_angle" in at:
        return BladeSetting(at["blade_angle"], np.ones(len(power), bool))
    leaf = propeller.tables["CP_prop"]
    low = np.full(len(power), propeller.low_pitch)
    if "low_stop" in propeller.tables and "throttle" in at:
        low = table_at(propeller.tables["low_stop"], at)
    wanted = power / power_unit(propeller, at)
    # Blade angles: the lower stop of each point, the nodes above it, and the upper stop.
    nodes = leaf["blade_angle"].values
    nodes = nodes[(nodes > low.min()) & (nodes < propeller.highest)]
    angles = np.vstack([low, *(np.maximum(low, x) for x in nodes), 0.0 * low + propeller.highest])
    # one look-up of all angles at all points (angle, point)
    rows = {
        str(dim): np.broadcast_to(at[str(dim)], angles.shape)
        for dim in leaf["value"].dims
        if dim != "blade_angle"
    }
    taken = table_at(leaf, {**at, **rows, "rpm": angles, "blade_angle": angles})
    # first interval whose upper end takes at least the power
    k = np.clip(np.argmax(taken >= wanted, axis=0), 1, len(angles) - 1)
    point = np.arange(len(power))
    below, above = taken[k - 1, point], taken[k, point]
    share = np.clip((wanted - below) / np.where(above > below, above - below, np.inf), 0.0, 1.0)
    angle = angles[k - 1, point] + share * (angles[k, point] - angles[k - 1, point])
    at_low = taken[0] >= wanted
    at_high = (taken < wanted).all(axis=0)
    angle = np.where(at_low, low, np.where(at_high, propeller.highest, angle))
    feathered = at.get("feather", 0.0 * low) > 0.5
    angle = np.where(feathered, propeller.feather_pitch, angle)
    return BladeSetting(angle, at_low | at_high | feathered)


def thrust_unit(propeller: Propeller, at: Condition) -> np.ndarray:
    """Return rho n*^2 D^4 (point,), thrust over CT_prop. [N]"""
    return at["rho"] * at["turns"] ** 2 * propeller.diameter**4


def power_unit(propeller: Propeller, at: Condition) -> np.ndarray:
    """Return the power over CP_prop (point,), with the torque of n* at the speed n. [W]"""
    torque = at["rho"] * at["turns"] ** 2 * propeller.diameter**5 / TWO_PI
    return torque * np.maximum(at["rpm"], _SLOW_SHAFT)
