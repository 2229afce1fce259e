"""Function that performs the command ``datcom show``."""

from __future__ import annotations

from itertools import chain
from typing import Any

import click

from datcom_io.cli.summary import case_summary_rows, page_row
from datcom_io.exchange.file_types import read_other
from datcom_io.listing import Listing
from datcom_io.reading.reader import read
from flightmech.support import console
from flightmech.support.console import count_text


def print_listing(file: str, name: str | None, partial: bool, as_json: bool) -> None:
    """Perform the command ``show``."""
    if (tree := read_other(file, "DEG")) is not None:
        # a listing is shown without xarray
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
            "unread": listing.unread,
        }
        if pages is not None:
            document["pages"] = pages
        console.print_json(document)
        return
    _print_cases(listing, found)
    if pages is not None:
        _print_pages(pages)
    messages = chain.from_iterable(row["messages"] for row in found)
    _print_messages([*messages, *remarks])
    if listing.unread:
        numbers = " ".join(map(str, listing.unread[:20]))
        if len(listing.unread) > 20:
            numbers += " ..."
        click.echo(f"{count_text(len(listing.unread), 'line')} not understood: {numbers}")


def _print_cases(listing: Listing, found: list[dict[str, Any]]) -> None:
    """Print a table of cases."""
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


def _print_pages(pages: list[dict[str, Any]]) -> None:
    """Print a table of the pages of a case."""
    rows = [
        (i, p["kind"], p["configuration"], *_place(p), " ".join(p["tables"]), p["lines"])
        for i, p in enumerate(pages, 1)
    ]
    console.print_table(
        ["page", "kind", "configuration", "Mach", "altitude", "over ground", "tables", "lines"],
        rows,
        right=["page"],
    )


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
