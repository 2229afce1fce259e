"""Parts of an aircraft that can be exchanged with those of another: engines, landing gear, control
circuits, fuel.

A part has a name with a slash like a term of the aerodynamics: ``engine/static`` (thrust and air
flow over speed), ``engine/schedule`` (lever to commanded speed), ``engine/dynamics`` (how the
rotors follow) and ``engine/rest`` of the decks of all engines, ``gear/nose`` a contact,
``gear/steering``, ``gear/runway``, ``circuit/column``, ``fuel/load``. Geometry, mass and limits are
no parts: two aircraft that lend parts to each other must be one aeroplane.
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
    """How a part is read from an aircraft and put into another."""

    get: Callable[[Aircraft], Any]
    put: Callable[[Aircraft, Any], Aircraft]


def different_parts(one: Aircraft, other: Aircraft) -> list[str]:
    """Return the names of the parts that are not the same in two aircraft, or only in one of them.

    Raises
    ------
    SchemaError
        They have different numbers of engines.
    """
    _demand_one_aeroplane(one, other)
    known = _parts(one) | _parts(other)
    return [name for name, part in known.items() if not _same(part.get(one), part.get(other))]


def swap_parts(into: Aircraft, source: Aircraft, names: Iterable[str]) -> Aircraft:
    """Return `into` with the named parts as they are in `source`; a part that `source` does not
    have is taken out.

    Names that are parts of neither, such as terms of the aerodynamics, are passed over.

    Raises
    ------
    SchemaError
        They have different numbers of engines, or the engines with the exchanged tables make no
        deck.
    """
    _demand_one_aeroplane(into, source)
    known = _parts(into) | _parts(source)
    for name in names:
        if name in known:
            into = known[name].put(into, known[name].get(source))
    return into


def _demand_one_aeroplane(one: Aircraft, other: Aircraft) -> None:
    if len(one.engines) != len(other.engines):
        numbers = " and ".join(
            f"{len(aircraft.engines)} ({aircraft.name})" for aircraft in (one, other)
        )
        raise SchemaError(
            "aircraft",
            [
                f"engines: {numbers}; give two models of one aeroplane, only these can lend "
                f"parts to each other"
            ],
        )


def _parts(aircraft: Aircraft) -> dict[str, _PartAccess]:
    found = {f"engine/{name}": part for name, part in _engine_parts(aircraft).items()}
    if aircraft.gear is not None:
        found |= {
            f"gear/{contact.name}": _contact(contact.name) for contact in aircraft.gear.contacts
        }
        found |= {"gear/steering": _field_of("gear", ("steering",))}
        found |= {
            "gear/runway": _field_of(
                "gear",
                tuple(
                    f.name for f in fields(aircraft.gear) if f.name not in ("contacts", "steering")
                ),
            )
        }
    found |= {f"circuit/{name}": _circuit(name) for name in aircraft.circuits}
    if aircraft.fuel is not None:
        found["fuel/load"] = _PartAccess(lambda a: a.fuel, lambda a, value: replace(a, fuel=value))
    return found


def _engine_parts(aircraft: Aircraft) -> dict[str, _PartAccess]:
    if not any(engine.deck for engine in aircraft.engines):
        return {"thrust": _engines(("thrust", "time_constant"))} if aircraft.engines else {}
    return {group: _deck_part(group) for group in (*_GROUP, "rest")}


def _engines(names: tuple[str, ...]) -> _PartAccess:
    def get(aircraft: Aircraft) -> Any:
        return tuple(tuple(getattr(engine, name) for name in names) for engine in aircraft.engines)

    def put(aircraft: Aircraft, values: Any) -> Aircraft:
        engines = zip(aircraft.engines, values, strict=True)
        return replace(
            aircraft,
            engines=tuple(
                replace(engine, **dict(zip(names, value, strict=True))) for engine, value in engines
            ),
        )

    return _PartAccess(get, put)


# words in the names of the tables and constants of a deck that make a group
_GROUP = {
    "static": ("thrust", "air_flow", "inlet"),
    "schedule": ("command",),
    "dynamics": ("_time", "_limit", "delay", "rundown"),
}


def _group_of(name: str) -> str:
    return next(
        (group for group, words in _GROUP.items() if any(word in name for word in words)), "rest"
    )


def _deck_part(group: str) -> _PartAccess:
    """Return the part of all decks that holds the tables and constants of a group."""

    def own(deck: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        tables = {name: leaf for name, leaf in deck.tables.items() if _group_of(name) == group}
        return tables, {
            f.name: getattr(deck, f.name)
            for f in fields(deck)
            if f.name != "tables" and _group_of(f.name) == group
        }

    def get(aircraft: Aircraft) -> Any:
        return tuple(own(engine.deck) if engine.deck else None for engine in aircraft.engines)

    def put(aircraft: Aircraft, values: Any) -> Aircraft:
        engines = [
            replace(engine, deck=change(engine.deck, *new)) if engine.deck and new else engine
            for engine, new in zip(aircraft.engines, values, strict=True)
        ]
        return replace(aircraft, engines=tuple(engines))

    def change(deck: Any, tables: Any, constants: Any) -> Any:
        rest = {name: leaf for name, leaf in deck.tables.items() if _group_of(name) != group}
        return replace(deck, tables=rest | tables, **constants)

    return _PartAccess(get, put)


def _contact(name: str) -> _PartAccess:
    def get(aircraft: Aircraft) -> Any:
        return (
            next((contact for contact in aircraft.gear.contacts if contact.name == name), None)
            if aircraft.gear
            else None
        )

    def put(aircraft: Aircraft, contact: Any) -> Aircraft:
        if aircraft.gear is None:
            return aircraft
        own = {c.name: c for c in aircraft.gear.contacts} | {name: contact}
        return replace(
            aircraft,
            gear=replace(aircraft.gear, contacts=tuple(c for c in own.values() if c is not None)),
        )

    return _PartAccess(get, put)


def _field_of(owner: str, names: tuple[str, ...]) -> _PartAccess:
    def get(aircraft: Aircraft) -> Any:
        item = getattr(aircraft, owner)
        return {name: getattr(item, name) for name in names} if item is not None else None

    def put(aircraft: Aircraft, values: Any) -> Aircraft:
        item = getattr(aircraft, owner)
        return (
            replace(aircraft, **{owner: replace(item, **values)})
            if item is not None and values is not None
            else aircraft
        )

    return _PartAccess(get, put)


def _circuit(name: str) -> _PartAccess:
    def put(aircraft: Aircraft, circuit: Any) -> Aircraft:
        rest = {key: item for key, item in aircraft.circuits.items() if key != name}
        return replace(aircraft, circuits=rest if circuit is None else {**rest, name: circuit})

    return _PartAccess(lambda aircraft: aircraft.circuits.get(name), put)


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, xr.Dataset) or isinstance(b, xr.Dataset):
        return (
            isinstance(a, xr.Dataset)
            and isinstance(b, xr.Dataset)
            and a.equals(b)
            and a.attrs == b.attrs
        )
    if isinstance(a, tuple | list) and isinstance(b, tuple | list):
        return len(a) == len(b) and all(map(_same, a, b))
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        return a.keys() == b.keys() and all(_same(a[key], b[key]) for key in a)
    if hasattr(a, "__dataclass_fields__") and type(a) is type(b):
        return all(_same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return bool(a == b)
