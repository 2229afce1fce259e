"""Catalogue rows of the weather: wind over height, turbulence, discrete gust.

Weather is not a property of an aircraft.  The aircraft file has no table for it, and a run sets its
parameters.

References
----------
MIL-F-8785C: logarithmic wind profile, Dryden turbulence and discrete gust.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from flightmech.simulation.catalogue_row import MOST, make_row
from flightmech.simulation.kernel import INTEGER, CatalogueEntry

if TYPE_CHECKING:
    import xarray as xr

    from flightmech.aircraft.aircraft import Aircraft

_TABLE_SIZE = 8  # rows of the table of winds
_LARGEST_SEED = float(2**53)  # beyond it a double does not hold every integer
# Components of the wind, north-east-down, and of a gust, along body x, y, z.
_WIND_DIRECTIONS = {"n": "towards north", "e": "towards east", "d": "downward"}
_GUST_DIRECTIONS = {"u": "longitudinal", "v": "lateral", "w": "vertical"}
_GUST_AXES = {"u": "x", "v": "y", "w": "z"}
_ROTATION_AXES = {"p": "x", "q": "y", "r": "z"}


def _output_rows() -> list[CatalogueEntry]:
    rows = []
    for name, direction in _WIND_DIRECTIONS.items():
        text = f"velocity of the air at the aircraft {direction}, profile and gusts included"
        rows.append(make_row(f"air.wind_{name}", "m s-1", text))
    for name, axis in _GUST_AXES.items():
        text = f"velocity of the air from turbulence and gust along body {axis}"
        rows.append(make_row(f"air.gust_{name}", "m s-1", text))
    for name, axis in _ROTATION_AXES.items():
        text = f"rotation of the air from turbulence about body {axis}"
        rows.append(make_row(f"air.gust_{name}", "rad s-1", text, display_units="deg/s"))
    return rows


def _wind_rows() -> list[CatalogueEntry]:
    """Return the rows of linear shear, logarithmic profile and table of winds."""
    rows = []
    for name, direction in _WIND_DIRECTIONS.items():
        text = f"change of the wind {direction} per metre of height"
        rows.append(make_row(f"wind.shear_{name}", "s-1", text))
    rows += [
        make_row(
            "wind.shear_h",
            "m",
            "height over sea level at which the linear shear is zero",
            display_units="ft",
        ),
        make_row(
            "wind.W20",
            "m s-1",
            "wind 20 ft over the runway, of the logarithmic profile of MIL-F-8785C",
            display_units="kt",
            low=0.0,
        ),
        make_row(
            "wind.from",
            "rad",
            "direction from which wind.W20 blows, clockwise from north",
            display_units="deg",
        ),
        make_row(
            "wind.roughness",
            "m",
            "z0 of the logarithmic profile: 0.15 ft in terminal flight phases, else 2 ft",
            display_units="ft",
            value=0.04572,
            low=0.0,
            high=0.9144,
        ),
        make_row(
            "wind.rows",
            "1",
            "rows of the table of winds in use, added to the other winds",
            low=0.0,
            high=float(_TABLE_SIZE),
            flags=INTEGER,
        ),
    ]
    for number in range(1, _TABLE_SIZE + 1):
        title = f"table of winds, row {number}"
        height = f"{title}: height over sea level, rising"
        rows.append(make_row(f"wind.h{number}", "m", height, display_units="ft"))
        for name, direction in _WIND_DIRECTIONS.items():
            text = f"{title}: wind {direction}"
            rows.append(make_row(f"wind.{name}{number}", "m s-1", text))
    return rows


def _turbulence_rows() -> list[CatalogueEntry]:
    rows = [
        make_row(
            "turbulence.mode",
            "1",
            "0 none, 1 Dryden spectra of MIL-F-8785C",
            low=0.0,
            high=1.0,
            flags=INTEGER,
        ),
        make_row(
            "turbulence.seed",
            "1",
            "whole number that the gust history belongs to",
            low=0.0,
            high=_LARGEST_SEED,
            flags=INTEGER,
        ),
        make_row(
            "turbulence.step",
            "s",
            "distance of the points of the gust history; linear between",
            value=0.02,
            low=1e-3,
            high=1.0,
        ),
        make_row(
            "turbulence.W20",
            "m s-1",
            "wind 20 ft over the runway that gives the intensity below 2000 ft",
            display_units="kt",
            low=0.0,
        ),
        make_row(
            "turbulence.severity",
            "1",
            "intensity above 1000 ft: 0 none, 1 ... 7 MIL-F-8785C figure 7 (3 light, 4 moderate, "
            "6 severe)",
            low=0.0,
            high=7.0,
            flags=INTEGER,
        ),
        make_row(
            "turbulence.V",
            "m s-1",
            "airspeed of the gust history; negative: that of the aircraft",
            display_units="kt",
            value=-1.0,
        ),
    ]
    # a negative value selects the model of MIL-F-8785C over height
    for name, direction in _GUST_DIRECTIONS.items():
        deviation = (
            f"standard deviation of the {direction} gust; negative: by height, turbulence.W20 and "
            f"turbulence.severity"
        )
        rows.append(make_row(f"turbulence.sigma_{name}", "m s-1", deviation, value=-1.0))
        length = f"scale length of the {direction} gust, MIL-F-8785C; negative: by height"
        rows.append(make_row(f"turbulence.L_{name}", "m", length, display_units="ft", value=-1.0))
    return rows


def _gust_rows() -> list[CatalogueEntry]:
    rows = []
    for name, axis in _GUST_AXES.items():
        text = f"peak of the discrete gust along body {axis}"
        rows.append(make_row(f"gust.peak_{name}", "m s-1", text))
    rows += [
        make_row("gust.start", "s", "time at which the discrete gust begins"),
        make_row(
            "gust.rise",
            "s",
            "time from its begin to its peak: gradient distance over airspeed",
            value=1.0,
            low=0.0,
            high=MOST,
        ),
        make_row(
            "gust.hold",
            "1",
            "0 it falls as it rose (14 CFR 25.341), 1 it stays (MIL-F-8785C)",
            low=0.0,
            high=1.0,
            flags=INTEGER,
        ),
    ]
    return rows


# The kernel defines the order of the names, so that the order of these rows does not matter.
_ROWS = {
    row.name: row for row in (*_output_rows(), *_wind_rows(), *_turbulence_rows(), *_gust_rows())
}


def items(aircraft: Aircraft) -> dict[str, tuple[str, ...]]:
    """Return the items of the groups: every model has weather."""
    return {"weather": ("",)}


def row(kind: int, group: str, item: str, name: str, aircraft: Aircraft) -> CatalogueEntry:
    """Return the catalogue row of an output or parameter of the weather."""
    return _ROWS[name]


def terms(aircraft: Aircraft) -> Iterator[tuple[str, str, xr.Dataset]]:
    """Return no tables."""
    return iter(())
