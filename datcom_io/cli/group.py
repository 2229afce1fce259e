"""``aeromatch datcom``: look into Digital DATCOM listings and convert them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from datcom_io.cli import deck as deck_cli
from datcom_io.cli import exchange as exchange_cli
from flightmech.support import console
from flightmech.support.console import performed_by

if TYPE_CHECKING:
    pass

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
def show_listing_command(file: str, name: str | None, partial: bool, as_json: bool) -> None:
    """Show cases, conditions, tables, missing values and messages of a listing; with --case its
    pages too.

    A plot file, a MAT file of datcomimport or a CSV of DATCOM+ is recognised by its content; its
    groups are shown.
    """
    from datcom_io.cli.summary import case_summary_rows, count_text, page_row
    from datcom_io.exchange.file_types import read_other
    from datcom_io.reading.reader import read

    if (tree := read_other(file, "DEG")) is not None:
        from datcom_io.cli.actions.exchange import show_tree

        show_tree(tree, as_json)
        return
    listing = read(file, partial=partial)
    found = case_summary_rows(listing)
    pages = None
    if name is not None:
        case = listing[name]
        found = [row for row in found if row["ordinal"] == case.ordinal]
        pages = [page_row(page) for page in case.pages]
    remarks = [message._asdict() for message in listing.own_messages]
    if as_json:
        document = {
            "file": listing.file,
            "runs": listing.runs,
            "lines": listing.line_count,
            "cases": found,
            "messages": remarks,
        }
        console.print_json(
            {
                **document,
                "unread": listing.unread,
                **({"pages": pages} if pages is not None else {}),
            }
        )
        return
    console.print_table(
        [
            "no",
            "case",
            "units",
            "Mach",
            "altitude",
            "alpha [deg]",
            "tables",
            "not read",
            "missing, suspect",
        ],
        [_summary_row(row) for row in found],
        title=f"{listing.file}: {count_text(listing.runs, 'run')}, "
        f"{count_text(len(listing), 'case')}, "
        f"{count_text(listing.line_count, 'line')}",
        right=["no"],
    )
    if pages is not None:
        rows = [
            (i, p["kind"], p["configuration"], *_place(p), " ".join(p["tables"]), p["lines"])
            for i, p in enumerate(pages, 1)
        ]
        console.print_table(
            ["page", "kind", "configuration", "Mach", "altitude", "over ground", "tables", "lines"],
            rows,
            right=["page"],
        )
    _print_messages([message for row in found for message in row["messages"]] + remarks)
    if listing.unread:
        numbers = " ".join(map(str, listing.unread[:20])) + (
            " ..." if len(listing.unread) > 20 else ""
        )
        click.echo(f"{count_text(len(listing.unread), 'line')} not understood: {numbers}")


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


def _range(values: list[float], unit: str = "") -> str:
    if not values:
        return ""
    low, high = min(values), max(values)
    span = f"{low:g}" if low == high else f"{low:g} ... {high:g}"
    return f"{span} {unit}".strip() + (f" ({len(values)})" if len(values) > 1 else "")


def _summary_row(row: dict[str, Any]) -> tuple[Any, ...]:
    tables = " ".join(f"{name} {count}" for name, count in row["tables"].items())
    not_read = " ".join(f"{name} {count}" for name, count in row["not_read"].items())
    missing = " ".join(
        f"{name} {count}"
        for name, count in {**row["missing"], "suspect": row["suspect"]}.items()
        if count
    )
    alpha = " ... ".join(f"{x:g}" for x in row["alpha"])
    units = f"{row['dim']}, {row['deriv']}"
    return (
        row["ordinal"],
        row["case"],
        units,
        _range(row["mach"]),
        _range(row["altitude"], row["dim"].lower()),
        alpha,
        tables,
        not_read,
        missing,
    )


def _place(page: dict[str, Any]) -> tuple[str, str, str]:
    height = (
        "free air" if page["ground_height"] == float("inf") else f"{page['ground_height']:g} ft"
    )
    flap = "" if page["flap"] != page["flap"] else f", flap {page['flap']:g} deg"
    known = page["mach"] == page["mach"]
    return (f"{page['mach']:g}", f"{page['altitude']:g}", height + flap) if known else ("", "", "")


def _print_messages(messages: list[dict[str, Any]]) -> None:
    """Print messages, repeated ones once."""
    lines: dict[tuple[str, str], list[int]] = {}
    for message in messages:
        lines.setdefault((message["origin"], message["text"]), []).append(message["line"])
    for (origin, text), at in lines.items():
        more = f" and {len(at) - 1} more" if len(at) > 1 else ""
        click.echo(f"line {at[0]}{more} ({origin}): {text}")


for _verb in (*deck_cli.VERBS, *exchange_cli.VERBS):
    datcom.add_command(_verb)
