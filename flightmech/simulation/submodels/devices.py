"""Catalogue rows of further controls: those that the tables of a database use and the core does not
name.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from flightmech.aircraft.controls import DEVICE
from flightmech.aircraft.fuel import MOST
from flightmech.names import lookup
from flightmech.simulation.kernel import CatalogueEntry

if TYPE_CHECKING:
    import xarray as xr

    from flightmech.aircraft.aircraft import Aircraft


def with_devices(aircraft: Aircraft, variables: Iterable[str]) -> Aircraft:
    """Return the aircraft with a travel for every device among model variables; without one in its
    file a device has no limits.
    """
    found = sorted(
        name for name in set(variables) - set(aircraft.limits) if name.startswith(DEVICE)
    )
    return (
        replace(aircraft, limits={**aircraft.limits, **dict.fromkeys(found, (-MOST, MOST))})
        if found
        else aircraft
    )


def items(aircraft: Aircraft) -> dict[str, tuple[str, ...]]:
    """Return the devices of the aircraft: those whose travel it has."""
    return {
        "device": tuple(
            name.removeprefix(DEVICE) for name in sorted(aircraft.limits) if name.startswith(DEVICE)
        )
    }


def row(kind: int, group: str, item: str, name: str, aircraft: Aircraft) -> CatalogueEntry:
    """Return the catalogue row of a device, as input and as model variable."""
    like, (low, high) = lookup(name), aircraft.limits[name]
    text = (
        f"{like.long_name.partition(' of ')[0]} of {item.partition('.')[0]}, positive {like.sign}"
    )
    return CatalogueEntry(name, like.units, like.display_units, text, 0.0, low, high, 0)


def terms(aircraft: Aircraft) -> Iterator[tuple[str, str, xr.Dataset]]:
    """Return no tables."""
    return iter(())
