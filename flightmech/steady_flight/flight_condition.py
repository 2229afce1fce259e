"""Parameters of the simulation at a flight condition, and rows of characteristics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd

from flightmech.air import RHO_SEA, atmosphere, impact_pressure_at, mach_number
from flightmech.errors import SchemaError, UnknownName
from flightmech.names import VOCABULARY
from flightmech.simulation.compiler import SimModel

SPEEDS = ("V", "mach", "V_cas", "V_eas")
_MASS = ("mass", "x_cg_b", "y_cg_b", "z_cg_b", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
_FREE_AIR = 1e4  # default of the height above the ground, out of ground effect [m]
_STANDARD_PRESSURE = 101325.0  # default of env.qnh [Pa]
_START = ("gamma", "phi", "psi", "lat", "lon")


def condition_parameters(sim: SimModel, condition: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters and inputs of the simulation at a condition over a flat Earth.

    The flight is out of ground effect, also at sea level, unless the condition gives
    ``env.runway_elevation``.

    Parameters
    ----------
    sim : SimModel
        The compiled model.
    condition : mapping of str to float
        One of ``V mach V_cas V_eas``, and any of ``h`` (0), ``gamma phi psi lat lon``, ``mass
        x_cg_b ... Iyz``, ``delta_T``, inputs (``delta_f``, ``gear``) and parameters
        (``term.CL.gear``). [SI]

    Raises
    ------
    UnknownName
        A name that is not in this list.
    SchemaError
        No speed, two speeds, or a number without meaning.
    """
    # exactly one kind of speed defines the flight
    speeds = [name for name in SPEEDS if name in condition]
    if len(speeds) != 1:
        raise SchemaError(
            "condition",
            [f"holds {', '.join(speeds) or 'no speed'}; give one of {', '.join(SPEEDS)}"],
        )
    problems = []
    for name, value in condition.items():
        if not np.isfinite(value):
            problems.append(f"{name} is {value!r}; give a finite number")
    if problems:
        raise SchemaError("condition", problems)

    # the true airspeed depends on height and day, so that it comes last
    (speed,) = speeds
    parameters = {"mode.earth": 0.0, "init.h": 0.0}
    for name, value in condition.items():
        if name != speed:
            parameters[_parameter_name(sim, name)] = float(value)
    parameters.setdefault("env.runway_elevation", parameters["init.h"] - _FREE_AIR)
    parameters["init.V"] = _to_true_airspeed(speed, float(condition[speed]), parameters)
    return parameters


def _parameter_name(sim: SimModel, name: str) -> str:
    """Return the parameter or input of the simulation for a name of a condition."""
    # names of the user have no group; those of the simulation have one
    parameter = name
    if name in _MASS:
        parameter = f"mass.{name}"
    elif name in (*_START, "h"):
        parameter = f"init.{name}"
    elif name == "delta_T":
        parameter = f"env.{name}"
    if parameter not in sim.parameters and parameter not in sim.inputs:
        allowed = [*SPEEDS, "h", "delta_T", *_START, *_MASS, *sim.inputs, *sim.parameters]
        raise UnknownName(name, allowed, "condition")
    return parameter


def _to_true_airspeed(kind: str, value: float, parameters: Mapping[str, float]) -> float:
    """Return the true airspeed of a speed of any kind. [m s-1]"""
    if not value > 0.0:
        raise SchemaError("condition", [f"{kind} is {value:g}; give a positive speed"])
    air = atmosphere(
        parameters["init.h"],
        parameters.get("env.delta_T", 0.0),
        parameters.get("env.qnh", _STANDARD_PRESSURE),
    )
    if kind == "mach":
        return value * float(air.a_sound)
    if kind == "V_eas":
        return value * float(np.sqrt(RHO_SEA / air.rho))
    if kind == "V_cas":
        # the impact pressure of the calibrated airspeed, at the static pressure of the height
        return float(mach_number(impact_pressure_at(value), air.p_static) * air.a_sound)
    return value


def flight_condition_text(condition: Mapping[str, float]) -> str:
    """Return a condition as text."""
    parts = []
    for name, value in condition.items():
        unit = ""
        if name in VOCABULARY:
            unit = f" {VOCABULARY[name].units}"
        parts.append(f"{name} {value:.4g}{unit}")
    return ", ".join(parts)


COLUMNS = ("group", "quantity", "value", "units", "remark", "absent")


class Characteristic(NamedTuple):
    """One quantity of an aircraft at a condition.

    If aircraft, database or flight do not give the quantity, `value` is NaN and `absent` states the
    reason.
    """

    group: str
    quantity: str
    value: float
    units: str
    remark: str = ""
    absent: str = ""


def absent_rows(group: str, quantities: dict[str, str], reason: str) -> list[Characteristic]:
    """Return rows without a value for quantities (name: unit) that are absent for one reason."""
    rows = []
    for name, units in quantities.items():
        rows.append(Characteristic(group, name, np.nan, units, absent=reason))
    return rows


def rows_to_frame(rows: list[Characteristic]) -> pd.DataFrame:
    """Return rows as a table, indexed by the quantity."""
    return pd.DataFrame(rows, columns=list(COLUMNS)).set_index("quantity")
