"""From a condition as a user states it to the parameters of the simulation."""

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
_FREE_AIR = 1e4  # height above the ground unless the condition gives one [m]
_START = ("gamma", "phi", "psi", "lat", "lon")


def condition_parameters(sim: SimModel, condition: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters and inputs of the simulation at a condition over a flat Earth.

    The flight is out of ground effect, at sea level too, unless the condition gives
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
        A name that is none of these.
    SchemaError
        No speed, two of them, or a number without meaning.
    """
    given = [name for name in SPEEDS if name in condition]
    if len(given) != 1:
        raise SchemaError(
            "condition",
            [f"holds {', '.join(given) or 'no speed'}; give one of {', '.join(SPEEDS)}"],
        )
    bad = [name for name, value in condition.items() if not np.isfinite(value)]
    if bad:
        raise SchemaError(
            "condition", [f"{name} is {condition[name]!r}; give a finite number" for name in bad]
        )
    found = {"mode.earth": 0.0, "init.h": 0.0}
    for name, value in condition.items():
        if name not in SPEEDS:
            found[_word(sim, name)] = float(value)
    found.setdefault("env.runway_elevation", found["init.h"] - _FREE_AIR)
    found["init.V"] = _true_airspeed(given[0], float(condition[given[0]]), found)
    return found


def _word(sim: SimModel, name: str) -> str:
    found = (
        f"mass.{name}"
        if name in _MASS
        else f"init.{name}"
        if name in (*_START, "h")
        else f"env.{name}"
        if name == "delta_T"
        else name
    )
    if found not in sim.parameters and found not in sim.inputs:
        raise UnknownName(
            name,
            [*SPEEDS, "h", "delta_T", *_START, *_MASS, *sim.inputs, *sim.parameters],
            "condition",
        )
    return found


def _true_airspeed(kind: str, value: float, parameters: Mapping[str, float]) -> float:
    air = atmosphere(
        parameters["init.h"],
        parameters.get("env.delta_T", 0.0),
        parameters.get("env.qnh", 101325.0),
    )
    if not value > 0.0:
        raise SchemaError("condition", [f"{kind} is {value:g}; give a positive speed"])
    if kind == "mach":
        return value * float(air.a_sound)
    if kind == "V_eas":
        return value * float(np.sqrt(RHO_SEA / air.rho))
    if kind == "V_cas":
        return float(mach_number(impact_pressure_at(value), air.p_static) * air.a_sound)
    return value


def flight_condition_text(condition: Mapping[str, float]) -> str:
    """Return a condition as text."""
    return ", ".join(
        f"{name} {value:.4g}{' ' + VOCABULARY[name].units if name in VOCABULARY else ''}"
        for name, value in condition.items()
    )


COLUMNS = ("group", "quantity", "value", "units", "remark", "absent")


class Characteristic(NamedTuple):
    """One quantity; `value` is NaN and `absent` states why when aircraft, database or flight do not
    give it.
    """

    group: str
    quantity: str
    value: float
    units: str
    remark: str = ""
    absent: str = ""


def absent_rows(group: str, quantities: dict[str, str], reason: str) -> list[Characteristic]:
    """Return rows without numbers for quantities (name: unit) that share a reason."""
    return [
        Characteristic(group, name, np.nan, units, absent=reason)
        for name, units in quantities.items()
    ]


def rows_to_frame(rows: list[Characteristic]) -> pd.DataFrame:
    """Return rows as a table, indexed by the quantity."""
    return pd.DataFrame(rows, columns=list(COLUMNS)).set_index("quantity")
