"""Catalogue rows of further controls, which the tables of a database use and the core does not."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from flightmech.aircraft.controls import DEVICE
from flightmech.names import lookup
from flightmech.simulation.catalogue_row import MOST, make_vocabulary_row
from flightmech.simulation.kernel import CatalogueEntry

if TYPE_CHECKING:
    import xarray as xr

    from flightmech.aircraft.aircraft import Aircraft


def with_devices(aircraft: Aircraft, variables: Iterable[str]) -> Aircraft:
    """Return the aircraft with a travel for every device among model variables.

    A device without limits in the aircraft file has no limits.
    """
    missing = [name for name in set(variables) - set(aircraft.limits) if name.startswith(DEVICE)]
    if not missing:
        return aircraft
    limits = {**aircraft.limits, **dict.fromkeys(sorted(missing), (-MOST, MOST))}
    return replace(aircraft, limits=limits)


def items(aircraft: Aircraft) -> dict[str, tuple[str, ...]]:
    """Return the devices of the aircraft: those whose travel it has."""
    devices = [name for name in sorted(aircraft.limits) if name.startswith(DEVICE)]
    return {"device": tuple(name.removeprefix(DEVICE) for name in devices)}


def row(kind: int, group: str, item: str, name: str, aircraft: Aircraft) -> CatalogueEntry:
    """Return the catalogue row of a device, as input and as model variable."""
    entry, (low, high) = lookup(name), aircraft.limits[name]
    # long_name is "deflection of ..."; the item replaces the general name of the device
    quantity, device = entry.long_name.partition(" of ")[0], item.partition(".")[0]
    text = f"{quantity} of {device}, positive {entry.sign}"
    return make_vocabulary_row(name, name, text, low=low, high=high)


def terms(aircraft: Aircraft) -> Iterator[tuple[str, str, xr.Dataset]]:
    """Return no tables."""
    return iter(())
