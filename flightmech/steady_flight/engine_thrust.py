"""Thrust of the engines at full throttle, and how its tables depend on height."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.engine import list_leaves
from flightmech.simulation.run import constant_inputs, initialise_run
from flightmech.steady_flight.trim_point import Point

NO_THRUST = "the aircraft file gives an engine neither a thrust table nor a deck nor a propeller"
# Tables of a deck that decide the thrust at full throttle: thrust and governed spool speeds.
_FULL_THROTTLE_TABLES = (
    "thrust",
    "corrected_thrust",
    "n1_command",
    "n2_command",
    "corrected_n1_command",
    "corrected_n2_command",
    "power",
    "corrected_power",
    "shaft_power",
    "corrected_shaft_power",
)
# Tables that make a fuel flow.
_FUEL_TABLES = ("fuel_flow", "corrected_fuel_flow", "bsfc", "shaft_bsfc", "fuel_work")


class Heights(NamedTuple):
    """How thrust depends on height.

    `end` is the last height of the tables [m], infinite if no table has a height axis. `lapses` is
    true if the thrust of all engines is proportional to the pressure.
    """

    end: float
    lapses: bool


def power_off(point: Point) -> dict[str, float]:
    """Return the model variables of power, with throttles closed and without thrust."""
    values = thrust_variables(point, [0.0] * len(point.aircraft.engines))
    for number in range(1, len(point.aircraft.engines) + 1):
        values[f"engine{number}.throttle"] = 0.0
    return values


def thrust_variables(point: Point, thrust: Sequence[float] | np.ndarray) -> dict[str, float]:
    """Return ``CT`` and the thrust of each engine as model variables of a flight.

    Parameters
    ----------
    point : Point
        The flight, for its dynamic pressure and area.
    thrust : array (engine,)
        Net thrust of each engine. [N]
    """
    values = {}
    for number, net_thrust in enumerate(thrust, 1):
        values[f"engine{number}.thrust"] = float(net_thrust)
    values["CT"] = float(sum(thrust)) / (point["qbar"] * point.aircraft.S)
    return values


def has_thrust(aircraft: Aircraft) -> bool:
    """Return whether there are engines and each has a thrust table, a deck or a propeller."""
    for engine in aircraft.engines:
        if engine.thrust is None and engine.deck is None and engine.propeller is None:
            return False
    return bool(aircraft.engines)


def burns_fuel(aircraft: Aircraft) -> bool:
    """Return whether there are engines and each has a fuel flow: of a deck or a piston engine."""
    for engine in aircraft.engines:
        if engine.deck is None and engine.piston is None:
            return False
        if not set(_FUEL_TABLES) & set(list_leaves(engine)):
            return False
    return bool(aircraft.engines)


def full_thrust(flight: Point) -> np.ndarray:
    """Return the net thrust (engine,) at full throttle, at the speed and height of a flight. [N]

    The spools have settled.
    """
    numbers = range(1, len(flight.aircraft.engines) + 1)
    # The bias of the lever is added by the kernel. It is subtracted here, so that the lever ends
    # at its limit.
    _, highest_lever = flight.aircraft.limits.get("throttle", (0.0, 1.0))
    lever = highest_lever - flight.parameter("bias.throttle")
    levers = {f"engine{number}.throttle": lever for number in numbers}
    attitude = {"init.alpha": flight["alpha"], "init.beta": flight["beta"]}
    # mode.engine 0: levers drive the engines; mode.trim 0: the flight starts in the state of init.*
    values = {**flight.parameters, **attitude, **levers, "mode.engine": 0.0, "mode.trim": 0.0}
    outputs = initialise_run(flight.sim, values, constant_inputs(flight.sim, values)).outputs()
    indices = [flight.sim.outputs.index(f"engine{number}.thrust") for number in numbers]
    return np.array([outputs[index] for index in indices])


def thrust_over_height(aircraft: Aircraft) -> Heights:
    """Return the height dependence of full thrust; its end is that of the shortest table."""
    tables: list[xr.Dataset] = []
    lapses = []
    for engine in aircraft.engines:
        leaves = list_leaves(engine)
        tables += [leaves[name] for name in _FULL_THROTTLE_TABLES if name in leaves]
        lapses.append("corrected_thrust" in leaves)
    end = np.inf
    for table in tables:
        if "h" in table.coords and table["h"].size > 1:
            end = min(end, float(table["h"][-1]))
    return Heights(end, all(lapses))
