"""Function that performs the command of `flighttest.cli.validation`."""

from __future__ import annotations

from pathlib import Path

import click

from flightmech.errors import SchemaError
from flightmech.support.atomic_write import write_text
from flightmech.support.console import print_json, show_progress
from flighttest.cli.actions.manoeuvres import read_sourced_manoeuvres
from flighttest.maximum_likelihood.validating.used_windows import ValidationWindow, digest_record
from flighttest.maximum_likelihood.validating.validation import open_model, validate_models


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
