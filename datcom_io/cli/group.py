"""``aeromatch datcom``: look into Digital DATCOM listings and convert them."""

from __future__ import annotations

import click

from datcom_io.cli import deck as deck_cli
from datcom_io.cli import exchange as exchange_cli
from flightmech.support import console
from flightmech.support.console import performed_by

_FILE = click.argument("file", type=console.InputFile())
_CASE = click.option(
    "--case", "name", help="Case by its number from 1, its name or a part of the name."
)
_PARTIAL = click.option(
    "--partial", is_flag=True, help="Take what is complete in a listing that is cut."
)


@click.group()
def datcom() -> None:
    """Read Digital DATCOM listings and their neighbours; read, check, split and run decks."""


@datcom.command("show")
@_FILE
@_CASE
@_PARTIAL
@console.json_option
@performed_by("datcom_io.cli.actions.show:print_listing")
def show_listing_command() -> None:
    """Show cases, conditions, tables, missing values and messages of a listing; with --case its
    pages too.

    A plot file, a MAT file of datcomimport or a CSV of DATCOM+ is recognised by its content; its
    groups are shown.
    """


@datcom.command("table")
@_FILE
@_CASE
@click.option(
    "--page",
    "number",
    type=int,
    required=True,
    help="Page of the case, as numbered by `show --case`.",
)
@_PARTIAL
@console.json_option
@performed_by("datcom_io.cli.actions.group:show_table")
def show_table_command() -> None:
    """Print the tables of one page as the listing has them."""


@datcom.command("convert")
@_FILE
@click.option("-o", "--output", required=True, type=console.NewFile(), help="NetCDF file to write.")
@_CASE
@click.option(
    "--join", "joined", is_flag=True, help="Put the cases together along the flight condition."
)
@_PARTIAL
@click.option(
    "--fill-transonic", is_flag=True, help="Fill constant columns on transonic pages too."
)
@click.option(
    "--deriv",
    type=click.Choice(["DEG", "RAD"]),
    help="Card DERIV of the deck, for a CSV of DATCOM+.",
)
@console.json_option
@performed_by("datcom_io.cli.actions.group:convert_listing")
def convert_listing_command() -> None:
    """Write a listing as a netCDF tree in SI and radians: one group per case, or one case, or all
    joined.

    A plot file, a MAT file of datcomimport or a CSV of DATCOM+ is recognised by its content.
    """


@datcom.command("cells")
@_FILE
@click.option("-o", "--output", required=True, type=console.NewFile(), help="CSV file to write.")
@_CASE
@_PARTIAL
@console.json_option
@performed_by("datcom_io.cli.actions.group:run_write_cells")
def write_cells_command() -> None:
    """Write every printed cell of a listing, or of one case, as CSV: line, page, table, axes,
    column, text, value, flag.
    """


for _verb in (*deck_cli.VERBS, *exchange_cli.VERBS):
    datcom.add_command(_verb)
