"""Flow separation on both wing halves, and the section ``[stall]`` of the aircraft file.

A separation point X per wing half is 1 for attached flow and 0 for flow that is separated up to the
leading edge. It follows the local angle of attack with the lag of Goman and Khrabrov,

    tau1 (cbar / V) dX/dt + X = (1 - tanh(a1 (alpha - tau2 (cbar / V) dalpha/dt - alpha_star))) / 2

(J. Aircraft 31(5), 1994, 1109-1115). The terms of the database use X (`names.SEPARATION`)::

    [stall]
    station = "2.4 m"
    a1 = 22.0
    alpha_star = { delta_f = ["0 deg", "40 deg"], value = ["17 deg", "15 deg"] }
    tau1 = 6.0
    tau2 = 8.0
    asymmetry = "0.4 deg"
    buffet_rms = { X = [0.4, 0.9, 1.0], value = [2.0, 0.3, 0.0] }

or ``file``, a netCDF file with a leaf for each of these names.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import ConfigDict, Field, create_model

from flightmech.aircraft.engine_deck import leaf_from_toml, open_tables
from flightmech.errors import SchemaError, UnitError
from flightmech.names import SEPARATION
from flightmech.short_text import ShortText
from flightmech.support.toml_models import Strict
from flightmech.support.toml_quantities import InUnits
from flightmech.terms import list_model_variables

if TYPE_CHECKING:
    import xarray as xr

TARGETS = {
    "a1": "1",
    "alpha_star": "rad",
    "asymmetry": "rad",
    "tau1": "1",
    "tau2": "1",
    "buffet_rms": "m s-2",
    "buffet_frequency": "rad s-1",
    "buffet_damping": "1",
}
"""Tables of the separation, with the SI unit of their values."""
NEEDED = ("a1", "alpha_star", "tau1", "tau2")
_BUFFET = tuple(name for name in TARGETS if name.startswith("buffet"))
# Axes of the parameters: what is known before the separation, and does not move with it.
_AXES = ("delta_f", "gear", "speedbrake", "mach", "h", "h_agl", "V", "qbar", "CT", "x_cg")
_PREFIXES = ("engine", "device.")
_DESCRIPTIONS = {
    "a1": "Steepness of the steady separation over alpha, per radian.",
    "alpha_star": "Angle of attack at which the steady separation point is at half chord.",
    "asymmetry": "alpha_star of the right wing half less that of the left one.",
    "tau1": "Lag of the separation, in times that the air needs for a mean chord.",
    "tau2": "Delay of the separation with the rate of alpha, in such times.",
    "buffet_rms": "Root mean square of the vertical acceleration by buffet; an output, no force.",
    "buffet_frequency": "Natural frequency of the spectrum of the buffet.",
    "buffet_damping": "Damping ratio of the spectrum of the buffet.",
}


@dataclass(frozen=True)
class FlowSeparation(ShortText):
    """Flow separation of both wing halves.

    Parameters
    ----------
    station : float
        Distance of the stations of the wing halves from the plane of symmetry, at which the local
        angle of attack is taken. [m]
    tables : mapping of str to Dataset
        Term leaves by the names of `TARGETS`. ``a1``, ``alpha_star``, ``tau1`` and ``tau2`` are
        needed. Their axes are configuration, Mach number, height, speed, thrust coefficient or
        quantities of an engine. The tables of the buffet may also have X and alpha as axes. The
        spectrum of the buffet is that of white noise behind a second-order filter with
        ``buffet_frequency`` and ``buffet_damping``, scaled to ``buffet_rms``.

    Raises
    ------
    SchemaError
        A table is missing, unknown, over an axis that is not allowed, or has nodes without a
        meaning: ``a1`` and ``tau1`` are positive, ``tau2`` and the buffet are not negative.
    """

    station: float
    tables: Mapping[str, xr.Dataset]

    def __post_init__(self) -> None:
        problems = [f"{name} is missing; give it" for name in NEEDED if name not in self.tables]
        if not (np.isfinite(self.station) and self.station >= 0.0):
            problems.append(f"station is {self.station:g} m; give zero or a positive length")
        for name, leaf in self.tables.items():
            problems += [f"{name}: {text}" for text in _check_table(name, leaf)]
        if problems:
            raise SchemaError("stall", problems)


def _check_table(name: str, leaf: xr.Dataset) -> Iterator[str]:
    """Yield the problems of a table of the separation."""
    if name not in TARGETS:
        yield f"unknown table; allowed: {', '.join(TARGETS)}"
        return
    values = leaf["value"].values
    if name in ("a1", "tau1") and not (values > 0.0).all():
        yield f"has the node {values.min():g}; give positive numbers"
    elif name not in ("alpha_star", "asymmetry") and not (values >= 0.0).all():
        yield f"has the node {values.min():g}; give zero or positive numbers"
    if leaf.attrs.get("regressors") or leaf.attrs.get("power"):
        yield "has a regressor or a power; give a table"
    if leaf.attrs.get("outside", "hold") != "hold":
        yield "continues linearly beyond its ends, where it may change sign; use outside = hold"
    allowed = (*_AXES, *SEPARATION, "alpha") if name in _BUFFET else _AXES
    for axis in sorted(list_model_variables(leaf)):
        if axis not in allowed and not axis.startswith(_PREFIXES):
            yield f"axis {axis}; allowed: {', '.join(allowed)}, engine1.throttle, device.NAME"


_Station = Annotated[float, InUnits("m")]


class _StallKeys(Strict):
    model_config = ConfigDict(protected_namespaces=())

    station: _Station = Field(
        examples=["2.4 m"],
        description="Distance of the stations of both wing halves from the plane of symmetry.",
    )
    file: str | None = Field(
        default=None,
        examples=["stall.nc"],
        description="netCDF file with the tables in place of the keys, relative to this file.",
    )


def _table_keys() -> dict[str, Any]:
    """Return the fields of the tables, for pydantic."""
    keys: dict[str, Any] = {}
    for name, text in _DESCRIPTIONS.items():
        description = f"{text} A number, or a table with axes and value [{TARGETS[name]}]."
        keys[name] = (float | str | dict[str, Any] | None, Field(None, description=description))
    return keys


# [stall] of the file
StallSection = create_model("StallSection", __base__=_StallKeys, **_table_keys())


def separation_of(item: Any, folder: Path, problems: list[str]) -> FlowSeparation | None:
    """Return the separation of an aircraft file in `folder`, None if it has problems.

    The problems are appended to `problems`.
    """
    tables: dict[str, Any] = {}
    found: list[str] = []
    try:
        if item.file:
            tables |= open_tables(folder / item.file)
    except (SchemaError, OSError) as error:
        found += getattr(error, "problems", [str(error)])
    for name, unit in TARGETS.items():
        value = getattr(item, name)
        if value is None:
            continue
        if name in tables:
            found.append(f"{name} is given here and in {item.file}; keep one")
        try:
            tables[name] = leaf_from_toml(value, unit)
        except (SchemaError, UnitError, ValueError) as error:
            found += [f"{name}: {text}" for text in getattr(error, "problems", [str(error)])]
    if not found:
        try:
            return FlowSeparation(item.station, tables)
        except SchemaError as error:
            found += error.problems
    problems += [f"stall: {text}" for text in found]
    return None
