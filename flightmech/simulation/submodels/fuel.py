"""Catalogue rows and tables of the fuel."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from flightmech.names import lookup
from flightmech.simulation.catalogue_row import make_row, make_vocabulary_row
from flightmech.simulation.kernel import FIXED, PARAMETER, CatalogueEntry

if TYPE_CHECKING:
    import xarray as xr

    from flightmech.aircraft.aircraft import Aircraft


def items(aircraft: Aircraft) -> dict[str, tuple[str, ...]]:
    """Return the items of the groups."""
    return {"fuel": () if aircraft.fuel is None else ("",)}


def row(kind: int, group: str, item: str, name: str, aircraft: Aircraft) -> CatalogueEntry:
    """Return the catalogue row of a name of the fuel."""
    fuel, word = aircraft.fuel, name.rsplit(".", 1)[-1]
    assert fuel is not None, "names of the group fuel are requested only where there is fuel"
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


def terms(aircraft: Aircraft) -> Iterator[tuple[str, str, xr.Dataset]]:
    """Return the tables."""
    if aircraft.fuel is None:
        return
    for name, leaf in aircraft.fuel.tables.items():
        yield f"fuel.{name}", f"fuel/{name}", leaf
