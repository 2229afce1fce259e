"""``aeromatch pom spread``: how far rows may miss before their flights, and their gradients."""

from __future__ import annotations

import click

from flightmech.support.console import (
    InputFile,
    NewFile,
    jobs_option,
    json_option,
    performed_by,
)
from flighttest.cli.programme import prior_options

_FILE = InputFile()


@click.command("spread")
@click.argument("catalogue_file", metavar="CATALOGUE", type=_FILE)
@prior_options
@click.option(
    "-o",
    "--output",
    type=NewFile(),
    help="File for the gradients, netCDF, for --rows of `aeromatch flight plan`.",
)
@jobs_option
@json_option
@performed_by("pom.cli.actions.spread:run_spread")
def spread_command() -> None:
    """Predict how far the rows of CATALOGUE ([[wanted_row]]) may miss with a database, from its
    standard errors, and the terms that the rows rest on.

    The width of a row is two standard errors of the predicted miss over the tolerance. Each row is
    flown on the a-priori model, and replayed once up and once down for every node of a table that
    it touches.
    """
