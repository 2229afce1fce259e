"""Page of a fit: estimates, remarks, and charts of the measured and the fitted outputs."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

import numpy as np
import xarray as xr

from flightmech.names import lookup
from flightmech.support.console import command_line
from flightmech.support.input_files import name_and_sha256
from flightmech.units import from_si
from flighttest.maximum_likelihood.fit_job import FitJobResult, explained_text
from flighttest.reconstruction.quality.page import draw_time_chart, read_style_sheet, template_of

_COLUMNS = ("estimate", "stderr", "stderr_white", "start", "prior_stderr")


def render_fit_page(done: FitJobResult) -> str:
    """Return the HTML page of a fit."""
    e, specification = done.fit.estimates, done.specification
    rows = []
    for k, name in enumerate(e["parameter"].values):
        cells = [_format_cell(float(e[key].values[k])) for key in _COLUMNS]
        rows.append({"name": str(name), "cells": cells, "held": bool(e["active"].values[k])})
    files = [specification.aircraft, specification.database]
    files += [table.file for table in specification.record]
    grade = "warning"
    if e.attrs["converged"] and not done.remarks and not done.fit.warnings:
        grade = "good"
    return template_of("flighttest.maximum_likelihood").render(
        style=read_style_sheet(),
        title=specification.title or "Output error",
        attrs=e.attrs,
        grade=grade,
        rows=rows,
        remarks=[*done.fit.remarks, *done.remarks],
        records=[_record_content(done, k) for k in range(len(done.records))],
        files=[name_and_sha256(path) for path in files],
        command=command_line(),
        version=version("aeromatch"),
    )


def _format_cell(value: float) -> str:
    # An unknown at a bound has no standard error, and most have no prior.
    if not np.isfinite(value):
        return ""
    return f"{value:.4g}"


def _record_content(done: FitJobResult, k: int) -> dict[str, Any]:
    """Return name and charts of one record: outputs, and inputs that move."""
    record, residual = done.records[k], done.fit.residuals[k]
    time = record["time"].values
    charts = []
    for j, name in enumerate(residual.data_vars):
        share = float(done.explained.values[k, j])
        charts.append(_output_chart(record, residual, name=str(name), share=share))
    # Inputs that stay constant have no chart.
    inputs = []
    for name in map(str, record.data_vars):
        values = record[name].values
        if name in done.sim.inputs and np.ptp(values) > 0.0:
            inputs.append({"title": name, "svg": _draw_signals(time, [values], name)})
    return {"name": str(record.attrs["record"]), "charts": charts, "inputs": inputs}


def _output_chart(
    record: xr.Dataset, residual: xr.Dataset, name: str, share: float
) -> dict[str, Any]:
    """Return the chart of a measured output with the fitted one."""
    measured = record[name].values
    fitted = measured - residual[name].values
    words = explained_text(share)
    if np.isfinite(share):
        words = f"{words} explained"
    return {
        "title": f"{name}: {lookup(name).long_name}, {words}",
        "svg": _draw_signals(record["time"].values, [measured, fitted], name),
    }


def _draw_signals(time: np.ndarray, signals: list[np.ndarray], name: str):
    units = lookup(name).display_units
    return draw_time_chart(time, [from_si(signal, units) for signal in signals], units, label=name)
