"""Catalogue rows of the outputs of the validity envelope, which a model has if it was compiled with
one.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from flightmech.envelope.regions import AXES, EXTRAPOLATED, OTHER_AXIS, REGIONS, axis_name
from flightmech.simulation.catalogue_row import make_row
from flightmech.simulation.kernel import CatalogueEntry

if TYPE_CHECKING:
    import xarray as xr

    from flightmech.aircraft.aircraft import Aircraft

GROUP = "envelope"


def items(aircraft: Aircraft) -> dict[str, tuple[str, ...]]:
    """Return no items: the database decides on the group, not the aircraft."""
    return {GROUP: ()}


def row(kind: int, group: str, item: str, name: str, aircraft: Aircraft) -> CatalogueEntry:
    """Return the catalogue row of ``envelope.region`` or ``envelope.axis``."""
    if name == "envelope.region":
        listed = ", ".join(f"{code} {word}" for code, word in enumerate(REGIONS))
        text = f"how far flights support the model at this state: {listed}"
        return make_row(name, "1", text, low=0.0, high=float(EXTRAPOLATED))
    listed = ", ".join(f"{code} {axis_name(code)}" for code in range(1, len(AXES) + 2))
    text = f"axis along which a better region is nearest: 0 none, {listed}"
    return make_row(name, "1", text, low=0.0, high=float(OTHER_AXIS))


def terms(aircraft: Aircraft) -> Iterator[tuple[str, str, xr.Dataset]]:
    """Return no tables."""
    return iter(())
