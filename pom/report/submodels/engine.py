"""Engine: the deck over corrected speed next to the a-priori one (as [LR743] Fig. 6), schedule and time constants, constants."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from flighttest.engine import EngineFit

from ..presentation.quantities import fixed, number
from .section import EQUATION_ERROR, OUTPUT_ERROR, Curve, Grid, PanelOf, Picture, Section, estimate, picture

CODES = ("run-0", "run-2", "run-3", "run-4", "run-5")
CHANGES = 4  # power changes that are drawn, those of the largest change of speed
MACHS = 3  # Mach numbers of the deck that are drawn
UNITS = {"corrected_thrust": "N", "thrust": "N", "fuel_flow": "kg/s", "corrected_fuel_flow": "kg/s"}
ENGINE_SHOWN = {
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
    if found.spools is not None:
        pictures += _responses(name, found.spools.responses)
        remarks += found.spools.remarks
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
    for title, table in found.steady.items():
        residual = f"rms {number(table.rms, 3)} {UNITS.get(title, '')}".strip()
        measures.append((title.replace("_", " "), EQUATION_ERROR, f"{residual}, {table.samples} samples"))
        if title == "corrected_thrust" and title in found.prior:
            pictures += _deck(name, found.prior[title], table.leaf)
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


def _responses(name: str, responses: Sequence[xr.Dataset]) -> list[Picture]:
    """Return speeds over time, recorded and simulated from the lever by the identified spools, of the largest power changes."""
    chosen = sorted(responses, key=lambda one: -float(np.ptp(one["n2"].values)))[:CHANGES]
    panels = []
    for one in chosen:
        time = one["time"].values - one["time"].values[0]
        speeds = [speed for speed in ("n2", "n1") if speed in one]
        curves = [Curve(time, one["throttle"].values, "run-1")]
        curves += [Curve(time, one[f"{speed}{what}"].values, css) for speed in speeds for what, css in (("", "run-0"), ("_model", "run-3"))]
        title = f"{' and '.join(speeds)}, {one.attrs.get('record', '')}".rstrip(", ")
        panels.append(PanelOf(title, "time, s", tuple(curves)))
    key = [("run-0", "recorded"), ("run-3", "simulated"), ("run-1", "lever")]
    words = f"Response of the spools to the lever, recorded and simulated, {len(chosen)} of {len(responses)} power changes"
    return [picture(f"response-{name}", panels, key, words)] if panels else []


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
    """Return the tables of the spools over their speed or lever; over a flight condition too, a line for every node of it."""
    panels: list[PanelOf] = []
    key: list[tuple[str, str]] = []
    for title, curve in tables.items():
        leaf = curve.leaf
        axis, *others = map(str, leaf["value"].dims)
        nodes = [{}] if not others else [{other: k for other in others} for k in range(min(len(CODES), leaf.sizes[others[0]]))]
        lines = [leaf.isel({dim: min(k, leaf.sizes[dim] - 1) for dim, k in at.items()}) for at in nodes]
        codes = ("run-3",) if not others else CODES
        curves = tuple(
            Curve(one[axis].values, one["value"].values, css, one["stderr"].values) for one, css in zip(lines, codes, strict=False)
        )
        panels.append(PanelOf(ENGINE_SHOWN.get(title, title.replace("_", " ")), axis, curves))
        if others and not key:
            key = [(css, f"{others[0]} {number(float(one[others[0]]), 3)}") for one, css in zip(lines, codes, strict=False)]
    words = f"{', '.join(panel.title for panel in panels)}, with one standard error"
    return [picture(f"tables-{name}", panels, key, words)] if panels else []
