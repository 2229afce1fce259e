"""Catalogue rows and tables of the fuel."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from flightmech.aircraft.fuel import MOST
from flightmech.names import lookup
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
        return CatalogueEntry(
            name,
            "kg",
            "lb",
            "fuel on board at the start, part of mass.mass",
            fuel.mass,
            0.0,
            MOST,
            FIXED,
        )
    if kind == PARAMETER:
        text = f"place of the fuel as a mass point from the moment reference point, body {word}"
        return CatalogueEntry(
            name, "m", "m", text, fuel.position["xyz".index(word)], -MOST, MOST, 0
        )
    found = lookup(word)
    return CatalogueEntry(
        name,
        found.units,
        found.display_units,
        f"{found.long_name}{' of the moment' if word != 'fuel' else ''}",
        0.0,
        -MOST,
        MOST,
        0,
    )


def terms(aircraft: Aircraft) -> Iterator[tuple[str, str, xr.Dataset]]:
    """Return the tables."""
    for name, leaf in ({} if aircraft.fuel is None else aircraft.fuel.tables).items():
        yield f"fuel.{name}", f"fuel/{name}", leaf
