"""Section on an identified engine: constants, responses of the spools, thrust deck, tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

from flighttest.submodels.engine.result import EngineFit
from pom.report.presentation.quantities import fixed_decimals, format_number
from pom.report.presentation.unit_sets import units_in_text
from pom.report.submodels.section import (
    EQUATION_ERROR,
    OUTPUT_ERROR,
    PanelOf,
    Picture,
    Section,
    SectionLine,
    SectionTable,
    estimate_cells,
    make_picture,
)

# Classes of the lines of a panel with several nodes.
CODES = ("run-0", "run-2", "run-3", "run-4", "run-5")
# Number of drawn power changes, those of the largest change of speed.
CHANGES = 4
# Number of drawn Mach numbers of the deck.
MACHS = 3
# Units of the tables of steady flight.
UNITS = {"corrected_thrust": "N", "thrust": "N", "fuel_flow": "kg/s", "corrected_fuel_flow": "kg/s"}
# Titles of the tables of the spools.
ENGINE_SHOWN = {
    "n2_command": "n2 at rest, 1",
    "n1_command": "n1 at rest, 1",
    "n2_up_time": "time constant up, s",
    "n2_down_time": "time constant down, s",
}


@dataclass
class _SectionParts:
    """Parts of the section, which the steps of the identification add to."""

    techniques: list[tuple[str, str, str]] = field(default_factory=list)
    grids: list[SectionTable] = field(default_factory=list)
    pictures: list[Picture] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)


def engine_section(name: str, engine: EngineFit) -> Section:
    """Return the section of an identified engine.

    The deck over corrected speed is drawn next to the a-priori one, as in [LR743] Fig. 6.

    Parameters
    ----------
    name : str
        Name of the submodel.
    engine : EngineFit
        Result of the identification.
    """
    parts = _SectionParts()
    tables: dict[str, Any] = {}
    constants: dict[str, tuple[float, float]] = {}
    for step, title in (
        (engine.spools, "governor and spools"),
        (engine.start, "start and shut-down"),
    ):
        if step is None:
            continue
        constants |= step.constants
        tables |= step.tables
        parts.techniques.append((title, OUTPUT_ERROR, _describe_noise(step)))
    if constants:
        rows = []
        for key, (value, stderr) in constants.items():
            rows.append((key.replace("_", " "), *estimate_cells(value, stderr)))
        head = ("constant", "estimate", "standard error")
        parts.grids.append(SectionTable("Constants, SI", head, tuple(rows)))
    if engine.spools is not None:
        parts.pictures += _draw_responses(name, engine.spools.responses)
        parts.remarks += engine.spools.remarks
    if engine.static is not None:
        _add_static_thrust(parts, name, engine.static)
    _add_steady_tables(parts, name, engine)
    parts.remarks += [units_in_text(remark.text) for remark in engine.remarks]
    parts.pictures += _draw_tables(name, tables)
    return Section(
        name,
        tuple(parts.techniques),
        grids=tuple(parts.grids),
        pictures=tuple(parts.pictures),
        remarks=tuple(parts.remarks),
    )


def _add_static_thrust(parts: _SectionParts, name: str, static: Any) -> None:
    """Add the static thrust: residuals, factors on the a-priori deck, figure of the deck."""
    residuals = []
    for title, residual in static.residuals.items():
        rms = fixed_decimals(100 * float(np.sqrt(np.mean(residual**2))), 2)
        residuals.append(f"{title} {rms} % of the thrust, {len(residual)} points")
    parts.techniques.append(("static thrust", EQUATION_ERROR, "; ".join(residuals)))

    rows = []
    for speed, factor, stderr, determined in zip(
        static.speeds, static.factor, static.stderr, static.determined, strict=True
    ):
        source = "flight" if determined else "as a priori"
        rows.append((format_number(speed, 4), *estimate_cells(factor, stderr), source))
    parts.grids.append(
        SectionTable(
            "Corrected over a-priori thrust",
            ("corrected speed", "factor", "standard error", "source"),
            tuple(rows),
        )
    )
    parts.pictures += _draw_deck(name, static.prior, static.leaf)
    parts.remarks += static.remarks


def _add_steady_tables(parts: _SectionParts, name: str, engine: EngineFit) -> None:
    """Add the residuals of the tables from steady flight, and the figure of the thrust."""
    for title, table in engine.steady.items():
        residual = f"rms {format_number(table.rms, 3)} {UNITS.get(title, '')}".strip()
        parts.techniques.append(
            (title.replace("_", " "), EQUATION_ERROR, f"{residual}, {table.samples} samples")
        )
        if title == "corrected_thrust" and title in engine.prior:
            parts.pictures += _draw_deck(name, engine.prior[title], table.leaf)


def _describe_noise(step: Any) -> str:
    """Return the residuals of the output-error searches of a step, by output."""
    residuals = []
    for key in ("core", "fan", "search", "speed"):
        search = getattr(step, key, None)
        if search is None:
            continue
        outputs = search.noise["output"].values
        rms = search.noise["stderr"].isel(manoeuvre=0).values
        for output, value in zip(outputs, rms, strict=True):
            label = str(output).removeprefix("engine1.")
            residuals.append(f"{label} rms {format_number(float(value), 2)}")
    return "; ".join(residuals)


def _draw_responses(name: str, responses: Sequence[xr.Dataset]) -> list[Picture]:
    """Draw recorded and simulated speeds of the spools, for the largest power changes."""
    chosen = sorted(responses, key=lambda response: -float(np.ptp(response["n2"].values)))
    panels = []
    for response in chosen[:CHANGES]:
        # The clock begins at zero in every panel.
        time = response["time"].values - response["time"].values[0]
        speeds = [speed for speed in ("n2", "n1") if speed in response]
        curves = [SectionLine(time, response["throttle"].values, "run-1")]
        for speed in speeds:
            curves.append(SectionLine(time, response[speed].values, "run-0"))
            curves.append(SectionLine(time, response[f"{speed}_model"].values, "run-3"))
        title = f"{' and '.join(speeds)}, {response.attrs.get('record', '')}".rstrip(", ")
        panels.append(PanelOf(title, "time, s", tuple(curves)))
    if not panels:
        return []
    key = [("run-0", "recorded"), ("run-3", "simulated"), ("run-1", "lever")]
    description = (
        f"Response of the spools to the lever, recorded and simulated, {len(panels)} of "
        f"{len(responses)} power changes"
    )
    return [make_picture(f"response-{name}", panels, key=key, words=description)]


def _draw_deck(name: str, prior: xr.Dataset, leaf: xr.Dataset) -> list[Picture]:
    """Draw net thrust over corrected speed at a few Mach numbers, a priori and from flight."""
    dims = [str(dim) for dim in leaf["value"].dims]
    axis = next(dim for dim in dims if dim.startswith("corrected_n"))
    machs = leaf["mach"].values if "mach" in dims else np.zeros(1)
    # Evenly spaced positions from the lowest to the highest Mach number.
    chosen = machs[np.unique(np.linspace(0, len(machs) - 1, MACHS).round().astype(int))]
    coded = list(zip(chosen, CODES, strict=False))
    panels = []
    for title, deck in (("a priori", prior), ("from flight", leaf)):
        curves = []
        for mach, css in coded:
            # From N to kN.
            thrust = _thrust_at(deck["value"], axis, mach) / 1e3
            curves.append(SectionLine(deck[axis].values, thrust, css))
        label = f"Corrected net thrust {title}, kN"
        panels.append(PanelOf(label, axis.replace("_", " "), tuple(curves)))
    key = [(css, f"M {mach:.2f}") for mach, css in coded]
    description = "Corrected net thrust over corrected speed, a priori and from flight"
    return [make_picture(f"deck-{name}", panels, key=key, words=description)]


def _thrust_at(table: xr.DataArray, axis: str, mach: float) -> np.ndarray:
    """Return a table over one axis at a Mach number, at the first node of the other axes."""
    if "mach" in table.dims:
        table = table.sel(mach=mach, method="nearest")
    return table.isel({dim: 0 for dim in table.dims if dim != axis}).values


def _draw_tables(name: str, tables: Mapping[str, Any]) -> list[Picture]:
    """Draw the tables of the spools over their speed or lever, with one standard error."""
    panels: list[PanelOf] = []
    key: list[tuple[str, str]] = []
    for title, table in tables.items():
        axis, *other_axes = map(str, table.leaf["value"].dims)
        curves = []
        coded = _table_slices(table.leaf, other_axes)
        for css, leaf in coded:
            values, stderr = leaf["value"].values, leaf["stderr"].values
            curves.append(SectionLine(leaf[axis].values, values, css, stderr))
        label = ENGINE_SHOWN.get(title, title.replace("_", " "))
        panels.append(PanelOf(label, axis, tuple(curves)))
        if other_axes and not key:
            flight_condition = other_axes[0]
            for css, leaf in coded:
                node = format_number(float(leaf[flight_condition]), 3)
                key.append((css, f"{flight_condition} {node}"))
    if not panels:
        return []
    description = f"{', '.join(panel.title for panel in panels)}, with one standard error"
    return [make_picture(f"tables-{name}", panels, key=key, words=description)]


def _table_slices(leaf: xr.Dataset, other_axes: Sequence[str]) -> list[tuple[str, xr.Dataset]]:
    """Return line code and table over its first axis, for the nodes of a flight condition."""
    if not other_axes:
        return [("run-3", leaf)]
    slices = []
    # All other axes advance together; an axis with fewer nodes stays at its last one.
    for position in range(min(len(CODES), leaf.sizes[other_axes[0]])):
        nodes = {axis: min(position, leaf.sizes[axis] - 1) for axis in other_axes}
        slices.append((CODES[position], leaf.isel(nodes)))
    return slices
