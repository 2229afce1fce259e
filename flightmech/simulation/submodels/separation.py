"""Catalogue rows and tables of the flow separation on both wing halves."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from flightmech.aircraft.separation import TARGETS
from flightmech.simulation.catalogue_row import make_row, make_vocabulary_row
from flightmech.simulation.kernel import PARAMETER, CatalogueEntry

if TYPE_CHECKING:
    import xarray as xr

    from flightmech.aircraft.aircraft import Aircraft

_BUFFET = {
    "buffet_rms": ("rms of the vertical acceleration by buffet, not in the forces", "m s-2"),
    "buffet_frequency": ("natural frequency of the spectrum of the buffet", "rad/s"),
    "buffet_damping": ("damping ratio of the spectrum of the buffet", "1"),
}


def items(aircraft: Aircraft) -> dict[str, tuple[str, ...]]:
    """Return the items of the group: one if the aircraft has a separation."""
    return {"separation": () if aircraft.stall is None else ("",)}


def row(kind: int, group: str, item: str, name: str, aircraft: Aircraft) -> CatalogueEntry:
    """Return the catalogue row of a name of the separation."""
    assert aircraft.stall is not None, "names of the group are requested only with a separation"
    word = name.rsplit(".", 1)[-1]
    if kind == PARAMETER:
        text = "distance of the stations of both wing halves from the plane of symmetry"
        return make_row(name, "m", text, value=aircraft.stall.station, low=0.0)
    if word in _BUFFET:
        text, display_units = _BUFFET[word]
        return make_row(name, TARGETS[word], text, display_units=display_units)
    return make_vocabulary_row(name, word)


def terms(aircraft: Aircraft) -> Iterator[tuple[str, str, xr.Dataset]]:
    """Return the tables."""
    if aircraft.stall is None:
        return
    for name, leaf in aircraft.stall.tables.items():
        yield f"stall.{name}", f"stall/{name}", leaf
