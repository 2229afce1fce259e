"""A likelihood fit as one HTML page that needs nothing else."""

from __future__ import annotations

import hashlib
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from flightmech.names import lookup
from flightmech.support.console import command_line
from flightmech.units import from_si

from ...quality.page import style, template_of
from ...quality.plots import chart

if TYPE_CHECKING:
    from .result import Performed

_COLUMNS = ("estimate", "stderr", "stderr_white", "start", "prior_stderr")


def page(done: Performed) -> str:
    """Return the page as text."""
    e, specification = done.fit.estimates, done.specification
    rows = [
        {"name": str(name), "cells": [_cell(float(e[key].values[k])) for key in _COLUMNS], "held": bool(e["active"].values[k])}
        for k, name in enumerate(e["parameter"].values)
    ]
    files = [specification.aircraft, specification.database, *(table.file for table in specification.record)]
    return template_of("flighttest.maximum_likelihood.job").render(
        style=style(),
        title=specification.title or "Output error",
        attrs=e.attrs,
        grade="good" if e.attrs["converged"] and not (done.remarks or done.fit.warnings) else "warning",
        rows=rows,
        remarks=[*done.fit.remarks, *done.remarks],
        records=[_record(done, k) for k in range(len(done.records))],
        files=[_file(path) for path in files],
        command=command_line(),
        version=version("aeromatch"),
    )


def _cell(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else ""


def _record(done: Performed, k: int) -> dict[str, Any]:
    record, rest = done.records[k], done.fit.residuals[k]
    charts = [_chart(record, rest, str(name), float(done.explained.values[k, j])) for j, name in enumerate(rest.data_vars)]
    inputs = [str(name) for name in record.data_vars if name in done.sim.inputs and np.ptp(record[name].values) > 0.0]
    moved = [{"title": name, "svg": _drawn(record["time"].values, [record[name].values], name)} for name in inputs]
    return {"name": str(record.attrs["record"]), "charts": charts, "inputs": moved}


def _chart(record: xr.Dataset, rest: xr.Dataset, name: str, share: float) -> dict[str, Any]:
    measured = record[name].values
    svg = _drawn(record["time"].values, [measured, measured - rest[name].values], name)
    return {"title": f"{name}: {lookup(name).long_name}, {share:.1%} explained", "svg": svg}


def _drawn(time: np.ndarray, lines: list[np.ndarray], name: str):
    units = lookup(name).display_units
    return chart(time, [from_si(line, units) for line in lines], units, label=name)


def _file(path: Path) -> dict[str, str]:
    with path.open("rb") as file:
        return {"name": path.name, "sha256": hashlib.file_digest(file, "sha256").hexdigest()}
