"""Functions that perform the commands ``db show`` and ``db history``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from aerodb.store.files import open as open_database
from aerodb.store.files import open_term
from aerodb.store.overview import OVERVIEW, describe_database, leaf_rows, summary_text
from aerodb.store.seal import read_database_seal
from aerodb.store.undo_history import COLUMNS, edit_rows
from flightmech.support.console import print_json, print_table
from flightmech.terms import power_factor


def print_database(file: str, term: str | None, as_json: bool) -> None:
    """Perform the command ``show``."""
    if term is None:
        attributes, rows = _overview(file)
        if as_json:
            print_json({"attributes": attributes, "terms": rows})
        else:
            click.echo(summary_text(attributes, rows))
    elif as_json:
        _term_document(file, term)
    else:
        _print_term(file, term)


def _overview(file: str) -> tuple[Mapping[Any, Any], list[dict[str, Any]]]:
    """Return the root attributes and a row per term, from the overview that a sealed file carries
    where it has one.
    """
    # The overview of a sealed file is read in a tenth of the time that the tables take.
    if found := read_database_seal(Path(file)).overview(OVERVIEW):
        attributes, rows = found
        return attributes, rows
    db = open_database(file)
    return db.attrs, describe_database(db)


def _print_term(file: str, term: str) -> None:
    """Print the numbers of one term."""
    leaf = open_term(file, term)
    head, rows = leaf_rows(leaf)
    print_table(head, rows, title=term, right=head)
    texts = {
        key: leaf.attrs.get(key)
        for key in ("regressors", "decision", "reason", "comment", "references", "history")
    }
    for key, text in {"power": power_factor(leaf), **texts}.items():
        if text:
            click.echo(f"{key}: {text}")


def _term_document(file: str, term: str) -> None:
    # the tables of a term are shown without xarray
    from aerodb.update.posterior import without_posterior

    print_json({"term": term, **without_posterior(open_term(file, term)).to_dict()})


def print_history(file: str, as_json: bool) -> None:
    """Perform the command ``history``."""
    rows = edit_rows(open_database(file))
    if as_json:
        print_json(
            [{"line": line, **dict(zip(COLUMNS, row))} for line, row in enumerate(rows, start=1)]
        )
        return
    print_table(
        ("edit", "what was done"),
        [("" if number is None else number, text) for number, *_, text in rows],
        right=("edit",),
    )
