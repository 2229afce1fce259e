"""``aeromatch pom tolerances``: editions of tolerance tables listed, checked, compared."""

from __future__ import annotations

import click

from flightmech.support.console import InputFile, NewFile, json_option, performed_by


@click.command("tolerances")
@click.argument("files", nargs=-1, type=InputFile())
@click.option(
    "--compare",
    "compared",
    nargs=2,
    metavar="OLD NEW",
    help="Two editions, each by words of its name, such as 'A2A 2014' or 'company.csv': rows that "
    "differ.",
)
@click.option("--write", "copy", type=NewFile(), help="File for a copy of the shipped table.")
@json_option
@performed_by("pom.cli.actions.tolerances:list_tolerances")
def list_tolerances_command() -> None:
    """Check tolerance tables (FILES with the columns of the shipped one), and list or compare the
    editions of the shipped table and of FILES.

    What is wrong with a table is reported row by row, all at once.
    """
