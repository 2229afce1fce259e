"""Fits on the terminal and in JSON, and their validation on records that they did not use."""

from __future__ import annotations

from pathlib import Path

import click

from flightmech.errors import SchemaError
from flightmech.support.atomic_write import write_text
from flightmech.support.console import print_json, print_table, show_progress
from flighttest.cli.actions.manoeuvres import read_sourced_manoeuvres
from flighttest.maximum_likelihood.validating.used_windows import ValidationWindow, digest_record
from flighttest.maximum_likelihood.validating.validation import open_model, validate_models
from flighttest.parameter_constraints import constraints_to_json
from flighttest.regression.equation_error.fit import (
    constraint_lines,
    correlation_lines,
    slope_test_lines,
)
from flighttest.remarks import remark_lines, remarks_to_json


def fit_fields(fit) -> dict:
    """A fit as a document."""
    return {
        "model": str(fit.model),
        **constraints_to_json(fit.estimates.attrs),
        **estimate_fields(fit.estimates),
        "remarks": remarks_to_json(fit.remarks),
    }


def estimate_fields(e) -> dict:
    """Estimates by term, and their covariance."""
    columns = [str(name) for name, item in e.data_vars.items() if item.dims == ("term",)]
    terms = {
        str(term): {name: float(e[name].values[k]) for name in columns}
        for k, term in enumerate(e["term"].values)
    }
    return {"terms": terms, "covariance": e["covariance"].values}


def print_fit(fit, remarks, correlation: bool) -> None:
    """Print the estimates of a fit as a table, its remarks, and on request the correlations."""
    e = fit.estimates
    shown = {
        "estimate": "estimate",
        "stderr": "std error",
        "low": "95 % low",
        "high": "high",
        "stderr_white": "if white",
    }
    if "least_squares" in e:
        shown["least_squares"] = "least squares"
    shown |= {"stderr_systematic": "systematic", "t": "t", "p_value": "p", "vif": "VIF"}
    rows = [
        (str(term), *(_cell(float(e[name].sel(term=term))) for name in shown))
        for term in e["term"].values
    ]
    title = (
        f"{fit.model}   {e.attrs['samples']} samples, R2 {e.attrs['R2']:.4f}, residual rms "
        f"{e.attrs['residual_rms']:.3g}"
    )
    if e.attrs["domain"] == "frequency":
        title += f", {e.attrs['frequencies']} frequencies in {e.attrs['band']} Hz"
    print_table(["term", *shown.values()], rows, title, right=list(shown.values()))
    for line in [
        *slope_test_lines(e.attrs),
        *constraint_lines(e.attrs),
        *(correlation_lines(e) if correlation else []),
        *remark_lines(remarks),
    ]:
        click.echo(line)


def _cell(value: float) -> str:
    return "-" if value != value else f"{value:.4g}"


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
    found, sources = read_sourced_manoeuvres(paths, aircraft_file, windows, cutoff, own_windows)
    digests = [digest_record(path) for path in paths]
    pieces = []
    for data, number in zip(found, sources, strict=True):
        pieces.append(ValidationWindow(Path(paths[number]).stem, data, digests[number]))
    with show_progress(f"predict {len(pieces)} windows by {len(opened)} models"):
        board = validate_models(opened, pieces)
    if output:
        write_text(output, board.rows.to_csv(index=False))
    if as_json:
        print_json({**board.as_dict(), "file": output})
        return
    click.echo(board.report())
    if output:
        click.echo(f"written: {output}")
