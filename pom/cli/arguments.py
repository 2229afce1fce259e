"""Arguments that several verbs of ``aeromatch pom`` share: case files, and instrument constants for raw records."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import click

from flightmech.support.console import InputFile

cases_argument = click.argument("cases", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
biases_option = click.option(
    "--biases",
    "biases_file",
    type=InputFile(),
    help="Reconstruction of another record; its instrument constants are the prior where the record of a case is raw.",
)


def samples_options(command: Any) -> Any:
    """Add the options ``--samples`` and ``--seed`` to a command."""
    number = click.IntRange(0)
    command = click.option("--seed", default=0, show_default=True, type=number, help="Seed of the random draws of --samples.")(command)
    return click.option(
        "--samples",
        default=0,
        show_default=True,
        type=number,
        help="Draws from the posterior of database and instruments: probability of a pass, spread of the ratio, which errors make it.",
    )(command)


def read_biases(file: str | None) -> Any:
    """Return the instrument constants of `biases_option`; None without a file."""
    if file is None:
        return None
    from flighttest.reconstruction import open_biases

    return open_biases(file)


def case_files(places: Iterable[Path]) -> list[Path]:
    """Return the case files among files and folders of them."""
    places = list(places)
    found: list[Path] = []
    for place in places:
        found += sorted(place.glob("*.toml")) if place.is_dir() else [place]
    if not found:
        raise click.UsageError(f"no case file (*.toml) in {', '.join(map(str, places))}")
    return found
