"""Tables of propeller and engine with the values of a flight."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from flightmech.aircraft.engine import Engine
from flightmech.terms import SOURCE_ATTRS, SOURCES


def fuel_tables(engine: Engine) -> dict[str, xr.Dataset]:
    """Return the tables that a factor of the fuel flow multiplies."""
    part = engine.piston or engine.propeller
    names = ("fuel_flow", "bsfc", "shaft_bsfc")
    return {name: part.tables[name] for name in names if part and name in part.tables}


def from_flight(
    prior: xr.Dataset, value: xr.DataArray, stderr: xr.DataArray, inside: np.ndarray | None = None
) -> xr.Dataset:
    """Return a table with values and standard errors of the flight.

    Nodes that are not `inside` the flown range keep their source.
    """
    leaf = prior.drop_vars(["stderr", "source"], errors="ignore").copy()
    leaf["value"], leaf["stderr"] = value, stderr
    source = np.full(value.shape, SOURCES.index("judgement"), np.uint8)
    if "source" in prior:
        source = prior["source"].values.copy()
    flown = np.ones(value.shape, bool) if inside is None else inside
    source[flown] = SOURCES.index("flight")
    leaf["source"] = value.dims, source
    leaf["source"].attrs = dict(SOURCE_ATTRS)
    leaf.attrs = {**prior.attrs, "comment": "a-priori table corrected from flight"}
    return leaf


def replace_parts(
    engine: Engine, tables: Mapping[str, xr.Dataset], constants: Mapping[str, float]
) -> Engine:
    """Return an engine with tables and constants in the parts that have them."""
    parts: dict[str, Any] = {}
    for name in ("propeller", "piston", "deck"):
        part = getattr(engine, name)
        if part is None:
            continue
        own = {key: leaf for key, leaf in tables.items() if key in part.tables}
        changed = {key: x for key, x in constants.items() if hasattr(part, key)}
        parts[name] = replace(part, tables={**part.tables, **own}, **changed)
    return replace(engine, **parts)
