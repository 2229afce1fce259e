"""Thrust and torque of propellers along a flight path whose record has none.

No gauge of an aeroplane shows the thrust of a propeller.  It follows from the speed of the
propeller and the power that it takes, by the tables of the aircraft file::

    P = rpm Q,  or power(MAP, rpm ...)        recorded torque Q, or the chart of the engine
    CP(J, blade angle) = (P - I w w') / (rho n^3 D^5)       the angle, where blades turn
    T = CT(J, blade angle) rho n^2 D^4
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.engine import Engine
from flightmech.errors import IdentificationError
from flightmech.names import quantity_attributes
from flighttest.reconstruction.dynamics.reduced_rates import Columns, read_columns
from flighttest.reconstruction.dynamics.shaft_condition import (
    Condition,
    air_of,
    blade_setting,
    power_of,
    power_unit,
    shaft_condition,
    table_at,
    thrust_unit,
)
from flighttest.records.signals.differentiation import derivative

COMPUTED = "computed by the tables of propeller and engine"
"""Attribute ``comment`` of a thrust or torque that was not recorded."""


def add_propeller_loads(states: xr.Dataset, aircraft: Aircraft) -> xr.Dataset:
    """Return the states with thrust and torque of each engine that has a propeller.

    Recorded ones stay.  An aircraft without propellers, or with recorded thrust and torque of all
    of them, leaves the states as they are.

    Parameters
    ----------
    states : Dataset (time,)
        ``V alpha``, ``p_static temperature`` or ``h``, and ``engineN.rpm``; blades that turn need
        ``engineN.torque``, or the channels of the chart of power such as
        ``engineN.manifold_pressure``. [SI]
    aircraft : Aircraft

    Raises
    ------
    IdentificationError
        A channel is missing.
    """
    computed: dict[str, np.ndarray] = {}
    columns: Columns = {}
    for number, engine in enumerate(aircraft.engines, 1):
        names = {f"engine{number}.thrust", f"engine{number}.torque"}
        if engine.propeller is None or names <= set(map(str, states.data_vars)):
            continue
        if not columns:
            columns = read_columns(states)
            columns |= air_of(columns)
        # a record with a thrust channel may lack the speed: then its torque stays unknown
        if f"engine{number}.thrust" in columns and f"engine{number}.rpm" not in columns:
            continue
        computed |= _propeller_loads(columns, engine, number)
    variables = {}
    for name, values in computed.items():
        if name not in states:
            attributes = {**quantity_attributes(name), "comment": COMPUTED}
            variables[name] = ("time", values, attributes)
    return states.assign(variables)


def _propeller_loads(columns: Columns, engine: Engine, number: int) -> dict[str, np.ndarray]:
    """Return thrust and torque of one engine (time,)."""
    propeller = engine.propeller
    assert propeller is not None
    at = shaft_condition(columns, engine, number)
    momentum = propeller.inertia * at["rpm"]
    spinning_up = momentum * derivative(at["rpm"], float(np.median(np.diff(columns["time"]))))
    if "torque" in at:
        power: np.ndarray | None = at["torque"] * at["rpm"]
    else:
        power = _engine_power(engine, at)
    if not propeller.turns_blades:
        taken = table_at(propeller.tables["CP_prop"], at) * power_unit(propeller, at)
        power = taken + spinning_up
    elif power is None:
        raise IdentificationError(
            f"engine{number}.thrust is not recorded, and its blades turn: the thrust follows from "
            f"rpm and power; map engine{number}.torque, or engine{number}.manifold_pressure of a "
            f"piston engine, or the channels of the table of shaft power"
        )
    else:
        setting = blade_setting(propeller, at, power - spinning_up)
        at = at | {"blade_angle": setting.angle}
    thrust = table_at(propeller.tables["CT_prop"], at) * thrust_unit(propeller, at)
    return {
        f"engine{number}.thrust": thrust,
        f"engine{number}.torque": power / np.maximum(at["rpm"], 1.0),
    }


def _engine_power(engine: Engine, at: Condition) -> np.ndarray | None:
    power = power_of(engine, at)
    return None if power is None else power.gross - power.losses
