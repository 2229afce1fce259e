"""The submodels other than the aerodynamics, one module each.

A module defines its groups of names for an aircraft.  ``items(aircraft)`` returns the items of its
groups.  ``row(kind, group, item, name, aircraft)`` returns the catalogue row of a name.
``terms(aircraft)`` returns its tables as (target, name of the term, leaf).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from flightmech.simulation.submodels import (
    controls,
    devices,
    earth_axes,
    engine,
    envelope,
    fuel,
    landing_gear,
    propellers,
    separation,
    weather,
)

if TYPE_CHECKING:
    import xarray as xr

    from flightmech.aircraft.aircraft import Aircraft
    from flightmech.simulation.kernel import CatalogueEntry

MODULES = (
    weather,
    engine,
    propellers,
    fuel,
    landing_gear,
    controls,
    devices,
    earth_axes,
    separation,
    envelope,
)
# Module of each group of names.
_MODULE_OF_GROUP = {
    "weather": weather,
    "engine": engine,
    "spool": engine,
    "propeller": propellers,
    "piston": propellers,
    "motor": propellers,
    "fuel": fuel,
    "gear": landing_gear,
    "contact": landing_gear,
    "circuit": controls,
    "device": devices,
    "earth": earth_axes,
    "separation": separation,
    "envelope": envelope,
    "tanks": fuel,
    "tank": fuel,
    "feed": fuel,
    "transfer": fuel,
}


def submodel_items(aircraft: Aircraft) -> dict[str, tuple[str, ...]]:
    """Return the names of the items of every group.

    The core and groups with a single item have an empty name.
    """
    names: dict[str, tuple[str, ...]] = {"": ("",)}
    for module in MODULES:
        names |= module.items(aircraft)
    return names


def submodel_row(kind: int, group: str, item: str, name: str, aircraft: Aircraft) -> CatalogueEntry:
    """Return the catalogue row of a name of a group."""
    return _MODULE_OF_GROUP[group].row(kind, group, item, name=name, aircraft=aircraft)


def submodel_terms(aircraft: Aircraft) -> Iterator[tuple[str, str, xr.Dataset]]:
    """Return the tables of all submodels: target, name of the term, leaf."""
    for module in MODULES:
        yield from module.terms(aircraft)
