"""An evaluation as one HTML page that needs nothing else."""

from __future__ import annotations

import hashlib
import math
import re
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import UnknownName
from flightmech.names import lookup
from flightmech.support.console import command_line, to_json_types
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
from flighttest.regression.equation_error.fit import Fit, save_fit
from flighttest.remarks import Remark, is_forbidden, remarks_to_json
from flighttest.submodels.aircraft_properties.eigenmotion import Motion

_ODD = re.compile(r"[^\w.-]+")  # what no name of a file should hold


@dataclass(frozen=True)
class Evaluation:
    """What `evaluate` found.

    Attributes
    ----------
    plan : Plan
    aircraft : Aircraft
    record : DataTree
        With mass, c.g. and thrust.
    quality : Quality
    paths : dict of str to Path
        ``points``, and one path per manoeuvre and window.
    points : DataFrame
        Means over the stationary points.
    lines : list of Fitted
    fits : list of Fit
    motions : dict of str to Motion
    figures : dict of str to Figure
    judged : DataFrame
        Bounds and verdicts.
    refused : dict of str to str
        What could not be determined, and why.
    """

    plan: EvaluationPlan
    aircraft: Aircraft
    record: xr.DataTree
    quality: Quality
    paths: dict[str, FlightPath]
    points: pd.DataFrame
    lines: list[FittedLine]
    fits: list[Fit]
    motions: dict[str, Motion]
    figures: dict[str, FigureOfMerit]
    judged: pd.DataFrame
    refused: dict[str, str]

    @property
    def passed(self) -> bool:
        """Whether the record is sound, everything was determined, no remark bars a figure, and
        every bound holds.
        """
        return (
            self.quality.usable
            and not self.refused
            and not self.barred
            and bool((self.judged["verdict"] == INSIDE).all())
        )

    @property
    def remarks(self) -> dict[str, list[Remark]]:
        """Remarks on each fit and motion by name."""
        return {fit.name: fit.remarks for fit in self.fits} | {
            name: motion.remarks for name, motion in self.motions.items()
        }

    @property
    def barred(self) -> dict[str, list[Remark]]:
        """Fits and motions whose figures must not be used, with the remarks that state why."""
        return {name: remarks for name, remarks in self.remarks.items() if is_forbidden(remarks)}

    @property
    def verdict(self) -> str:
        """The whole in one line."""
        if not self.quality.usable:
            return f"not evaluated: the record is not fit for it ({self.quality.verdict})"
        count = int((self.judged["verdict"] == INSIDE).sum())
        refused = f"; not determined: {', '.join(self.refused)}" if self.refused else ""
        unusable = f"; not to be used: {', '.join(self.barred)}" if self.barred else ""
        return f"{count} of {len(self.judged)} figures inside their bounds{refused}{unusable}"

    def report(self) -> str:
        """Return quality, fits, motions and bounds as text."""
        return format_evaluation(self)

    def as_dict(self) -> dict[str, Any]:
        """Return everything but the time histories, made of types that JSON knows."""
        figures = {name: figure._asdict() for name, figure in self.figures.items()}
        parts = {
            "title": self.plan.title,
            "verdict": self.verdict,
            "figures": figures,
            "bounds": self.judged,
            "refused": self.refused,
        }
        remarks = {name: remarks_to_json(found) for name, found in self.remarks.items()}
        return to_json_types(
            {**parts, "remarks": remarks, "points": self.points, "quality": self.quality.as_dict()}
        )

    def save(self, folder: str | Path) -> list[Path]:
        """Write record, paths and fits as netCDF files, for the other verbs; return their names."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        files = [folder / "record.nc"]
        save_record(self.record, files[0])
        for name, path in self.paths.items():
            files.append(folder / f"path_{_ODD.sub('_', name)}.nc")
            save_path(path, files[-1])
        for fit in self.fits:
            files.append(folder / f"fit_{fit.name}.nc")
            save_fit(fit, files[-1])
        return files


def format_evaluation(evaluation: Evaluation) -> str:
    """Return consistency, stationary lines, coefficients, eigenmotions and bounds as text."""
    e = evaluation
    lines = [e.plan.title, e.verdict, "", quality_report(e.quality), ""]
    for fitted in e.lines:
        head = f"{fitted.line.name}: {fitted.line.y} over {fitted.line.x}, {len(fitted.x)} points"
        lines += [head, *_figures(e, fitted.line.name), ""]
    for fit in e.fits:
        lines += [fit.report(), ""]
    for name, motion in e.motions.items():
        lines += [f"{name}: {motion.report()}", ""]
    for name, text in e.refused.items():
        lines += [f"! {name} not determined: {text}"]
    lines += ["", "bounds:"]
    for row in e.judged.to_dict("records"):
        symbol = " " if row["verdict"] == "inside" else "!"
        value = (
            f"{format_si_value(row['value'], row['unit'])} "
            f"({format_si_value(row['stderr'], row['unit'], 2)}) "
            f"{unit_shown(row['unit'])}".rstrip()
        )
        limits = limits_shown(row["low"], row["high"], row["unit"])
        lines.append(
            f"{symbol} {row['of']:34s} {value:28s} {limits:24s} {row['verdict']:15s} "
            f"{row['source']}"
        )
    return "\n".join(lines)


def _figures(e: Evaluation, name: str) -> list[str]:
    return [
        f"  {key.rpartition('.')[2]:10s}{format_si_value(f.value, f.unit):>10s} "
        f"({format_si_value(f.stderr, f.unit, 2)}) {unit_shown(f.unit)}".rstrip()
        for key, f in e.figures.items()
        if key.rpartition(".")[0] == name
    ]


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


def render_evaluation_page(evaluation: Evaluation) -> str:
    """Return the page as text."""
    e = evaluation
    return template_of("flighttest.flight_programme.evaluation").render(
        style=read_style_sheet(),
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
    texts = {
        f"{name}_text": format_display_value(row[name], row["units"]) for name in ("offset", "rms")
    }
    return {**row, **texts, "meaningful": is_meaningful(row["moving"], row["correlation"])}


def _bound(row) -> dict[str, Any]:
    unit = row["unit"]
    texts = {
        "value_text": format_si_value(row["value"], unit),
        "stderr_text": format_si_value(row["stderr"], unit, 2),
        "unit_text": unit_shown(unit),
    }
    return {
        **row,
        **texts,
        "limits": limits_shown(row["low"], row["high"], unit),
        "inside": row["verdict"] == INSIDE,
    }


def _point(e: Evaluation, row) -> dict[str, Any]:
    cells = [
        f"{from_si(row[name], _units(name)):.4g}" if math.isfinite(row[name]) else ""
        for name in _SHOWN
        if name in e.points
    ]
    return {"start": row["start"], "stop": row["stop"], "cells": cells}


def _line(e: Evaluation, fitted: FittedLine) -> dict[str, Any]:
    line = fitted.line
    names = (f"{line.x} squared" if line.kind == "polar" else _name(line.x)), _name(line.y)
    x_units, y_units = ("1" if line.kind == "polar" else _units(line.x)), _units(line.y)
    x, y = from_si(fitted.x, x_units), from_si(fitted.y, y_units)
    ends = np.array([fitted.x.min(), fitted.x.max()])
    a, b = from_si(ends, x_units), from_si(fitted.offset[0] + fitted.slope[0] * ends, y_units)
    slope = float((b[1] - b[0]) / (a[1] - a[0]))
    figures = _draw_figures(
        {
            key.rpartition(".")[2]: f
            for key, f in e.figures.items()
            if key.rpartition(".")[0] == line.name
        }
    )
    svg = draw_scatter_chart(
        x, y, (float(b[0] - slope * a[0]), slope), names, f"{line.y} over {line.x}"
    )
    return {
        "name": line.name,
        "title": f"{line.y} over {names[0]}, {len(x)} points",
        "svg": svg,
        "figures": figures,
    }


def _draw_figures(figures: dict[str, Any]) -> list[dict[str, str]]:
    return [
        {
            "name": name,
            "value": format_si_value(value, unit),
            "stderr": format_si_value(stderr, unit, 2),
            "unit": unit_shown(unit),
        }
        for name, (value, stderr, unit) in figures.items()
    ]


def _fit(fit: Fit) -> dict[str, Any]:
    e, a = fit.estimates, fit.estimates.attrs
    columns = ("estimate", "stderr", "stderr_systematic", "vif")
    rows = [
        {"term": str(term), **{name: float(e[name].sel(term=term)) for name in columns}}
        for term in e["term"].values
    ]
    measured, picture = fit.data[fit.model.coefficient].values, None
    if a["manoeuvres"] == 1:
        picture = draw_time_chart(
            fit.data["time"].values,
            [measured, measured - fit.residual],
            "measured and fitted",
            label=str(fit.model),
        )
    about = (
        f"{a['samples']} samples, {a['manoeuvres']} windows, R² {a['R2']:.4f}, residual rms "
        f"{a['residual_rms']:.3g}"
    )
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
        charts.append(
            {
                "title": _name(channel),
                "svg": draw_time_chart(
                    motion.time, lines, units, label=f"{channel}, measured and fitted"
                ),
            }
        )
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
