"""Section on an identified stall: separation, terms, loops of the lift, separation over time."""

from __future__ import annotations

import numpy as np
import xarray as xr

from flightmech.names import value_text
from flighttest.submodels.stall.result import SEPARATION_POINT, StallIdentification
from pom.report.presentation.quantities import format_number
from pom.report.submodels.section import (
    EQUATION_ERROR,
    PanelOf,
    Picture,
    Section,
    SectionLine,
    SectionTable,
    estimate_cells,
    make_picture,
)

MOST_RECORDS = 8  # drawn; the others are counted in the alternative text
MOST_POINTS = 400  # of a line
_UNITS = {"alpha_star": "deg", "asymmetry": "deg"}


def stall_section(name: str, stall: StallIdentification) -> Section:
    """Return the section of an identified stall.

    Parameters
    ----------
    name : str
        Name of the submodel.
    stall : StallIdentification
    """
    R2 = np.atleast_1d(stall.fit.estimates.attrs["R2"])
    techniques = []
    for model, value in zip(stall.fit.models, R2, strict=True):
        text = f"R2 {format_number(float(value), 3)}"
        if np.isfinite(stall.left_out[model.target]):
            text += f", {format_number(stall.left_out[model.target], 3)} on records left out"
        techniques.append((model.target, EQUATION_ERROR, text))
    return Section(
        name,
        tuple(techniques),
        grids=(_separation_table(stall), _term_table(stall)),
        pictures=_draw_records(name, stall),
        remarks=tuple(stall.remarks),
    )


def _separation_table(stall: StallIdentification) -> SectionTable:
    """Return the parameters of the separation; angles in degrees."""
    rows = []
    for name in stall.flow.parameters:
        value, stderr = stall.value(name)
        base = next((own for own in _UNITS if name.startswith(own)), "")
        factor = np.rad2deg(1.0) if base else 1.0
        cells = estimate_cells(factor * value, factor * stderr)
        if name in stall.flow.fixed:
            cells = (cells[0], "fixed")
        rows.append((name, *cells, _UNITS.get(base, "1")))
    nodes = ""
    if len(stall.flow.nodes) > 1:
        places = [value_text(stall.flow.axis, node) for node in stall.flow.nodes]
        nodes = f"; _0, _1 ... at {stall.flow.axis} {', '.join(places)}"
    caption = (
        "Flow separation: tau1 (cbar/V) dX/dt + X = (1 - tanh(a1 (alpha - tau2 (cbar/V) dalpha/dt "
        f"- alpha_star)))/2, at {stall.station:.3g} m from the plane of symmetry{nodes}; "
        f"{SEPARATION_POINT}"
    )
    return SectionTable(caption, ("parameter", "estimate", "standard error", "unit"), tuple(rows))


def _term_table(stall: StallIdentification) -> SectionTable:
    """Return the terms of the separated flow."""
    rows = []
    for coefficient, terms in stall.separated.items():
        for term in terms:
            cells = estimate_cells(*stall.term_value(coefficient, term.text))
            rows.append((f"{coefficient}: {term.text}", *cells))
    return SectionTable(
        "Terms of the separated flow; X_loss is 1 - X",
        ("term", "estimate", "standard error"),
        tuple(rows),
    )


def _draw_records(name: str, stall: StallIdentification) -> tuple[Picture, ...]:
    """Draw CL over alpha, flight and fit, and X of both halves over time, for each record."""
    panels = []
    for number, record in enumerate(stall.records[:MOST_RECORDS], 1):
        fitted = stall.predict(record)
        step = max(1, record.sizes["time"] // MOST_POINTS)
        shown, fit = (item.isel(time=slice(None, None, step)) for item in (record, fitted))
        label = str(record.attrs.get("record") or f"record {number}")
        panels += [_lift_panel(label, shown, fit, stall.with_database), _time_panel(label, fit)]
    lift = "lift on top of the database" if stall.with_database else "lift coefficient"
    words = f"{lift} over the angle of attack, and separation over time, of "
    words += f"{len(panels) // 2} of {len(stall.records)} records"
    key = (("run-2", "flight; X of the right half"), ("run-3", "fit; X of the left half"))
    return (make_picture(name.replace(" ", "-"), panels, key=key, words=words),)


def _lift_panel(label: str, record: xr.Dataset, fit: xr.Dataset, on_top: bool) -> PanelOf:
    alpha, flown = np.rad2deg(record["alpha"].values), record["CL"].values
    curves = []
    for values, css in ((flown, "run-2"), (fit["CL"].values, "run-3")):
        kept = np.isfinite(alpha) & np.isfinite(values)
        curves.append(SectionLine(alpha[kept], values[kept], css))
    title = "CL less that of the database" if on_top else "CL"
    return PanelOf(f"{title}, {label}", "angle of attack, deg", tuple(curves))


def _time_panel(label: str, fit: xr.Dataset) -> PanelOf:
    time = fit["time"].values - float(fit["time"][0])
    curves = [
        SectionLine(time, fit["X_right"].values, "run-2"),
        SectionLine(time, fit["X_left"].values, "run-3"),
    ]
    return PanelOf(f"separation point X, {label}", "time, s", tuple(curves))
