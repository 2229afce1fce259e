"""Catalogue rows of the optional position and motion in Earth-fixed and inertial axes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from flightmech.simulation.catalogue_row import make_row
from flightmech.simulation.kernel import CatalogueEntry

if TYPE_CHECKING:
    import xarray as xr

    from flightmech.aircraft.aircraft import Aircraft

_FIXED = "Earth-fixed axes: z towards the North Pole, x towards the equator at longitude zero"
_INERTIAL = "inertial axes, which are the Earth-fixed ones at the time zero"


def items(aircraft: Aircraft) -> dict[str, tuple[str, ...]]:
    """Return the items of the group: one if the aircraft has these outputs."""
    return {"earth": ("",) if aircraft.earth_outputs else ()}


def row(kind: int, group: str, item: str, name: str, aircraft: Aircraft) -> CatalogueEntry:
    """Return the catalogue row of an output, such as ``earth.x`` or ``inertial.vz``."""
    if name == "gravitation":
        text = "size of the mass attraction, without the centrifugal part"
        return make_row(name, "m s-2", text)
    frame, _, quantity = name.partition(".")
    axis = quantity[-1]
    if quantity == axis:
        axes = _FIXED if frame == "earth" else _INERTIAL
        return make_row(name, "m", f"position of the c.g. along {axis} of {axes}")
    # the two velocities differ by the rotation of the Earth
    if frame == "earth":
        text = f"velocity over the turning Earth along {axis} of the Earth-fixed axes"
    else:
        text = f"velocity along {axis} of the inertial axes, turn of the Earth included"
    return make_row(name, "m s-1", text)


def terms(aircraft: Aircraft) -> Iterator[tuple[str, str, xr.Dataset]]:
    """Return no tables."""
    return iter(())
