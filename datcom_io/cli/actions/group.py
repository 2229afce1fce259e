"""Functions that perform the commands of `datcom_io.cli.group`."""

from __future__ import annotations

from typing import Literal

import click

from datcom_io.arrays.frames import printed_units, write_cells, write_tree
from datcom_io.arrays.grid import join
from datcom_io.cli.summary import page_row
from datcom_io.exchange.file_types import read_other
from datcom_io.printout.content import Page
from datcom_io.printout.tables import Printed, PrintedTable
from datcom_io.reading.reader import iterate, read
from flightmech.errors import UnknownName
from flightmech.support import console
from flightmech.support.console import count_text


def show_table(file: str, name: str | None, number: int, partial: bool, as_json: bool) -> None:
    """Perform the command ``table``."""
    case = read(file, partial=partial)[name or 0]
    if not 1 <= number <= len(case.pages):
        raise UnknownName(str(number), [f"1 ... {len(case.pages)}"], f"page of case {case.name!r}")
    page = case.pages[number - 1]
    sheets = [_sheet(item, page) for item in page.printed]
    if as_json:
        tables = []
        for item, (head, body) in zip(page.printed, sheets):
            columns = [heading.split("\n") for heading in head]
            tables.append({"table": item.name, "columns": columns, "rows": body})
        console.print_json(
            {**page_row(page), "tables": tables, "notes": [note.text for note in page.notes]}
        )
        return
    click.echo(f"{' / '.join(page.heading)}  (lines {page.first}-{page.last})")
    if not page.parsed:
        click.echo("tables of this kind of page are not read; see the lines of the file")
    for item, (head, body) in zip(page.printed, sheets):
        console.print_table(
            head,
            body,
            title=f"\n{item.name}, lines {item.lines[0]}-{item.lines[-1]}",
            right=[h for h in head if h != "label"],
        )
    for note in page.notes:
        click.echo(f"line {note.line}: {note.text}")


def _sheet(item: Printed, page: Page) -> tuple[list[str], list[list[str]]]:
    """Return headings and texts of a table or of a group of ``label = value``."""

    if not isinstance(item, PrintedTable):
        units = item.units or ("",) * len(item.labels)
        return ["label", "value", "unit"], [
            list(row) for row in zip(item.labels, item.texts, units)
        ]
    heads = [f"{column.name}\n[{printed_units(column, page)}]" for column in item.columns]
    if item.across is not None:
        heads[1:] = [f"{item.columns[1].name}\n{x:g} deg" for x in item.across]
    body = []
    for i in range(len(item.rows)):
        body.append([item.text(i, k) for k in range(len(item.columns))])
    return heads, body


def convert_listing(
    file: str,
    output: str,
    name: str | None,
    joined: bool,
    partial: bool,
    fill_transonic: bool,
    deriv: Literal["DEG", "RAD"] | None,
    as_json: bool,
) -> None:
    """Perform the command ``convert``."""
    tree = read_other(file, deriv)
    if tree is None:
        listing = read(file, partial=partial)
        if name is not None:
            tree = listing[name].to_datatree(fill_transonic=fill_transonic)
        elif joined:
            tree = join(
                case.to_datatree(fill_transonic=fill_transonic) for case in listing if case.pages
            )
        else:
            tree = listing.to_datatree(fill_transonic=fill_transonic)
    write_tree(tree, output)
    if as_json:
        console.print_json(
            {"file": output, "groups": [node.path for node in tree.subtree if node.data_vars]}
        )
    else:
        click.echo(f"written: {output}")


def run_write_cells(file: str, output: str, name: str | None, partial: bool, as_json: bool) -> None:
    """Perform the command ``cells``."""
    count = write_cells(
        iterate(file, partial=partial) if name is None else [read(file, partial=partial)[name]],
        output,
    )
    if as_json:
        console.print_json({"file": output, "cells": count})
    else:
        click.echo(f"written: {output}, {count_text(count, 'cell')}")
