"""Result of an evaluation, as text, netCDF files and one self-contained HTML page."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import UnknownName
from flightmech.names import lookup
from flightmech.short_text import ShortText
from flightmech.support.atomic_write import folder_for_files
from flightmech.support.console import command_line, to_json_types
from flightmech.support.input_files import name_and_sha256
from flightmech.units import from_si
from flighttest.flight_programme.evaluation.figures_of_merit import (
    INSIDE,
    FigureOfMerit,
    FittedLine,
    format_si_value,
    limits_shown,
    unit_shown,
)
from flighttest.flight_programme.evaluation.plan import EvaluationPlan, files_of
from flighttest.reconstruction.flight_path import FlightPath
from flighttest.reconstruction.flight_programme import save_path
from flighttest.reconstruction.quality.page import (
    draw_scatter_chart,
    draw_time_chart,
    read_style_sheet,
    template_of,
)
from flighttest.reconstruction.quality.result import Quality, format_display_value, is_meaningful
from flighttest.reconstruction.quality.result import format_quality as quality_report
from flighttest.records.files import save_record
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.fit_file import save_fit
from flighttest.remarks import Remark, is_forbidden, remarks_to_json
from flighttest.submodels.aircraft_properties.eigenmotion import Eigenmotion

# Characters that a name of a file should not have.
_ODD = re.compile(r"[^\w.-]+")
# Columns of the table of stationary points.
_POINT_COLUMNS = (
    *("V", "h_baro", "mach", "alpha_vane", "alpha", "theta"),
    *("delta_e", "mass", "x_cg_b", "engine1.thrust", "CL", "CD"),
)
_FIT_COLUMNS = ("estimate", "stderr", "stderr_systematic", "vif")


@dataclass(frozen=True)
class Evaluation(ShortText):
    """Result of `evaluate_flight`.

    Attributes
    ----------
    plan : EvaluationPlan
    aircraft : Aircraft
    record : DataTree
        With mass, c.g. and thrust.
    quality : Quality
    paths : dict of str to FlightPath
        ``points``, and one path per manoeuvre and window.
    points : DataFrame
        Means over the stationary points.
    lines : list of FittedLine
    fits : list of Fit
    motions : dict of str to Eigenmotion
    figures : dict of str to FigureOfMerit
    judged : DataFrame
        Bounds and verdicts.
    refused : dict of str to str
        Reason for each part of the plan that is not determined.
    thrust_remarks : list of Remark
        Stretches whose thrust is extrapolated beyond the points of the deck.
    """

    plan: EvaluationPlan
    aircraft: Aircraft
    record: xr.DataTree
    quality: Quality
    paths: dict[str, FlightPath]
    points: pd.DataFrame
    lines: list[FittedLine]
    fits: list[Fit]
    motions: dict[str, Eigenmotion]
    figures: dict[str, FigureOfMerit]
    judged: pd.DataFrame
    refused: dict[str, str]
    thrust_remarks: list[Remark] = field(default_factory=list)

    @property
    def passed(self) -> bool:
        """Whether all parts are determined and usable, and every figure is inside its bounds."""
        if not self.quality.usable or self.refused or self.barred:
            return False
        return bool((self.judged["verdict"] == INSIDE).all())

    @property
    def remarks(self) -> dict[str, list[Remark]]:
        """Remarks on each fit and motion by name, and on the thrust if it has any."""
        remarks = {fit.name: fit.remarks for fit in self.fits}
        for name, motion in self.motions.items():
            remarks[name] = motion.remarks
        if self.thrust_remarks:
            remarks["thrust"] = self.thrust_remarks
        return remarks

    @property
    def barred(self) -> dict[str, list[Remark]]:
        """Fits and motions whose figures must not be used, with the remarks that state why."""
        return {name: remarks for name, remarks in self.remarks.items() if is_forbidden(remarks)}

    @property
    def verdict(self) -> str:
        """Result in one line."""
        if not self.quality.usable:
            return f"not evaluated: the record is not fit for it ({self.quality.verdict})"
        count = int((self.judged["verdict"] == INSIDE).sum())
        text = f"{count} of {len(self.judged)} figures inside their bounds"
        if self.refused:
            text += f"; not determined: {', '.join(self.refused)}"
        if self.barred:
            text += f"; not to be used: {', '.join(self.barred)}"
        return text

    def report(self) -> str:
        """Return quality, fits, motions and bounds as text."""
        return format_evaluation(self)

    def as_dict(self) -> dict[str, Any]:
        """Return all results except the time histories, as types of JSON."""
        parts = {
            "title": self.plan.title,
            "verdict": self.verdict,
            "figures": {name: figure._asdict() for name, figure in self.figures.items()},
            "bounds": self.judged,
            "refused": self.refused,
            "remarks": {name: remarks_to_json(items) for name, items in self.remarks.items()},
            "points": self.points,
            "quality": self.quality.as_dict(),
        }
        return to_json_types(parts)

    def save(self, folder: str | Path) -> list[Path]:
        """Write record, paths and fits as netCDF files for other commands; return their names."""
        names = ["record.nc"]
        with folder_for_files(folder) as place:
            save_record(self.record, place / names[0])
            for name, path in self.paths.items():
                names.append(f"path_{_ODD.sub('_', name)}.nc")
                save_path(path, place / names[-1])
            for fit in self.fits:
                names.append(f"fit_{fit.name}.nc")
                save_fit(fit, place / names[-1])
        return [Path(folder) / name for name in names]


def format_evaluation(evaluation: Evaluation) -> str:
    """Return consistency, stationary lines, coefficients, eigenmotions and bounds as text."""
    e = evaluation
    lines = [e.plan.title, e.verdict, "", quality_report(e.quality), ""]
    for fitted in e.lines:
        head = f"{fitted.line.name}: {fitted.line.y} over {fitted.line.x}, {len(fitted.x)} points"
        lines += [head, *_format_figures(e, fitted.line.name), ""]
    for fit in e.fits:
        lines += [fit.report(), ""]
    for name, motion in e.motions.items():
        lines += [f"{name}: {motion.report()}", ""]
    for name, text in e.refused.items():
        lines += [f"! {name} not determined: {text}"]
    lines += [f"! {remark}" for remark in e.thrust_remarks]
    lines += ["", "bounds:"]
    for row in e.judged.to_dict("records"):
        symbol = " " if row["verdict"] == INSIDE else "!"
        value = _format_figure(row["value"], row["stderr"], row["unit"])
        limits = limits_shown(row["low"], row["high"], row["unit"])
        lines.append(
            f"{symbol} {row['of']:34s} {value:28s} {limits:24s} {row['verdict']:15s} "
            f"{row['source']}"
        )
    return "\n".join(lines)


def _format_figure(value: float, stderr: float, unit: str, *, width: int = 0) -> str:
    """Return value, standard error in brackets, and unit."""
    number, error = format_si_value(value, unit), format_si_value(stderr, unit, 2)
    return f"{number:>{width}s} ({error}) {unit_shown(unit)}".rstrip()


def _figures_of_part(e: Evaluation, name: str) -> dict[str, FigureOfMerit]:
    """Return the figures of a line by their own names, without the name of the line."""
    figures = {}
    for key, figure in e.figures.items():
        part, _, short = key.rpartition(".")
        if part == name:
            figures[short] = figure
    return figures


def _format_figures(e: Evaluation, name: str) -> list[str]:
    lines = []
    for short, figure in _figures_of_part(e, name).items():
        text = _format_figure(figure.value, figure.stderr, figure.unit, width=10)
        lines.append(f"  {short:10s}{text}")
    return lines


def render_evaluation_page(evaluation: Evaluation) -> str:
    """Return the HTML page of an evaluation as text."""
    e = evaluation
    return template_of("flighttest.flight_programme.evaluation").render(
        style=read_style_sheet(),
        title=e.plan.title,
        verdict=e.verdict,
        grade="good" if e.passed else "error",
        quality=e.quality,
        kinematics=[_relation_row(row) for row in e.quality.kinematics.to_dict("records")],
        delays=e.quality.delays.to_dict("records"),
        answers=e.quality.answers.to_dict("records"),
        refused=e.refused,
        thrust_remarks=[str(remark) for remark in e.thrust_remarks],
        bounds=[_bound_row(row) for row in e.judged.to_dict("records")],
        columns=[(name, _display_units(name)) for name in _POINT_COLUMNS if name in e.points],
        points=[_point_row(e, row) for row in e.points.to_dict("records")],
        lines=[_line_section(e, fitted) for fitted in e.lines],
        fits=[_fit_section(fit) for fit in e.fits],
        motions=[_motion_section(name, motion) for name, motion in e.motions.items()],
        files=[name_and_sha256(path) for path in files_of(e.plan)],
        command=command_line(),
        version=version("aeromatch"),
    )


def _display_units(name: str) -> str:
    """Return the unit in which a quantity is displayed."""
    try:
        return lookup(name).display_units
    except UnknownName:
        pass
    if name == "attitude_less_climb":
        return "deg"
    return "1"


def _label_quantity(name: str) -> str:
    """Return a name with its unit."""
    units = _display_units(name)
    if units == "1":
        return name
    return f"{name} [{units}]"


def _relation_row(row: Mapping[Any, Any]) -> dict[str, Any]:
    texts = {}
    for name in ("offset", "rms"):
        texts[f"{name}_text"] = format_display_value(row[name], row["units"])
    return {**row, **texts, "meaningful": is_meaningful(row["moving"], row["correlation"])}


def _bound_row(row: Mapping[Any, Any]) -> dict[str, Any]:
    unit = row["unit"]
    return {
        **row,
        "value_text": format_si_value(row["value"], unit),
        "stderr_text": format_si_value(row["stderr"], unit, 2),
        "unit_text": unit_shown(unit),
        "limits": limits_shown(row["low"], row["high"], unit),
        "inside": row["verdict"] == INSIDE,
    }


def _point_row(e: Evaluation, row: Mapping[Any, Any]) -> dict[str, Any]:
    """Return the means of a stationary point as text; empty if a mean is missing."""
    cells = []
    for name in _POINT_COLUMNS:
        if name not in e.points:
            continue
        cell = ""
        if math.isfinite(row[name]):
            cell = f"{from_si(row[name], _display_units(name)):.4g}"
        cells.append(cell)
    return {"start": row["start"], "stop": row["stop"], "cells": cells}


def _line_section(e: Evaluation, fitted: FittedLine) -> dict[str, Any]:
    """Return title, chart and figures of a line."""
    line = fitted.line
    x_name, x_units = _label_quantity(line.x), _display_units(line.x)
    if line.kind == "polar":
        x_name, x_units = f"{line.x} squared", "1"
    y_units = _display_units(line.y)
    x, y = from_si(fitted.x, x_units), from_si(fitted.y, y_units)
    # the line in display units follows from its two ends
    ends = np.array([fitted.x.min(), fitted.x.max()])
    a, b = from_si(ends, x_units), from_si(fitted.offset[0] + fitted.slope[0] * ends, y_units)
    slope = float((b[1] - b[0]) / (a[1] - a[0]))
    offset = float(b[0] - slope * a[0])
    names = x_name, _label_quantity(line.y)
    return {
        "name": line.name,
        "title": f"{line.y} over {x_name}, {len(x)} points",
        "svg": draw_scatter_chart(x, y, (offset, slope), names, f"{line.y} over {line.x}"),
        "figures": _figure_rows(_figures_of_part(e, line.name)),
    }


def _figure_rows(figures: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return figures (value, standard error, unit) as text."""
    rows = []
    for name, (value, stderr, unit) in figures.items():
        rows.append(
            {
                "name": name,
                "value": format_si_value(value, unit),
                "stderr": format_si_value(stderr, unit, 2),
                "unit": unit_shown(unit),
            }
        )
    return rows


def _fit_section(fit: Fit) -> dict[str, Any]:
    """Return terms, remarks and chart of a fit; only a fit of one window has a chart."""
    attributes = fit.estimates.attrs
    rows = []
    for term in fit.estimates["term"].values:
        estimate = fit.estimates.sel(term=term)
        row: dict[str, Any] = {"term": str(term)}
        for name in _FIT_COLUMNS:
            row[name] = float(estimate[name])
        rows.append(row)
    chart = None
    if attributes["manoeuvres"] == 1:
        measured = fit.data[fit.model.coefficient].values
        chart = draw_time_chart(
            fit.data["time"].values,
            [measured, measured - fit.residual],
            "measured and fitted",
            label=str(fit.model),
        )
    return {
        "name": fit.name,
        "model": str(fit.model),
        "about": f"{attributes['samples']} samples, {attributes['manoeuvres']} windows, "
        f"R² {attributes['R2']:.4f}, residual rms {attributes['residual_rms']:.3g}",
        "rows": rows,
        "remarks": [str(remark) for remark in fit.remarks],
        "svg": chart,
    }


def _motion_section(name: str, motion: Eigenmotion) -> dict[str, Any]:
    """Return figures, remarks and one chart per channel of an eigenmotion."""
    charts = []
    for channel in motion.channels:
        units = _display_units(channel)
        measured = from_si(motion.measured[channel], units)
        fitted = from_si(motion.fitted[channel], units)
        label = f"{channel}, measured and fitted"
        svg = draw_time_chart(motion.time, [measured, fitted], units, label=label)
        charts.append({"title": _label_quantity(channel), "svg": svg})
    return {
        "name": name,
        "kind": motion.kind,
        "share": motion.share,
        "remarks": [str(remark) for remark in motion.remarks],
        "figures": _figure_rows(motion.values),
        "charts": charts,
    }
