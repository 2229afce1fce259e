"""Catalogue rows and tables of the fuel: one state for all of it, or one for each tank."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from flightmech.aircraft.fuel import Fuel, check_feeds
from flightmech.errors import SchemaError
from flightmech.names import lookup
from flightmech.simulation.catalogue_row import make_row, make_vocabulary_row
from flightmech.simulation.kernel import (
    FIXED,
    INPUT,
    INTEGER,
    PARAMETER,
    CatalogueEntry,
)

if TYPE_CHECKING:
    import xarray as xr

    from flightmech.aircraft.aircraft import Aircraft

# Values of the parameter of a feed.
_ALWAYS, _CROSSED = 1.0, 2.0


def items(aircraft: Aircraft) -> dict[str, tuple[str, ...]]:
    """Return the items of the groups: all fuel, or the names of tanks and feeds.

    Raises
    ------
    SchemaError
        Feeds of the engines that do not go with the tanks.
    """
    problems = check_feeds(aircraft.engines, aircraft.fuel)
    if problems:
        raise SchemaError(aircraft.name, problems)
    if aircraft.fuel is None:
        return {"fuel": ()}
    if not aircraft.fuel.tanks:
        return {"fuel": ("",)}
    feeds: list[str] = []
    for number, engine in enumerate(aircraft.engines, 1):
        feeds += [f"{number}.{tank}" for tank in (*engine.feed, *engine.crossfeed)]
    tanks = tuple(tank.name for tank in aircraft.fuel.tanks)
    transfers = tuple(transfer.item for transfer in aircraft.fuel.transfers)
    names = {"tanks": ("",), "tank": tanks, "feed": tuple(feeds), "transfer": transfers}
    return {"fuel": (), **names}


def row(kind: int, group: str, item: str, name: str, aircraft: Aircraft) -> CatalogueEntry:
    """Return the catalogue row of a name of the fuel."""
    fuel, word = aircraft.fuel, name.rsplit(".", 1)[-1]
    assert fuel is not None, "names of fuel and tanks are requested only where there is fuel"
    if group == "tank":
        return _tank_row(kind, item, name, fuel=fuel)
    if group == "feed":
        return _feed_row(item, name, aircraft)
    if group == "transfer":
        return _transfer_row(kind, item, name, fuel=fuel)
    if kind == INPUT:
        return make_vocabulary_row(name, word, low=0.0, high=1.0)
    if kind == PARAMETER and name == "init.fuel":
        text = "fuel on board at the start, part of mass.mass"
        return make_row(name, "kg", text, display_units="lb", value=fuel.mass, low=0.0, flags=FIXED)
    if kind == PARAMETER:
        text = f"place of the fuel as a mass point from the moment reference point, body {word}"
        return make_row(name, "m", text, value=fuel.position["xyz".index(word)])
    # mass, centre of gravity and inertia of the aircraft change with the fuel
    text = lookup(word).long_name
    if word != "fuel":
        text += " of the moment"
    return make_vocabulary_row(name, word, text)


def _tank_row(kind: int, item: str, name: str, fuel: Fuel) -> CatalogueEntry:
    """Return the row of a name of one tank."""
    word = name.rsplit(".", 1)[-1]
    tank = next(tank for tank in fuel.tanks if tank.name == item)
    if kind == INPUT:
        text = f"pump or valve of tank {item}, 0 the tank delivers, 1 cut off"
        return make_vocabulary_row(name, word, text, low=0.0, high=1.0)
    if kind != PARAMETER:
        return make_vocabulary_row(name, word, f"fuel in tank {item}")
    masses = {
        "init.": (f"fuel in tank {item} at the start", tank.content, FIXED),
        "mass.": (f"fuel in tank {item} that is part of mass.mass", tank.content, 0),
        "tank.": (f"fuel that tank {item} holds", tank.capacity, 0),
    }
    if word in ("fuel", "capacity"):
        text, value, flags = masses[name[: len("init.")]]
        return make_row(name, "kg", text, display_units="lb", value=value, low=0.0, flags=flags)
    if word == "order":
        text = f"engines draw from tanks of the lowest number first, tank {item}"
        return make_row(name, "1", text, value=float(tank.order))
    text = f"place of tank {item} as a mass point from the moment reference point, body {word}"
    return make_row(name, "m", text, value=tank.position["xyz".index(word)])


def _feed_row(item: str, name: str, aircraft: Aircraft) -> CatalogueEntry:
    """Return the row of a feed, such as ``1.left`` to engine 1."""
    number, tank = item.split(".")
    text = f"engine{number} draws from tank {tank}: 0 never, 1 always, 2 with the cross-feed open"
    value = _ALWAYS if tank in aircraft.engines[int(number) - 1].feed else _CROSSED
    return make_row(name, "1", text, value=value, low=0.0, high=2.0, flags=INTEGER)


def _transfer_row(kind: int, item: str, name: str, fuel: Fuel) -> CatalogueEntry:
    """Return the row of a pump, such as ``tip.left`` from tank tip to tank left."""
    word = name.rsplit(".", 1)[-1]
    transfer = next(transfer for transfer in fuel.transfers if transfer.item == item)
    ends = f"from tank {transfer.source} to tank {transfer.target}"
    if kind == INPUT:
        value = 1.0 if transfer.on else 0.0
        text = f"pump {ends}, 0 off, 1 on"
        return make_vocabulary_row(name, word, text, value=value, low=0.0, high=1.0)
    if kind != PARAMETER:
        return make_row(name, "kg s-1", f"flow of the pump {ends}", display_units="lb/h")
    value = getattr(transfer, word)
    if word == "rate":
        text = f"flow of the pump {ends} while no limit reduces it"
        return make_row(name, "kg s-1", text, display_units="lb/h", value=value, low=0.0)
    texts = {
        "leave": f"fuel of tank {transfer.source} that the pump does not reach",
        "fill": f"content of tank {transfer.target} at which the float valve is shut",
        "band": f"fuel over which the pump {ends} runs dry or its float valve shuts",
    }
    return make_row(name, "kg", texts[word], display_units="lb", value=value, low=0.0)


def terms(aircraft: Aircraft) -> Iterator[tuple[str, str, xr.Dataset]]:
    """Return the tables."""
    if aircraft.fuel is None:
        return
    for name, leaf in aircraft.fuel.tables.items():
        yield f"fuel.{name}", f"fuel/{name}", leaf
