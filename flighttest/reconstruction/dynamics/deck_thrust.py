"""Thrust of jet engines along a flight, from recorded spool speeds and the deck of the aircraft.

A gauge shows N1, not thrust. The tables of the deck turn the recorded speeds into thrust with the
equations of the kernel (`kernel/src/propulsion/spool.c`), theta and delta of total temperature and
ambient pressure::

    F = thrust + delta corrected_thrust        along the thrust line; T' = (F - T) / time_constant
    W = air_flow + delta / sqrt(theta) corrected_air_flow          ram drag W V against the airspeed

An engine without fuel (``cutoff`` or ``flameout``) has ``windmill_thrust``, zero without that
table.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping

import numpy as np
import xarray as xr

from flightmech.air import P_SEA, T_SEA
from flightmech.aircraft.engine import Engine
from flightmech.aircraft.propulsion.engine_deck import EngineDeck
from flightmech.errors import AeromatchWarning, UnknownName
from flightmech.terms import evaluate_term
from flighttest.reconstruction.dynamics.shaft_condition import Condition, air_of

_SPOOLS = ("n1", "n2")
# A plain and a corrected table of each force of the engine.
_THRUST = ("thrust", "corrected_thrust")
_AIR_FLOW = ("air_flow", "corrected_air_flow")
# Speed beyond the ends of a table that the noise of a gauge does not explain. [1]
_BEYOND = 0.01


def has_spool_speed(names: Mapping[str, object] | xr.Dataset, engine: Engine, number: int) -> bool:
    """Return whether the thrust of a jet follows from recorded speeds of its spools.

    Parameters
    ----------
    names : mapping
        Channels by name.
    engine : Engine
    number : int
        1 for the first.
    """
    deck = engine.deck
    if deck is None or engine.propeller is not None:
        return False
    tables = [deck.tables[name] for name in _THRUST if name in deck.tables]
    needed: set[str] = set()
    for leaf in tables:
        needed.update(map(str, leaf["value"].dims))
    speeds = {name.removeprefix("corrected_") for name in needed} & set(_SPOOLS)
    if speeds == {"n2"} or ("n2" in speeds and "corrected_n2_driven" not in deck.tables):
        return all(f"engine{number}.{spool}" in names for spool in speeds)
    # a thrust that depends on no speed is not one of a recorded speed
    return bool(speeds) and f"engine{number}.n1" in names


def deck_channels(
    columns: Mapping[str, np.ndarray], engine: Engine, number: int
) -> dict[str, np.ndarray]:
    """Return net thrust of a jet, and gross thrust and ram drag if it takes in air.

    Parameters
    ----------
    columns : mapping of str to array (time,)
        ``time``, ``V``, the air (`air_of`), ``engineN.n1`` or ``n2`` [1], and what else the tables
        depend on. [SI]
    engine : Engine
        With a deck, without a propeller.
    number : int
        N.

    Raises
    ------
    UnknownName
        A variable of the tables is not among the columns.

    Warns
    -----
    AeromatchWarning
        A recorded speed lies beyond the table of the thrust.
    """
    deck = engine.deck
    assert deck is not None, "has_spool_speed"
    at = _deck_condition(columns, deck, number)
    gross = _sum_tables(deck, _THRUST, at, at["pressure_ratio"])
    is_out = np.zeros(len(gross), bool)
    for switch in ("cutoff", "flameout"):
        is_out = is_out | (at.get(switch, 0.0 * gross) > 0.5)
    _warn_beyond(deck, at, number, burns=~is_out)
    if is_out.any():
        gross = np.where(is_out, _sum_tables(deck, ("windmill_thrust",), at), gross)
    gross = _lagged(gross, columns["time"], engine.time_constant)
    if not set(_AIR_FLOW) & set(deck.tables):
        return {"thrust": gross}
    factor = at["pressure_ratio"] / np.sqrt(at["temperature_ratio"])
    flow = np.maximum(_sum_tables(deck, _AIR_FLOW, at, factor), 0.0)
    ram = flow * columns["V"]
    return {"thrust": gross - ram, "gross_thrust": gross, "ram_drag": ram}


def _deck_condition(columns: Mapping[str, np.ndarray], deck: EngineDeck, number: int) -> Condition:
    """Return the variables of the tables of one engine, with the definitions of the kernel."""
    prefix = f"engine{number}."
    air = {**columns, **air_of(columns)}
    mach = columns["V"] / air["a_sound"]
    theta = air["temperature"] / T_SEA * (1.0 + 0.2 * mach**2)
    at = {name: values for name, values in air.items() if "." not in name}
    for name, values in columns.items():
        if name.startswith(prefix):
            at[name.removeprefix(prefix)] = values
    at |= {"mach": mach, "temperature_ratio": theta, "pressure_ratio": air["p_static"] / P_SEA}
    if "pla" not in at and "throttle" in at:
        at["pla"] = deck.pla_idle + at["throttle"] * (deck.pla_full - deck.pla_idle)
    for spool in _SPOOLS:
        if spool in at:
            at[f"corrected_{spool}"] = at[spool] / np.sqrt(theta)
    if "n2" not in at and "corrected_n2_driven" in deck.tables:
        at["corrected_n2"] = _table(deck, "corrected_n2_driven", at)
        at["n2"] = at["corrected_n2"] * np.sqrt(theta)
    return at


def _sum_tables(
    deck: EngineDeck, names: tuple[str, ...], at: Condition, factor: np.ndarray | float = 1.0
) -> np.ndarray:
    """Return the sum of tables (time,); those of corrected quantities count with the factor."""
    total = np.zeros_like(at["mach"])
    for name in names:
        if name in deck.tables:
            scale = factor if name.startswith("corrected") else 1.0
            total = total + scale * _table(deck, name, at)
    return total


def _table(deck: EngineDeck, name: str, at: Condition) -> np.ndarray:
    try:
        values = evaluate_term(deck.tables[name], at, outside="clamp")
    except UnknownName as error:
        raise UnknownName(
            str(error.name),
            set(at) - {"time"},
            f"variable of the table {name} of the engine deck",
            "map its column in the name map of the record, or map the thrust itself",
        ) from error
    return np.broadcast_to(values, at["mach"].shape).astype(float)


def _lagged(gross: np.ndarray, time: np.ndarray, tau: float) -> np.ndarray:
    """Return a thrust behind its first-order lag (time,), settled at the start."""
    if tau <= 0.0:
        return gross
    lagged = gross.copy()
    for k in range(1, len(gross)):
        # exact for a thrust that changes linearly over the step; a blank sample starts anew
        steps = (time[k] - time[k - 1]) / tau
        passed = -np.expm1(-steps)
        if np.isfinite(lagged[k - 1]) and steps > 0.0:
            late = (gross[k] - gross[k - 1]) * (1.0 - passed / steps)
            lagged[k] = lagged[k - 1] + passed * (gross[k - 1] - lagged[k - 1]) + late
    return lagged


def _warn_beyond(deck: EngineDeck, at: Condition, number: int, *, burns: np.ndarray) -> None:
    """Warn of recorded speeds beyond the table, where its last value holds.

    An engine without fuel, `burns` (time,) false, has its thrust from another table.
    """
    for name in _THRUST:
        if name not in deck.tables:
            continue
        for dim in deck.tables[name]["value"].dims:
            axis = str(dim)
            if axis.removeprefix("corrected_") not in _SPOOLS:
                continue
            nodes = deck.tables[name][axis].values
            values = at[axis][np.isfinite(at[axis]) & burns]
            if not len(values):
                continue
            if values.min() < nodes.min() - _BEYOND or values.max() > nodes.max() + _BEYOND:
                warnings.warn(
                    f"engine {number}: recorded {axis} is {values.min():.3g} ... "
                    f"{values.max():.3g}, and the table {name} of its deck has {nodes.min():.3g} "
                    f"... {nodes.max():.3g}: the thrust beyond is that of the end; extend the "
                    f"table, or check the unit of {axis.removeprefix('corrected_')}",
                    AeromatchWarning,
                    stacklevel=5,
                )
