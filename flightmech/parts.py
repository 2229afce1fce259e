"""Parts of an aircraft that can be exchanged with those of another: engines, landing gear, control circuits, fuel.

A part has a name with a slash like a term of the aerodynamics: ``engine/n2_command`` is a table of the deck of all engines,
``engine/constants`` their constants, ``gear/nose`` a contact, ``gear/steering``, ``gear/runway``, ``circuit/column``, ``fuel``.
Geometry, mass and limits are no parts: two aircraft that lend parts to each other must be one aeroplane.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import xarray as xr

from .aircraft import Aircraft


@dataclass(frozen=True)
class _Part:
    """How a part is read from an aircraft and put into another."""

    get: Callable[[Aircraft], Any]
    put: Callable[[Aircraft, Any], Aircraft]


def different_parts(one: Aircraft, other: Aircraft) -> list[str]:
    """Return the names of the parts that are not the same in two aircraft, or only in one of them."""
    known = _parts(one) | _parts(other)
    return [name for name, part in known.items() if not _same(part.get(one), part.get(other))]


def swap_parts(into: Aircraft, source: Aircraft, names: Iterable[str]) -> Aircraft:
    """Return `into` with the named parts as they are in `source`; a part that `source` does not have is taken out.

    Names that are parts of neither, such as terms of the aerodynamics, are passed over.

    Raises
    ------
    SchemaError
        The engines with the exchanged tables make no deck.
    """
    known = _parts(into) | _parts(source)
    for name in names:
        if name in known:
            into = known[name].put(into, known[name].get(source))
    return into


def _parts(aircraft: Aircraft) -> dict[str, _Part]:
    found = {f"engine/{name}": part for name, part in _engine_parts(aircraft).items()}
    if aircraft.gear is not None:
        found |= {f"gear/{contact.name}": _contact(contact.name) for contact in aircraft.gear.contacts}
        found |= {"gear/steering": _field_of("gear", ("steering",))}
        found |= {"gear/runway": _field_of("gear", tuple(f.name for f in fields(aircraft.gear) if f.name not in ("contacts", "steering")))}
    found |= {f"circuit/{name}": _circuit(name) for name in aircraft.circuits}
    if aircraft.fuel is not None:
        found["fuel"] = _Part(lambda a: a.fuel, lambda a, value: replace(a, fuel=value))
    return found


def _engine_parts(aircraft: Aircraft) -> dict[str, _Part]:
    if not any(engine.deck for engine in aircraft.engines):
        return {"thrust": _engines(("thrust", "time_constant"))} if aircraft.engines else {}
    tables = {name for engine in aircraft.engines if engine.deck for name in engine.deck.tables}
    return {name: _deck_table(name) for name in sorted(tables)} | {"constants": _deck_constants()}


def _engines(names: tuple[str, ...]) -> _Part:
    def get(aircraft: Aircraft) -> Any:
        return tuple(tuple(getattr(engine, name) for name in names) for engine in aircraft.engines)

    def put(aircraft: Aircraft, values: Any) -> Aircraft:
        engines = zip(aircraft.engines, values, strict=True)
        return replace(aircraft, engines=tuple(replace(engine, **dict(zip(names, value, strict=True))) for engine, value in engines))

    return _Part(get, put)


def _with_decks(aircraft: Aircraft, change: Callable[[Any, int], Any]) -> Aircraft:
    engines = [replace(engine, deck=change(engine.deck, i)) if engine.deck else engine for i, engine in enumerate(aircraft.engines)]
    return replace(aircraft, engines=tuple(engines))


def _deck_table(name: str) -> _Part:
    def get(aircraft: Aircraft) -> Any:
        return tuple(engine.deck.tables.get(name) if engine.deck else None for engine in aircraft.engines)

    def put(aircraft: Aircraft, tables: Any) -> Aircraft:
        def change(deck: Any, i: int) -> Any:
            rest = {key: leaf for key, leaf in deck.tables.items() if key != name}
            return replace(deck, tables=rest if tables[i] is None else {**rest, name: tables[i]})

        return _with_decks(aircraft, change)

    return _Part(get, put)


def _deck_constants() -> _Part:
    def constants(deck: Any) -> dict[str, Any]:
        return {f.name: getattr(deck, f.name) for f in fields(deck) if f.name != "tables"}

    def get(aircraft: Aircraft) -> Any:
        return tuple(constants(engine.deck) if engine.deck else None for engine in aircraft.engines)

    def put(aircraft: Aircraft, values: Any) -> Aircraft:
        return _with_decks(aircraft, lambda deck, i: replace(deck, **values[i]) if values[i] else deck)

    return _Part(get, put)


def _contact(name: str) -> _Part:
    def get(aircraft: Aircraft) -> Any:
        return next((contact for contact in aircraft.gear.contacts if contact.name == name), None) if aircraft.gear else None

    def put(aircraft: Aircraft, contact: Any) -> Aircraft:
        if aircraft.gear is None:
            return aircraft
        own = {c.name: c for c in aircraft.gear.contacts} | {name: contact}
        return replace(aircraft, gear=replace(aircraft.gear, contacts=tuple(c for c in own.values() if c is not None)))

    return _Part(get, put)


def _field_of(owner: str, names: tuple[str, ...]) -> _Part:
    def get(aircraft: Aircraft) -> Any:
        item = getattr(aircraft, owner)
        return {name: getattr(item, name) for name in names} if item is not None else None

    def put(aircraft: Aircraft, values: Any) -> Aircraft:
        item = getattr(aircraft, owner)
        return replace(aircraft, **{owner: replace(item, **values)}) if item is not None and values is not None else aircraft

    return _Part(get, put)


def _circuit(name: str) -> _Part:
    def put(aircraft: Aircraft, circuit: Any) -> Aircraft:
        rest = {key: item for key, item in aircraft.circuits.items() if key != name}
        return replace(aircraft, circuits=rest if circuit is None else {**rest, name: circuit})

    return _Part(lambda aircraft: aircraft.circuits.get(name), put)


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, xr.Dataset) or isinstance(b, xr.Dataset):
        return isinstance(a, xr.Dataset) and isinstance(b, xr.Dataset) and a.equals(b) and a.attrs == b.attrs
    if isinstance(a, tuple | list) and isinstance(b, tuple | list):
        return len(a) == len(b) and all(map(_same, a, b))
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        return a.keys() == b.keys() and all(_same(a[key], b[key]) for key in a)
    if hasattr(a, "__dataclass_fields__") and type(a) is type(b):
        return all(_same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return bool(a == b)
