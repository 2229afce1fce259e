"""Verbs for other programs' files: ``export plot``."""

from __future__ import annotations

import click

from flightmech.support import console
from flightmech.support.console import performed_by


@click.command("export")
@click.argument("file", type=console.InputFile())
@click.option("-o", "--output", required=True, type=console.NewFile(), help="MAT file to write.")
@click.option(
    "--zero", is_flag=True, help="Zeros instead of NaN where the program prints no number."
)
@click.option("--partial", is_flag=True, help="Take what is complete in a listing that is cut.")
@console.json_option
@performed_by("datcom_io.cli.actions.exchange:export_listing")
def export_listing_command() -> None:
    """Write a listing as the structure of MATLAB's datcomimport; report what it has no place
    for.
    """


@click.command("plot")
@click.argument("file", type=console.InputFile())
@click.option(
    "--listing",
    type=console.InputFile(),
    help="Print file of the same run: check the numbers against it.",
)
@click.option(
    "-o",
    "--output",
    type=console.NewFile(),
    help="NetCDF file to write: the listing's tree with the finer digits.",
)
@console.json_option
@performed_by("datcom_io.cli.actions.exchange:plot_file")
def plot_file_command() -> None:
    """Show what a plot file (unit 13 or 14) holds; with --listing take its five digits into the
    listing's tree.
    """


VERBS = (export_listing_command, plot_file_command)
