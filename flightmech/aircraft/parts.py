"""Exchange of parts between two aircraft: engines, landing gear, control circuits and fuel.

A part has a name with a slash, as a term of the aerodynamics has. The parts of the engine decks,
for all engines together, are ``engine/static`` (thrust and air flow over speed),
``engine/schedule`` (lever to commanded speed), ``engine/dynamics`` (response of the rotors) and
``engine/rest``. Other parts are ``gear/nose`` (a contact), ``gear/steering``, ``gear/runway``,
``circuit/column``, ``fuel/load`` and ``stall/separation``. Geometry, mass and limits are not parts.
Parts can only be exchanged between two models of the same aeroplane.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import SchemaError


@dataclass(frozen=True)
class _PartAccess:
    """Functions that read a part of an aircraft, and replace it in a copy of an aircraft."""

    get: Callable[[Aircraft], Any]
    put: Callable[[Aircraft, Any], Aircraft]


def different_parts(one: Aircraft, other: Aircraft) -> list[str]:
    """Return the names of the parts that differ between two aircraft, or that only one has.

    Raises
    ------
    SchemaError
        They have different numbers of engines.
    """
    _demand_one_aeroplane(one, other)
    parts = _list_parts(one) | _list_parts(other)
    return [name for name, part in parts.items() if not _is_same(part.get(one), part.get(other))]


def swap_parts(into: Aircraft, source: Aircraft, names: Iterable[str]) -> Aircraft:
    """Return a copy of `into` with parts of `source`.

    Parameters
    ----------
    into, source : Aircraft
        Two models of one aeroplane.
    names : iterable of str
        Parts to exchange. A part that `source` does not have is removed. Other names, such as
        terms of the aerodynamics, are ignored.

    Raises
    ------
    SchemaError
        They have different numbers of engines, or the exchanged tables do not form a valid deck.
    """
    _demand_one_aeroplane(into, source)
    parts = _list_parts(into) | _list_parts(source)
    for name in names:
        if name in parts:
            into = parts[name].put(into, parts[name].get(source))
    return into


def _demand_one_aeroplane(a: Aircraft, b: Aircraft) -> None:
    if len(a.engines) == len(b.engines):
        return
    numbers = " and ".join(f"{len(item.engines)} ({item.name})" for item in (a, b))
    raise SchemaError(
        "aircraft",
        [
            f"engines: {numbers}; give two models of one aeroplane, only these can lend "
            f"parts to each other"
        ],
    )


def _list_parts(aircraft: Aircraft) -> dict[str, _PartAccess]:
    """Return the parts of an aircraft by name."""
    parts = {f"engine/{name}": part for name, part in _engine_parts(aircraft).items()}
    gear = aircraft.gear
    if gear is not None:
        for contact in gear.contacts:
            parts[f"gear/{contact.name}"] = _contact_part(contact.name)
        runway = [item.name for item in fields(gear) if item.name not in ("contacts", "steering")]
        parts["gear/steering"] = _gear_part(("steering",))
        parts["gear/runway"] = _gear_part(tuple(runway))
    for name in aircraft.circuits:
        parts[f"circuit/{name}"] = _circuit_part(name)
    if aircraft.fuel is not None:
        parts["fuel/load"] = _PartAccess(_get_fuel, _put_fuel)
    if aircraft.stall is not None:
        parts["stall/separation"] = _PartAccess(
            lambda a: a.stall, lambda a, value: replace(a, stall=value)
        )
    return parts


def _get_fuel(aircraft: Aircraft) -> Any:
    # what engines draw from names the tanks of the fuel
    feeds = tuple((engine.feed, engine.crossfeed) for engine in aircraft.engines)
    return aircraft.fuel, feeds


def _put_fuel(aircraft: Aircraft, value: Any) -> Aircraft:
    fuel, feeds = value
    engines = []
    for engine, (feed, crossfeed) in zip(aircraft.engines, feeds, strict=True):
        engines.append(replace(engine, feed=feed, crossfeed=crossfeed))
    return replace(aircraft, fuel=fuel, engines=tuple(engines))


def _engine_parts(aircraft: Aircraft) -> dict[str, _PartAccess]:
    parts = {}
    for name in ("propeller", "piston", "motor"):
        if any(getattr(engine, name) for engine in aircraft.engines):
            parts[name] = _section_part(name)
    # all engines have a deck, or none has
    if any(engine.deck for engine in aircraft.engines):
        return parts | {group: _deck_part(group) for group in (*_GROUPS, "rest")}
    if aircraft.engines and not parts:
        return {"thrust": _static_thrust_part()}
    return parts


def _section_part(name: str) -> _PartAccess:
    """Return the part that is a section of the engines, for all engines."""

    def get(aircraft: Aircraft) -> Any:
        return tuple(getattr(engine, name) for engine in aircraft.engines)

    def put(aircraft: Aircraft, values: Any) -> Aircraft:
        engines = []
        for engine, value in zip(aircraft.engines, values, strict=True):
            engines.append(replace(engine, **{name: value}))
        return replace(aircraft, engines=tuple(engines))

    return _PartAccess(get, put)


def _static_thrust_part() -> _PartAccess:
    """Return the part of the static thrust and its lag, for all engines."""

    def get(aircraft: Aircraft) -> Any:
        return tuple((engine.thrust, engine.time_constant) for engine in aircraft.engines)

    def put(aircraft: Aircraft, values: Any) -> Aircraft:
        engines = []
        for engine, (thrust, time_constant) in zip(aircraft.engines, values, strict=True):
            engines.append(replace(engine, thrust=thrust, time_constant=time_constant))
        return replace(aircraft, engines=tuple(engines))

    return _PartAccess(get, put)


# by group: parts of the names of tables and constants that belong to the group
_GROUPS = {
    "static": ("thrust", "air_flow", "inlet"),
    "schedule": ("command",),
    "dynamics": ("_time", "_limit", "delay", "rundown"),
}


def _find_group(name: str) -> str:
    """Return the group of a table or constant of a deck."""
    for group, patterns in _GROUPS.items():
        if any(pattern in name for pattern in patterns):
            return group
    return "rest"


def _deck_part(group: str) -> _PartAccess:
    """Return the part with the tables and constants of a group, for all decks."""

    def select(deck: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        tables = {name: leaf for name, leaf in deck.tables.items() if _find_group(name) == group}
        names = [item.name for item in fields(deck) if item.name != "tables"]
        constants = {name: getattr(deck, name) for name in names if _find_group(name) == group}
        return tables, constants

    def get(aircraft: Aircraft) -> Any:
        return tuple(select(engine.deck) if engine.deck else None for engine in aircraft.engines)

    def put(aircraft: Aircraft, values: Any) -> Aircraft:
        engines = []
        for engine, value in zip(aircraft.engines, values, strict=True):
            if engine.deck and value:
                engine = replace(engine, deck=change(engine.deck, *value))
            engines.append(engine)
        return replace(aircraft, engines=tuple(engines))

    def change(deck: Any, tables: Any, constants: Any) -> Any:
        # the tables of the other groups remain
        others = {name: leaf for name, leaf in deck.tables.items() if _find_group(name) != group}
        return replace(deck, tables=others | tables, **constants)

    return _PartAccess(get, put)


def _contact_part(name: str) -> _PartAccess:
    def get(aircraft: Aircraft) -> Any:
        if aircraft.gear is not None:
            for contact in aircraft.gear.contacts:
                if contact.name == name:
                    return contact
        return None

    def put(aircraft: Aircraft, contact: Any) -> Aircraft:
        if aircraft.gear is None:
            return aircraft
        # the contact keeps its position in the order, a new one is the last
        contacts = {item.name: item for item in aircraft.gear.contacts} | {name: contact}
        present = tuple(item for item in contacts.values() if item is not None)
        return replace(aircraft, gear=replace(aircraft.gear, contacts=present))

    return _PartAccess(get, put)


def _gear_part(names: tuple[str, ...]) -> _PartAccess:
    """Return the part that consists of fields of the landing gear."""

    def get(aircraft: Aircraft) -> Any:
        if aircraft.gear is None:
            return None
        return {name: getattr(aircraft.gear, name) for name in names}

    def put(aircraft: Aircraft, values: Any) -> Aircraft:
        if aircraft.gear is None or values is None:
            return aircraft
        return replace(aircraft, gear=replace(aircraft.gear, **values))

    return _PartAccess(get, put)


def _circuit_part(name: str) -> _PartAccess:
    # a circuit that the source does not have is removed
    def put(aircraft: Aircraft, circuit: Any) -> Aircraft:
        circuits = {key: item for key, item in aircraft.circuits.items() if key != name}
        if circuit is not None:
            circuits[name] = circuit
        return replace(aircraft, circuits=circuits)

    return _PartAccess(lambda aircraft: aircraft.circuits.get(name), put)


def _is_same(a: Any, b: Any) -> bool:
    """Return whether two values are equal, with tables, sequences and dataclasses inside."""
    # before the comparison of mappings, because a Dataset is one
    if isinstance(a, xr.Dataset) or isinstance(b, xr.Dataset):
        if not (isinstance(a, xr.Dataset) and isinstance(b, xr.Dataset)):
            return False
        return a.equals(b) and a.attrs == b.attrs
    if isinstance(a, tuple | list) and isinstance(b, tuple | list):
        return len(a) == len(b) and all(map(_is_same, a, b))
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        return a.keys() == b.keys() and all(_is_same(a[key], b[key]) for key in a)
    if hasattr(a, "__dataclass_fields__") and type(a) is type(b):
        return all(_is_same(getattr(a, item.name), getattr(b, item.name)) for item in fields(a))
    return bool(a == b)
