"""Fits on the terminal and in JSON, and their validation on records that they did not use."""

from __future__ import annotations

import math
from pathlib import Path

import click

from flightmech.errors import SchemaError
from flightmech.support.atomic_write import write_text
from flightmech.support.console import print_json, print_table, show_progress
from flighttest.cli.actions.manoeuvres import ManoeuvreOptions
from flighttest.maximum_likelihood.validating.validation import open_model, validate_models
from flighttest.parameter_constraints import constraints_to_json
from flighttest.regression.equation_error.fit import (
    constraint_lines,
    correlation_lines,
    slope_test_lines,
)
from flighttest.remarks import remark_lines, remarks_to_json


def fit_fields(fit) -> dict:
    """Return a fit as a document."""
    return {
        "model": str(fit.model),
        **constraints_to_json(fit.estimates.attrs),
        **estimate_fields(fit.estimates),
        "remarks": remarks_to_json(fit.remarks),
    }


def estimate_fields(e) -> dict:
    """Return the estimates by term, and their covariance, for a document."""
    columns = [str(name) for name, item in e.data_vars.items() if item.dims == ("term",)]
    terms = {}
    for k, term in enumerate(e["term"].values):
        terms[str(term)] = {name: float(e[name].values[k]) for name in columns}
    return {"terms": terms, "covariance": e["covariance"].values}


def print_fit(fit, remarks, correlation: bool) -> None:
    """Print the estimates of a fit as a table, its remarks, and on request the correlations."""
    e = fit.estimates
    headings = {
        "estimate": "estimate",
        "stderr": "std error",
        "low": "95 % low",
        "high": "high",
        "stderr_white": "if white",
    }
    if "least_squares" in e:
        headings["least_squares"] = "least squares"
    headings |= {"stderr_systematic": "systematic", "t": "t", "p_value": "p", "vif": "VIF"}
    rows = []
    for term in e["term"].values:
        cells = [_cell(float(e[name].sel(term=term))) for name in headings]
        rows.append((str(term), *cells))
    title = (
        f"{fit.model}   {e.attrs['samples']} samples, R2 {e.attrs['R2']:.4f}, residual rms "
        f"{e.attrs['residual_rms']:.3g}"
    )
    if e.attrs["domain"] == "frequency":
        title += f", {e.attrs['frequencies']} frequencies in {e.attrs['band']} Hz"
    print_table(["term", *headings.values()], rows, title, right=list(headings.values()))
    for line in [
        *slope_test_lines(e.attrs),
        *constraint_lines(e.attrs),
        *(correlation_lines(e) if correlation else []),
        *remark_lines(remarks),
    ]:
        click.echo(line)


def _cell(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.4g}"


def run_validate(
    models: tuple[str, ...],
    paths: tuple[str, ...],
    aircraft_file: str,
    windows: tuple[tuple[float, float], ...],
    own_windows: tuple[tuple[str, float, float], ...],
    cutoff: float | None,
    output: str | None,
    as_json: bool,
) -> None:
    """Perform the command ``validate``."""
    names = [Path(file).stem for file in models]
    if repeated := sorted({name for name in names if names.count(name) > 1}):
        raise SchemaError(
            "models", [f"several files are named {', '.join(repeated)}; give each another name"]
        )
    opened = {name: open_model(file) for name, file in zip(names, models, strict=True)}
    source = ManoeuvreOptions(paths, aircraft_file, windows, cutoff, own_windows=own_windows)
    records = source.read().as_validation_windows()
    with show_progress(f"predict {len(records)} windows by {len(opened)} models"):
        board = validate_models(opened, records)
    if output:
        write_text(output, board.rows.to_csv(index=False))
    if as_json:
        print_json({**board.as_dict(), "file": output})
        return
    click.echo(board.report())
    if output:
        click.echo(f"written: {output}")
