"""Engine: the deck over corrected speed next to the a-priori one (as [LR743] Fig. 6), schedule and time constants, constants."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from flighttest.engine import EngineFit

from ..presentation.quantities import fixed, number
from .section import EQUATION_ERROR, OUTPUT_ERROR, Curve, Grid, PanelOf, Picture, Section, estimate, picture

CODES = ("run-0", "run-2", "run-3", "run-4", "run-5")
MACHS = 3  # Mach numbers of the deck that are drawn
SHOWN = {
    "n2_command": "n2 at rest, 1",
    "n1_command": "n1 at rest, 1",
    "n2_up_time": "time constant up, s",
    "n2_down_time": "time constant down, s",
}


def engine(name: str, found: EngineFit) -> Section:
    """Return the section of an identified engine."""
    measures: list[tuple[str, str, str]] = []
    grids: list[Grid] = []
    pictures: list[Picture] = []
    remarks: list[str] = []
    constants: dict[str, tuple[float, float]] = {}
    tables: dict[str, Any] = {}
    for part, title in ((found.spools, "governor and spools"), (found.start, "start and shut-down")):
        if part is not None:
            constants |= part.constants
            tables |= part.tables
            measures.append((title, OUTPUT_ERROR, _noise(part)))
    if found.static is not None:
        static = found.static
        rms = [
            f"{title} {fixed(100 * float(np.sqrt(np.mean(v**2))), 2)} % of the thrust, {len(v)} points"
            for title, v in static.residuals.items()
        ]
        measures.append(("static thrust", EQUATION_ERROR, "; ".join(rms)))
        factors = zip(static.speeds, static.factor, static.stderr, static.determined, strict=True)
        cells = tuple((number(x, 4), *estimate(f, e), "flight" if known else "as a priori") for x, f, e, known in factors)
        grids.append(Grid("Corrected over a-priori thrust", ("corrected speed", "factor", "standard error", "source"), cells))
        pictures += _deck(name, static.prior, static.leaf)
        remarks += static.remarks
    if constants:
        rows = tuple((key.replace("_", " "), *estimate(*pair)) for key, pair in constants.items())
        grids.insert(0, Grid("Constants, SI", ("constant", "estimate", "standard error"), rows))
    return Section(name, tuple(measures), tuple(grids), (*pictures, *_tables(name, tables)), tuple(remarks))


def _noise(part: Any) -> str:
    """Return the residuals of the output-error searches of a part, by output."""
    searches = [search for search in (getattr(part, key, None) for key in ("core", "fan", "search", "speed")) if search is not None]
    rows = [
        (str(n), float(v))
        for search in searches
        for n, v in zip(search.noise["output"].values, search.noise["stderr"].isel(manoeuvre=0).values, strict=True)
    ]
    return "; ".join(f"{n.removeprefix('engine1.')} rms {number(v, 2)}" for n, v in rows)


def _deck(name: str, prior: xr.Dataset, leaf: xr.Dataset) -> list[Picture]:
    """Return net thrust over corrected speed, a line code for every Mach number, a priori and from flight."""
    axis = next(str(dim) for dim in leaf["value"].dims if str(dim).startswith("corrected_n"))
    machs = leaf["mach"].values if "mach" in leaf["value"].dims else np.zeros(1)
    chosen = machs[np.unique(np.linspace(0, len(machs) - 1, MACHS).round().astype(int))]
    panels = []
    for title, one in (("a priori", prior), ("from flight", leaf)):
        curves = tuple(Curve(one[axis].values, _at(one["value"], axis, mach) / 1e3, css) for mach, css in zip(chosen, CODES, strict=False))
        panels.append(PanelOf(f"Corrected net thrust {title}, kN", axis.replace("_", " "), curves))
    key = [(css, f"M {mach:.2f}") for mach, css in zip(chosen, CODES, strict=False)]
    return [picture(f"deck-{name}", panels, key, "Corrected net thrust over corrected speed, a priori and from flight")]


def _at(table: xr.DataArray, axis: str, mach: float) -> np.ndarray:
    """Return a table over one axis at a Mach number; at the first node of the other axes."""
    table = table.sel(mach=mach, method="nearest") if "mach" in table.dims else table
    return table.isel({dim: 0 for dim in table.dims if dim != axis}).values


def _tables(name: str, tables: Mapping[str, Any]) -> list[Picture]:
    panels = []
    for key, curve in tables.items():
        leaf = curve.leaf
        if leaf["value"].ndim == 1:
            axis = str(leaf["value"].dims[0])
            panels.append(
                PanelOf(
                    SHOWN.get(key, key.replace("_", " ")),
                    axis,
                    (Curve(leaf[axis].values, leaf["value"].values, "run-3", leaf["stderr"].values),),
                )
            )
    words = f"{', '.join(panel.title for panel in panels)}, with one standard error"
    return [picture(f"tables-{name}", panels, (), words)] if panels else []
