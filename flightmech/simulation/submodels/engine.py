"""Catalogue rows and tables of the engines."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from flightmech.aircraft.engine import MOST, Engine
from flightmech.aircraft.engine_deck import OWN
from flightmech.errors import SchemaError
from flightmech.names import lookup
from flightmech.simulation.kernel import INPUT, OUTPUT, STATE, VARIABLE, CatalogueEntry
from flightmech.terms import list_regressors

if TYPE_CHECKING:
    import xarray as xr

    from flightmech.aircraft.aircraft import Aircraft

# quantity: unit, unit for people, description, least value
_CONSTANTS: dict[str, tuple[str, str, str, float]] = {
    "time_constant": ("s", "s", "first-order lag of the thrust", 0.0),
    "angular_momentum": (
        "kg m2 s-1",
        "kg m2 s-1",
        "angular momentum of the rotors along the thrust",
        -MOST,
    ),
    "lever_delay": ("s", "s", "transport delay of the power lever", 0.0),
    "pla_idle": ("rad", "deg", "lever angle at throttle 0", -MOST),
    "pla_full": ("rad", "deg", "lever angle at throttle 1", -MOST),
    "n1_rundown": ("s", "s", "time constant of n1 towards windmilling", 0.0),
    "n2_rundown": ("s", "s", "time constant of n2 towards windmilling", 0.0),
    "starter_speed": ("1", "%", "speed to which the starter turns the gas generator", 0.0),
    "starter_time": ("s", "s", "time constant of the starter", 0.0),
    "light_speed": ("1", "%", "least speed of the gas generator to light", 0.0),
    "sustain_speed": ("1", "%", "speed of the gas generator below which the flame goes out", 0.0),
    "flame_time": ("s", "s", "time constant of the flame", 0.0),
    "itt_time": ("s", "s", "lag of the inter-turbine temperature", 0.0),
    "n1_rated": ("rad s-1", "rpm", "rotor speed at n1 = 1, right-handed about the thrust", -MOST),
    "n2_rated": ("rad s-1", "rpm", "rotor speed at n2 = 1, right-handed about the thrust", -MOST),
    "n1_inertia": ("kg m2", "kg m2", "moment of inertia of the n1 rotor", 0.0),
    "n2_inertia": ("kg m2", "kg m2", "moment of inertia of the n2 rotor", 0.0),
}
_DRIVES = {
    "thrust_drive": ("thrust", "net thrust that drives when mode.engine is 2"),
    "n1_drive": ("n1", "n1 that drives when mode.engine is 1"),
}
_SWITCHES = ("cutoff", "starter", "ignition", "flameout")


def items(aircraft: Aircraft) -> dict[str, tuple[str, ...]]:
    """Return the items of the groups: engines are numbered from 1, all have spools or none has.

    Raises
    ------
    SchemaError
        Some engines have a deck and some have none.
    """
    numbers = tuple(str(number) for number in range(1, len(aircraft.engines) + 1))
    without = [
        number
        for number, engine in zip(numbers, aircraft.engines, strict=True)
        if engine.deck is None
    ]
    if without and len(without) < len(numbers):
        raise SchemaError(
            aircraft.name,
            [
                f"engine {', '.join(without)} has no deck and others have one; give every "
                f"engine one or none"
            ],
        )
    return {"engine": numbers, "spool": () if without else numbers}


def row(kind: int, group: str, item: str, name: str, aircraft: Aircraft) -> CatalogueEntry:
    """Return the catalogue row of a name of an engine."""
    word = name.rsplit(".", 1)[-1]
    engine = aircraft.engines[int(item) - 1]
    if word in _DRIVES:
        like, text = _DRIVES[word]
        return _like(name, like)._replace(description=text)
    if kind == INPUT:
        return _like(
            name,
            word,
            *((0.0, 1.0) if word in _SWITCHES else aircraft.limits.get(word, (0.0, 1.0))),
        )
    if kind in (OUTPUT, STATE, VARIABLE):
        return _like(name, word)
    if word in _CONSTANTS:
        units, display, text, low = _CONSTANTS[word]
        return CatalogueEntry(
            name,
            units,
            display,
            text,
            getattr(engine if hasattr(engine, word) else engine.deck, word),
            low,
            MOST,
            0,
        )
    return _geometry(name, word, engine)


def _geometry(name: str, word: str, engine: Engine) -> CatalogueEntry:
    axis = word.removesuffix("_inlet")[-1]
    if word.startswith("direction"):
        return CatalogueEntry(
            name,
            "1",
            "1",
            f"direction of the thrust, body {axis}",
            engine.direction["xyz".index(axis)],
            -1.0,
            1.0,
            0,
        )
    at_inlet = word.endswith("_inlet") and engine.deck is not None and engine.deck.inlet is not None
    at = engine.deck.inlet if at_inlet else engine.position  # type: ignore[union-attr]
    what = "ram drag" if word.endswith("_inlet") else "thrust"
    text = f"place of the {what} from the moment reference point, body {axis}"
    return CatalogueEntry(name, "m", "m", text, at["xyz".index(axis)], -MOST, MOST, 0)  # type: ignore[index]


def terms(aircraft: Aircraft) -> Iterator[tuple[str, str, xr.Dataset]]:
    """Return the tables of thrust and of the decks."""
    for number, engine in enumerate(aircraft.engines, 1):
        tables = {} if engine.thrust is None else {"thrust": engine.thrust}
        for target, leaf in (tables if engine.deck is None else engine.deck.tables).items():
            yield (
                f"engine{number}.{target}",
                f"engine{number}/{target}",
                _renamed(leaf, {name: f"engine{number}.{name}" for name in OWN}),
            )


def _like(name: str, quantity_: str, low: float = -MOST, high: float = MOST) -> CatalogueEntry:
    found = lookup(quantity_)
    sign = f", positive {found.sign}" if found.sign else ""
    return CatalogueEntry(
        name, found.units, found.display_units, found.long_name + sign, 0.0, low, high, 0
    )


def _renamed(leaf: xr.Dataset, own: Mapping[str, str]) -> xr.Dataset:
    renamed = leaf.rename({name: new for name, new in own.items() if name in leaf.dims})
    return renamed.assign_attrs(
        regressors=" ".join(own.get(word, word) for word in list_regressors(leaf))
    )
