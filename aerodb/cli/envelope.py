"""The verb ``envelope`` of ``aeromatch db``."""

from __future__ import annotations

import click

from flightmech.support.console import InputFile, NewFile, json_option, performed_by


@click.command("envelope")
@click.argument("database", metavar="DB", type=InputFile())
@click.option(
    "-o", "--output", type=NewFile(), help="The maps as a figure (.svg) or cell by cell (.csv, SI)."
)
@json_option
@performed_by("aerodb.cli.actions.envelope:run_envelope")
def envelope_command() -> None:
    """Show where flights support DB: a map of every flown configuration, in Mach number and in
    sideslip over the angle of attack.

    The regions are flown, between flown points, a-priori and extrapolated.
    """
