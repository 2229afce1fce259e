"""The verb ``aeromatch flight validate``: models on records that none of them has used."""

from __future__ import annotations

import click

from flightmech.support.console import InputFile, NewFile, json_option, performed_by


@click.command("validate")
@click.argument("models", nargs=-1, required=True, type=InputFile())
@click.option(
    "--path",
    "paths",
    multiple=True,
    required=True,
    type=InputFile(),
    help="Reconstructed record that is predicted; may be repeated.",
)
@click.option(
    "--aircraft", "aircraft_file", required=True, type=InputFile(), help="Aircraft, TOML."
)
@click.option(
    "--window",
    "windows",
    type=(float, float),
    multiple=True,
    help="Start and stop [s]; each is predicted by itself. Default: all.",
)
@click.option(
    "--window-of",
    "own_windows",
    type=(str, float, float),
    multiple=True,
    metavar="PATH START STOP",
    help="Window of one path alone, named by its file without extension.",
)
@click.option(
    "--cutoff",
    type=click.FloatRange(0.0, min_open=True),
    help="Low-pass all states alike first [Hz], as for the fits.",
)
@click.option("-o", "--output", type=NewFile(), help="Write the rows to this CSV file.")
@json_option
@performed_by("flighttest.cli.actions.fit_output:run_validate")
def validate_command() -> None:
    """Compare MODELS, files of identify, select and fit-linear, by their predictions of records
    that they have not used: R2, Theil's coefficient and rms for each channel, window and model.
    """
