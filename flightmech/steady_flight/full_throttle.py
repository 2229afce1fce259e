"""Thrust at full throttle in settled flight, from thrust tables or engine decks, as the kernel settles its engines."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr

from ..aircraft.aircraft import Aircraft
from ..simulation.run import constant_inputs, prepared
from .trim_point import Point

NO_THRUST = "the aircraft file gives an engine neither a thrust table nor a deck"
_SPEEDS = tuple(f"{corrected}{n}_command" for corrected in ("", "corrected_") for n in ("n1", "n2"))  # tables of a deck that govern


class Heights(NamedTuple):
    """What thrust does over height: where its tables end [m], infinite when none has such an axis; whether it goes with the pressure."""

    end: float
    lapses: bool


def has_thrust(aircraft: Aircraft) -> bool:
    """Return whether there are engines and each has a thrust table or a deck."""
    return bool(aircraft.engines) and all(engine.thrust is not None or engine.deck is not None for engine in aircraft.engines)


def burns_fuel(aircraft: Aircraft) -> bool:
    """Return whether there are engines and each has a deck with a fuel flow."""
    decks = [engine.deck for engine in aircraft.engines]
    return bool(decks) and all(deck is not None and {"fuel_flow", "corrected_fuel_flow"} & set(deck.tables) for deck in decks)


def full_thrust(flight: Point) -> np.ndarray:
    """Return the net thrust (engine,) at full throttle, spools settled, at the speed and height of a flight. [N]"""
    numbers = range(1, len(flight.aircraft.engines) + 1)
    full = flight.aircraft.limits.get("throttle", (0.0, 1.0))[1] - flight.parameter("bias.throttle")
    lever = {f"engine{number}.throttle": full for number in numbers}
    attitude = {"init.alpha": flight["alpha"], "init.beta": flight["beta"]}
    values = {**flight.parameters, **attitude, **lever, "mode.engine": 0.0, "mode.trim": 0.0}
    outputs = prepared(flight.sim, values, constant_inputs(flight.sim, values)).outputs()
    return np.array([outputs[flight.sim.outputs.index(f"engine{number}.thrust")] for number in numbers])


def heights(aircraft: Aircraft) -> Heights:
    """Return what the thrust at full throttle does over height, of the engine whose tables end first."""
    tables: list[xr.Dataset] = []
    lapses = []
    for engine in aircraft.engines:
        deck = {} if engine.deck is None else engine.deck.tables
        tables += [deck[name] for name in ("thrust", "corrected_thrust", *_SPEEDS) if name in deck]
        tables += [] if engine.thrust is None else [engine.thrust]
        lapses.append("corrected_thrust" in deck)
    ends = [float(leaf["h"][-1]) for leaf in tables if "h" in leaf.coords and leaf["h"].size > 1]
    return Heights(min(ends, default=np.inf), all(lapses))
