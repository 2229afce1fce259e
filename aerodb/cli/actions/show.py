"""Functions that perform the commands ``db show`` and ``db history``, without xarray."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from aerodb.store.files import list_edits, list_terms, read_overview
from aerodb.store.files import open as open_database
from aerodb.store.overview import OVERVIEW, leaf_rows, summary_text
from aerodb.store.schema import find_leaf
from aerodb.store.seal import read_database_seal
from aerodb.store.undo_history import COLUMNS
from flightmech.errors import UnknownName
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


def _overview(file: str) -> tuple[Mapping[str, Any], list[dict[str, Any]]]:
    """Return the root attributes and a row per term, from the overview that a sealed file carries
    where it has one.
    """
    whole = read_database_seal(Path(file))
    if found := whole.overview(OVERVIEW):
        attributes, rows = found
        return attributes, rows
    return list_terms(file, whole)


def _print_term(file: str, term: str) -> None:
    """Print the numbers of one term."""
    _, leaves = read_overview(file, ["value"], names=[term])
    if term not in leaves:
        raise UnknownName(term, read_overview(file, ["value"])[1], "term")
    leaf = leaves[term]
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

    print_json({"term": term, **without_posterior(find_leaf(open_database(file), term)).to_dict()})


def print_history(file: str, as_json: bool) -> None:
    """Perform the command ``history``."""
    rows = list_edits(file)
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
