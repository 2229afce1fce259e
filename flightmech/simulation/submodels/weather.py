"""Catalogue rows of the weather: wind over height, turbulence, discrete gust.

Weather is not a property of an aircraft. The aircraft file has no table for it, and a run sets its
parameters.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from flightmech.simulation.catalogue_row import MOST, make_row
from flightmech.simulation.kernel import INTEGER, OUTPUT, CatalogueEntry

if TYPE_CHECKING:
    import xarray as xr

    from flightmech.aircraft.aircraft import Aircraft

_ROWS = 8
_BY_MODEL = "; negative: by height, turbulence.W20 and turbulence.severity"

# Units, display units, description.
_OUTPUTS = {
    **{
        f"air.wind_{axis}": (
            "m s-1",
            "m s-1",
            f"velocity of the air at the aircraft {way}, profile and gusts included",
        )
        for axis, way in (("n", "towards north"), ("e", "towards east"), ("d", "downward"))
    },
    **{
        f"air.gust_{axis}": (
            "m s-1",
            "m s-1",
            f"velocity of the air from turbulence and gust along body {body}",
        )
        for axis, body in zip("uvw", "xyz", strict=True)
    },
    **{
        f"air.gust_{axis}": (
            "rad s-1",
            "deg/s",
            f"rotation of the air from turbulence about body {body}",
        )
        for axis, body in zip("pqr", "xyz", strict=True)
    },
}

# Units, display units, description, start value, low, high, flags.
_PARAMETERS = {
    **{
        f"wind.shear_{axis}": (
            "s-1",
            "s-1",
            f"change of the wind {way} per metre of height",
            0.0,
            -MOST,
            MOST,
            0,
        )
        for axis, way in (("n", "towards north"), ("e", "towards east"), ("d", "downward"))
    },
    "wind.shear_h": (
        "m",
        "ft",
        "height over sea level at which the linear shear is zero",
        0.0,
        -MOST,
        MOST,
        0,
    ),
    "wind.W20": (
        "m s-1",
        "kt",
        "wind 20 ft over the runway, of the logarithmic profile of MIL-F-8785C",
        0.0,
        0.0,
        MOST,
        0,
    ),
    "wind.from": (
        "rad",
        "deg",
        "direction from which wind.W20 blows, clockwise from north",
        0.0,
        -MOST,
        MOST,
        0,
    ),
    "wind.roughness": (
        "m",
        "ft",
        "z0 of the logarithmic profile: 0.15 ft in terminal flight phases, else 2 ft",
        0.04572,
        0.0,
        0.9144,
        0,
    ),
    "wind.rows": (
        "1",
        "1",
        "rows of the table of winds in use, added to the other winds",
        0.0,
        0.0,
        float(_ROWS),
        INTEGER,
    ),
    **{
        f"wind.{column}{row}": (
            units,
            display,
            f"table of winds, row {row}: {text}",
            0.0,
            -MOST,
            MOST,
            0,
        )
        for row in range(1, _ROWS + 1)
        for column, units, display, text in (
            ("h", "m", "ft", "height over sea level, rising"),
            ("n", "m s-1", "m s-1", "wind towards north"),
            ("e", "m s-1", "m s-1", "wind towards east"),
            ("d", "m s-1", "m s-1", "wind downward"),
        )
    },
    "turbulence.mode": (
        "1",
        "1",
        "0 none, 1 Dryden spectra of MIL-F-8785C",
        0.0,
        0.0,
        1.0,
        INTEGER,
    ),
    "turbulence.seed": (
        "1",
        "1",
        "whole number that the gust history belongs to",
        0.0,
        0.0,
        float(2**53),
        INTEGER,
    ),
    "turbulence.step": (
        "s",
        "s",
        "distance of the points of the gust history; linear between",
        0.02,
        1e-3,
        1.0,
        0,
    ),
    "turbulence.W20": (
        "m s-1",
        "kt",
        "wind 20 ft over the runway that gives the intensity below 2000 ft",
        0.0,
        0.0,
        MOST,
        0,
    ),
    "turbulence.severity": (
        "1",
        "1",
        "intensity above 1000 ft: 0 none, 1 ... 7 MIL-F-8785C figure 7 (3 light, 4 moderate, "
        "6 severe)",
    )
    + (0.0, 0.0, 7.0, INTEGER),
    "turbulence.V": (
        "m s-1",
        "kt",
        "airspeed of the gust history; negative: that of the aircraft",
        -1.0,
        -MOST,
        MOST,
        0,
    ),
    **{
        f"turbulence.sigma_{axis}": (
            "m s-1",
            "m s-1",
            f"standard deviation of the {way} gust{_BY_MODEL}",
            -1.0,
            -MOST,
            MOST,
            0,
        )
        for axis, way in (("u", "longitudinal"), ("v", "lateral"), ("w", "vertical"))
    },
    **{
        f"turbulence.L_{axis}": (
            "m",
            "ft",
            f"scale length of the {way} gust, MIL-F-8785C; negative: by height",
            -1.0,
            -MOST,
            MOST,
            0,
        )
        for axis, way in (("u", "longitudinal"), ("v", "lateral"), ("w", "vertical"))
    },
    **{
        f"gust.peak_{axis}": (
            "m s-1",
            "m s-1",
            f"peak of the discrete gust along body {body}",
            0.0,
            -MOST,
            MOST,
            0,
        )
        for axis, body in zip("uvw", "xyz", strict=True)
    },
    "gust.start": ("s", "s", "time at which the discrete gust begins", 0.0, -MOST, MOST, 0),
    "gust.rise": (
        "s",
        "s",
        "time from its begin to its peak: gradient distance over airspeed",
        1.0,
        0.0,
        MOST,
        0,
    ),
    "gust.hold": (
        "1",
        "1",
        "0 it falls as it rose (14 CFR 25.341), 1 it stays (MIL-F-8785C)",
        0.0,
        0.0,
        1.0,
        INTEGER,
    ),
}


def items(aircraft: Aircraft) -> dict[str, tuple[str, ...]]:
    """Return the items of the groups: the weather is always there."""
    return {"weather": ("",)}


def row(kind: int, group: str, item: str, name: str, aircraft: Aircraft) -> CatalogueEntry:
    """Return the catalogue row of an output or parameter of the weather."""
    if kind == OUTPUT:
        units, display_units, text = _OUTPUTS[name]
        return make_row(name, units, text, display_units=display_units)
    return CatalogueEntry(name, *_PARAMETERS[name])


def terms(aircraft: Aircraft) -> Iterator[tuple[str, str, xr.Dataset]]:
    """Return the tables: there are none."""
    return iter(())
