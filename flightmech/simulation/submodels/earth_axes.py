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
_OUTPUTS = {
    **{f"earth.{axis}": ("m", f"position of the c.g. along {axis} of {_FIXED}") for axis in "xyz"},
    **{
        f"earth.v{axis}": (
            "m s-1",
            f"velocity over the turning Earth along {axis} of the Earth-fixed axes",
        )
        for axis in "xyz"
    },
    **{
        f"inertial.{axis}": ("m", f"position of the c.g. along {axis} of {_INERTIAL}")
        for axis in "xyz"
    },
    **{
        f"inertial.v{axis}": (
            "m s-1",
            f"velocity along {axis} of the inertial axes, turn of the Earth included",
        )
        for axis in "xyz"
    },
    "gravitation": ("m s-2", "size of the mass attraction, without the centrifugal part"),
}


def items(aircraft: Aircraft) -> dict[str, tuple[str, ...]]:
    """Return the items of the group: one where the aircraft has these outputs."""
    return {"earth": ("",) if aircraft.earth_outputs else ()}


def row(kind: int, group: str, item: str, name: str, aircraft: Aircraft) -> CatalogueEntry:
    """Return the catalogue row of an output."""
    units, text = _OUTPUTS[name]
    return make_row(name, units, text)


def terms(aircraft: Aircraft) -> Iterator[tuple[str, str, xr.Dataset]]:
    """Return no tables."""
    return iter(())
