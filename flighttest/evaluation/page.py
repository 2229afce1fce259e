"""An evaluation as one HTML page that needs nothing else."""

from __future__ import annotations

import hashlib
import math
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flightmech.errors import UnknownName
from flightmech.names import lookup
from flightmech.support.console import command_line
from flightmech.units import from_si

from ..quality.page import style, template_of
from ..quality.plots import chart, scatter
from ..quality.text import meaningful, shown
from .figures_of_merit import INSIDE
from .plan import files_of
from .text import limits_shown, number, unit_shown

if TYPE_CHECKING:
    from ..aircraft_properties.eigenmotion import Motion
    from ..equation_error.fit import Fit
    from .result import Evaluation
    from .stationary_points import Fitted

_SHOWN = (
    "V",
    "h_baro",
    "mach",
    "alpha_vane",
    "alpha",
    "theta",
    "delta_e",
    "mass",
    "x_cg_b",
    "engine1.thrust",
    "CL",
    "CD",
)


def page(evaluation: Evaluation) -> str:
    """Return the page as text."""
    e = evaluation
    return template_of("flighttest.evaluation").render(
        style=style(),
        title=e.plan.title,
        verdict=e.verdict,
        grade="good" if e.passed else "error",
        quality=e.quality,
        kinematics=[_kinematic(row) for row in e.quality.kinematics.to_dict("records")],
        delays=e.quality.delays.to_dict("records"),
        answers=e.quality.answers.to_dict("records"),
        refused=e.refused,
        bounds=[_bound(row) for row in e.judged.to_dict("records")],
        columns=[(name, _units(name)) for name in _SHOWN if name in e.points],
        points=[_point(e, row) for row in e.points.to_dict("records")],
        lines=[_line(e, fitted) for fitted in e.lines],
        fits=[_fit(fit) for fit in e.fits],
        motions=[_motion(name, motion) for name, motion in e.motions.items()],
        files=[_file(path) for path in files_of(e.plan)],
        command=command_line(),
        version=version("aeromatch"),
    )


def _units(name: str) -> str:
    """Return the unit in which people read a quantity."""
    try:
        return lookup(name).display_units
    except UnknownName:
        return "deg" if name == "attitude_less_climb" else "1"


def _name(name: str) -> str:
    units = _units(name)
    return name if units == "1" else f"{name} [{units}]"


def _kinematic(row) -> dict[str, Any]:
    texts = {f"{name}_text": shown(row[name], row["units"]) for name in ("offset", "rms")}
    return {**row, **texts, "meaningful": meaningful(row["moving"], row["correlation"])}


def _bound(row) -> dict[str, Any]:
    unit = row["unit"]
    texts = {"value_text": number(row["value"], unit), "stderr_text": number(row["stderr"], unit, 2), "unit_text": unit_shown(unit)}
    return {**row, **texts, "limits": limits_shown(row["low"], row["high"], unit), "inside": row["verdict"] == INSIDE}


def _point(e: Evaluation, row) -> dict[str, Any]:
    cells = [f"{from_si(row[name], _units(name)):.4g}" if math.isfinite(row[name]) else "" for name in _SHOWN if name in e.points]
    return {"start": row["start"], "stop": row["stop"], "cells": cells}


def _line(e: Evaluation, fitted: Fitted) -> dict[str, Any]:
    line = fitted.line
    names = (f"{line.x} squared" if line.kind == "polar" else _name(line.x)), _name(line.y)
    x_units, y_units = ("1" if line.kind == "polar" else _units(line.x)), _units(line.y)
    x, y = from_si(fitted.x, x_units), from_si(fitted.y, y_units)
    ends = np.array([fitted.x.min(), fitted.x.max()])
    a, b = from_si(ends, x_units), from_si(fitted.offset[0] + fitted.slope[0] * ends, y_units)
    slope = float((b[1] - b[0]) / (a[1] - a[0]))
    figures = _draw_figures({key.rpartition(".")[2]: f for key, f in e.figures.items() if key.rpartition(".")[0] == line.name})
    svg = scatter(x, y, (float(b[0] - slope * a[0]), slope), names, f"{line.y} over {line.x}")
    return {"name": line.name, "title": f"{line.y} over {names[0]}, {len(x)} points", "svg": svg, "figures": figures}


def _draw_figures(figures: dict[str, Any]) -> list[dict[str, str]]:
    return [
        {"name": name, "value": number(value, unit), "stderr": number(stderr, unit, 2), "unit": unit_shown(unit)}
        for name, (value, stderr, unit) in figures.items()
    ]


def _fit(fit: Fit) -> dict[str, Any]:
    e, a = fit.estimates, fit.estimates.attrs
    columns = ("estimate", "stderr", "stderr_systematic", "vif")
    rows = [{"term": str(term), **{name: float(e[name].sel(term=term)) for name in columns}} for term in e["term"].values]
    measured, picture = fit.data[fit.model.coefficient].values, None
    if a["manoeuvres"] == 1:
        picture = chart(fit.data["time"].values, [measured, measured - fit.residual], "measured and fitted", label=str(fit.model))
    about = f"{a['samples']} samples, {a['manoeuvres']} windows, R² {a['R2']:.4f}, residual rms {a['residual_rms']:.3g}"
    return {
        "name": fit.name,
        "model": str(fit.model),
        "about": about,
        "rows": rows,
        "remarks": [str(remark) for remark in fit.remarks],
        "svg": picture,
    }


def _motion(name: str, motion: Motion) -> dict[str, Any]:
    charts = []
    for channel in motion.channels:
        units = _units(channel)
        lines = [from_si(part[channel], units) for part in (motion.measured, motion.fitted)]
        charts.append({"title": _name(channel), "svg": chart(motion.time, lines, units, label=f"{channel}, measured and fitted")})
    return {
        "name": name,
        "kind": motion.kind,
        "share": motion.share,
        "remarks": [str(remark) for remark in motion.remarks],
        "figures": _draw_figures(motion.values),
        "charts": charts,
    }


def _file(path: Path) -> dict[str, str]:
    with path.open("rb") as file:
        return {"name": path.name, "sha256": hashlib.file_digest(file, "sha256").hexdigest()}
