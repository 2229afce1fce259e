"""A fit with what it was made from, and its text."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import aerodb
from aerodb.store.schema import terms
from flightmech.errors import UnknownName
from flightmech.names import COEFFICIENTS, lookup
from flightmech.simulation.compiler import SimModel, compile_files
from flightmech.support.console import command_line, to_json_types
from flightmech.units import from_si
from flighttest.maximum_likelihood.result import OutputError
from flighttest.maximum_likelihood.specification import Specification
from flighttest.maximum_likelihood.time_domain import output_error, uniform_step
from flighttest.reconstruction.dynamics.force_coefficients import select_time
from flighttest.reconstruction.dynamics.saved_paths import open_states
from flighttest.reconstruction.quality.assessment import report_faults
from flighttest.reconstruction.quality.page import draw_time_chart, read_style_sheet, template_of
from flighttest.remarks import Remark, remark_lines, remarks_to_json

_PART = re.compile(r"^(term|table|offset|node)\.(\w+)\.(\w+)(?:\[([\d,\s]+)\])?$")
_ORDER = (
    "node",
    "table",
    "offset",
    "term",
    "bias",
)  # as the kernel takes them: (node * table + offset) * term + bias
_FLIGHT = 1  # flag of `source`


def updated_database(db: xr.DataTree, fit: OutputError) -> tuple[xr.DataTree, list[str]]:
    """Return a database with the estimates of a fit in it, and the parameters that have no place
    there.

    ``term.*`` and ``table.*`` multiply a table, ``offset.*`` is added to it, ``node.*`` takes the
    place of a node, and ``bias.CL`` ... is added to the basic term of its coefficient.  Of a table
    that is scaled only the estimates' errors remain: its a-priori error went into the scale.

    Parameters
    ----------
    db : DataTree
        The one the model of the fit was compiled from; it is left as it is.
    fit : OutputError

    Returns
    -------
    DataTree
        With history, standard errors and ``source`` flight where something was changed.
    list of str
        Starts, instruments, masses, constants of submodels, and what belongs to one manoeuvre
        alone.

    Raises
    ------
    UnknownName
        A term that the database does not have.
    """

    known, e = terms(db), fit.estimates
    errors = {
        str(name): float(x)
        for name, x in zip(e["parameter"].values, np.nan_to_num(e["stderr"].values))
    }
    leaves: dict[str, xr.Dataset] = {}
    left = [str(name) for name in e["parameter"].values if str(name) not in fit.parameters]
    for name, value in sorted(fit.parameters.items(), key=lambda item: _rank(item[0])):
        place = _place(name)
        if place is None:
            left.append(name)
            continue
        kind, term, index = place
        if term not in known:
            raise UnknownName(term, known, "term")
        leaf = leaves.get(term, known[term])
        if kind in ("table", "term") and term not in leaves:
            leaf = leaf.drop_vars("stderr", errors="ignore")
        leaves[term] = _changed(leaf, kind, index, value, errors[name])
    note = f"{e.attrs['method']}, {e.attrs['manoeuvres']} manoeuvres"
    return aerodb.replace_terms(db, leaves, note=note) if leaves else db, left


def _rank(name: str) -> int:
    kind = name.partition(".")[0]
    return _ORDER.index(kind) if kind in _ORDER else len(_ORDER)


def _place(name: str) -> tuple[str, str, tuple[int, ...]] | None:
    """Return kind, term and indices of a parameter of the database, None of any other."""
    match = _PART.match(name)
    if match:
        kind, coefficient, contribution, index = match.groups()
        return (
            kind,
            f"{coefficient}/{contribution}",
            tuple(int(k) for k in index.split(",")) if index else (),
        )
    kind, _, coefficient = name.partition(".")
    return (
        ("bias", f"{coefficient}/basic", ())
        if kind == "bias" and coefficient in COEFFICIENTS
        else None
    )


def _changed(
    leaf: xr.Dataset, kind: str, index: tuple[int, ...], value: float, stderr: float
) -> xr.Dataset:
    """Return a leaf with one estimate in it."""
    table = leaf["value"].values.astype(float)
    before = leaf["stderr"].values.astype(float) if "stderr" in leaf else np.zeros_like(table)
    moved = np.ones(table.shape, bool)
    if kind in ("term", "table"):
        table, error = value * table, np.hypot(table * stderr, value * before)
    elif kind == "node":
        moved = np.zeros(table.shape, bool)
        moved[index] = True
        table, error = np.where(moved, value, table), np.where(moved, stderr, before)
    else:
        table, error = table + value, np.hypot(before, stderr)
    found = leaf.assign(
        value=leaf["value"].copy(data=table),
        stderr=leaf["value"].copy(data=error).assign_attrs(leaf["value"].attrs),
    )
    if "source" in leaf:
        found["source"] = leaf["source"].copy(
            data=np.where(moved, _FLIGHT, leaf["source"].values).astype(leaf["source"].dtype)
        )
    return found


POOR = 0.5  # of the variance of an output about its mean, that the model must explain
PULLED = 3.0  # prior standard errors by which an estimate may depart before it is reported


@dataclass(frozen=True)
class FitJobResult:
    """A fit with what it was made from.

    Attributes
    ----------
    specification : Specification
    sim : SimModel
    records : tuple of Dataset
        The manoeuvres.
    fit : OutputError
    """

    specification: Specification
    sim: SimModel
    records: tuple[xr.Dataset, ...]
    fit: OutputError

    @property
    def explained(self) -> xr.DataArray:
        """Part of the variance of each output about its mean that the model explains, (manoeuvre,
        output).
        """
        rows = [
            [
                1.0
                - float((rest[name] ** 2).sum() / ((record[name] - record[name].mean()) ** 2).sum())
                for name in rest.data_vars
            ]
            for record, rest in zip(self.records, self.fit.residuals)
        ]
        names = list(self.fit.residuals[0].data_vars)
        return xr.DataArray(
            np.array(rows),
            {"manoeuvre": np.arange(1, len(rows) + 1), "output": names},
            ("manoeuvre", "output"),
        )

    @property
    def remarks(self) -> list[Remark]:
        """Remarks beyond `OutputError.remarks`: outputs that the model does not explain, estimates
        far from what was known.
        """
        found = []
        for (k, j), share in np.ndenumerate(self.explained.values):
            if share < POOR:
                name = self.explained["output"].values[j]
                words = (
                    f"record {k + 1}, {name}: the model explains {share:.0%} of its "
                    f"movement; a term is missing, or the record is wrong"
                )
                found.append(Remark("unexplained", words, str(name), float(share), POOR))
        e = self.fit.estimates
        for name, value, start, sigma in zip(
            *(e[key].values for key in ("parameter", "estimate", "start", "prior_stderr"))
        ):
            if abs(value - start) > PULLED * sigma:
                far = float(abs(value - start) / sigma)
                words = (
                    f"{name} lies {far:.1f} prior standard errors from {start:g}: check "
                    f"units, signs and model"
                )
                found.append(Remark("prior", words, str(name), far, PULLED))
        return found

    def report(self) -> str:
        """Return estimates, noise, shares and remarks as text."""
        head = [self.specification.title] if self.specification.title else []
        text = [*head, self.fit.report(), "", "explained of each output's movement:"]
        width = max(len(name) for name in self.explained["output"].values)
        for name in self.explained["output"].values:
            text.append(
                f"  {name!s:{width}s}"
                + "".join(f"{float(x):9.1%}" for x in self.explained.sel(output=name))
            )
        return "\n".join([*text, *remark_lines(self.remarks)])

    def as_dict(self) -> dict[str, Any]:
        """Return estimates and remarks, made of types that JSON knows."""
        e = self.fit.estimates
        columns = [str(name) for name, x in e.data_vars.items() if x.dims == ("parameter",)]
        rows = {
            str(name): {key: e[key].values[k] for key in columns}
            for k, name in enumerate(e["parameter"].values)
        }
        noise = {
            str(name): self.fit.noise["stderr"].sel(output=name).values
            for name in self.fit.noise["output"].values
        }
        about = {"title": self.specification.title, **e.attrs, "parameters": rows, "noise": noise}
        explained = {
            str(name): self.explained.sel(output=name).values
            for name in self.explained["output"].values
        }
        return to_json_types(
            {
                **about,
                "explained": explained,
                "covariance": e["covariance"].values,
                "remarks": remarks_to_json([*self.fit.remarks, *self.remarks]),
            }
        )

    def write_database(self, path: str | Path) -> list[str]:
        """Write the database with the estimates in it; return the parameters that have no place
        there.
        """

        db, left = updated_database(aerodb.open(self.specification.database), self.fit)
        aerodb.save(db, path)
        return left


_COLUMNS = ("estimate", "stderr", "stderr_white", "start", "prior_stderr")


def render_fit_page(done: FitJobResult) -> str:
    """Return the page as text."""
    e, specification = done.fit.estimates, done.specification
    rows = [
        {
            "name": str(name),
            "cells": [_cell(float(e[key].values[k])) for key in _COLUMNS],
            "held": bool(e["active"].values[k]),
        }
        for k, name in enumerate(e["parameter"].values)
    ]
    files = [
        specification.aircraft,
        specification.database,
        *(table.file for table in specification.record),
    ]
    return template_of("flighttest.maximum_likelihood").render(
        style=read_style_sheet(),
        title=specification.title or "Output error",
        attrs=e.attrs,
        grade="good"
        if e.attrs["converged"] and not (done.remarks or done.fit.warnings)
        else "warning",
        rows=rows,
        remarks=[*done.fit.remarks, *done.remarks],
        records=[_record(done, k) for k in range(len(done.records))],
        files=[_file(path) for path in files],
        command=command_line(),
        version=version("aeromatch"),
    )


def _cell(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else ""


def _record(done: FitJobResult, k: int) -> dict[str, Any]:
    record, rest = done.records[k], done.fit.residuals[k]
    charts = [
        _chart(record, rest, str(name), float(done.explained.values[k, j]))
        for j, name in enumerate(rest.data_vars)
    ]
    inputs = [
        str(name)
        for name in record.data_vars
        if name in done.sim.inputs and np.ptp(record[name].values) > 0.0
    ]
    moved = [
        {"title": name, "svg": _drawn(record["time"].values, [record[name].values], name)}
        for name in inputs
    ]
    return {"name": str(record.attrs["record"]), "charts": charts, "inputs": moved}


def _chart(record: xr.Dataset, rest: xr.Dataset, name: str, share: float) -> dict[str, Any]:
    measured = record[name].values
    svg = _drawn(record["time"].values, [measured, measured - rest[name].values], name)
    return {
        "title": f"{name}: {lookup(name).long_name}, {share:.1%} explained",
        "svg": svg,
    }


def _drawn(time: np.ndarray, lines: list[np.ndarray], name: str):
    units = lookup(name).display_units
    return draw_time_chart(time, [from_si(line, units) for line in lines], units, label=name)


def _file(path: Path) -> dict[str, str]:
    with path.open("rb") as file:
        return {"name": path.name, "sha256": hashlib.file_digest(file, "sha256").hexdigest()}


def perform_fit_job(specification: Specification) -> FitJobResult:
    """Make an output-error fit.

    Parameters
    ----------
    specification : Specification

    Returns
    -------
    Performed

    Raises
    ------
    SchemaError
        Records whose signs, units or axes are wrong, by name; unknowns without a start.
    ParseError, UnknownName, OutOfRange, IdentificationError
        As `output_error`, and for files and windows.

    Warns
    -----
    AeromatchWarning
        Records without excitation, inputs that move together.
    """
    sim = compile_files(str(specification.aircraft), str(specification.database))
    records = []
    for table in specification.record:
        states = open_states(table.file)
        records.append(
            (select_time(states, *table.window) if table.window else states).assign_attrs(
                record=table.file.stem
            )
        )
        uniform_step(records[-1]["time"].values.astype(float), table.file.name)
    report_faults(records, [table.file.name for table in specification.record])
    unknowns, held = specification.unknowns(sim), specification.held(sim)
    fit = output_error(
        sim,
        records,
        unknowns,
        specification.outputs,
        held,
        specification.noise,
        iterations=specification.iterations,
    )
    return FitJobResult(specification, sim, tuple(records), fit)
