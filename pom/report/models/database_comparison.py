"""Comparison of two or more databases, term by term, for page and paper.

LR-743 compares its Figs. 1 to 4 with Figs. 12 to 15 in this way.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import aerodb
from aerodb.store.overview import ORIGIN
from flightmech import terms
from flightmech.names import COEFFICIENTS
from flightmech.support.figures import make_svg_figure
from pom.report.models.term_figures import FLIGHT, is_same_leaf, term_figures
from pom.report.presentation.quantities import (
    MISSING,
    fixed_decimals,
    format_number,
    symbol_parts,
)
from pom.report.presentation.term_words import term_words

# These terms are always drawn, since the others cannot be assessed without them.
_ALWAYS = ("CL/basic", "CD/basic", "Cm/basic")

# Height of the terms of a page, and of the heading and the sources of a term. [px]
MOST_HEIGHT, TERM_HEIGHT = 4300.0, 110.0
# Figures are 720 units wide and at most 880 px; margin above and below. [px]
FIGURE_SCALE, FIGURE_MARGIN = 880.0 / 720.0, 16.0


def models_page(found: Mapping[str, Any]) -> dict[str, Any]:
    """Return the data of the template ``models.html``.

    Parameters
    ----------
    found : mapping
        Result of `compare_for_report`.

    Returns
    -------
    dict
        The same data with the figures as SVG text, and the ``parts``: pages of terms, each with
        ``id``, ``title`` and ``terms``.
    """
    parts: list[dict[str, Any]] = []
    for coefficient, terms_of_part in _group_terms(found["terms"]):
        for number, page in enumerate(_split_by_height(terms_of_part), 1):
            parts.append(
                {
                    # A page can be a file, and names of files that differ in case only, as those
                    # of CL and Cl, are equal on some systems.  The number keeps them apart.
                    "id": f"models-{len(parts) + 1}-{coefficient.replace('_', '-')}",
                    "title": f"{coefficient}, continued" if number > 1 else coefficient,
                    "terms": [_with_svg(term) for term in page],
                }
            )
    return {**found, "parts": parts}


def _with_svg(term: Mapping[str, Any]) -> dict[str, Any]:
    figures = [make_svg_figure(p.height, p.body, p.words) for p in term["figures"]]
    return {**term, "figures": figures}


def _group_terms(terms_of_page: Sequence[Mapping[str, Any]]) -> list[tuple[str, list[Any]]]:
    """Return the terms of every coefficient, in their order."""
    groups: dict[str, list[Any]] = {}
    for term in terms_of_page:
        groups.setdefault(term["term"].partition("/")[0], []).append(term)
    return list(groups.items())


def _split_by_height(terms_of_part: Sequence[Mapping[str, Any]]) -> list[list[Any]]:
    """Return the terms of every page, which is at most `MOST_HEIGHT` high.

    A single term that is higher has a page of its own.
    """
    pages: list[list[Any]] = []
    room = 0.0
    for term in terms_of_part:
        need = TERM_HEIGHT
        for figure in term["figures"]:
            need += FIGURE_SCALE * figure.height + FIGURE_MARGIN
        if not pages or need > room:
            pages.append([])
            room = MOST_HEIGHT
        pages[-1].append(term)
        room -= need
    return pages


def compare_for_report(
    databases: Mapping[str, xr.DataTree],
    support: Mapping[str, pd.DataFrame],
    styles: Mapping[str, str],
) -> dict[str, Any]:
    """Return the comparison of databases, as page and paper show it.

    Parameters
    ----------
    databases : mapping of str to DataTree
        Name to database, the prior first.
    support : mapping of str to DataFrame
        Term to the points of the flight records that support it.  The columns are named after the
        axes of the term. [SI]
    styles : mapping of str to str
        Database name to the class of its line.

    Returns
    -------
    dict
        ``terms`` with their figures, ``changes``, terms that are the ``same``, ``databases`` with
        title and source, and ``styles``.
    """
    leaves = {name: aerodb.terms(db) for name, db in databases.items()}
    # A dictionary keeps the order of terms that sort as equal; a set would not.
    all_terms: dict[str, None] = {}
    for database_terms in leaves.values():
        all_terms |= dict.fromkeys(database_terms)
    content, same = [], []
    for term in sorted(all_terms, key=_term_order):
        holders = _databases_with(term, leaves)
        changed = len(holders) < len(leaves) or not is_same_leaf(list(holders.values()))
        if changed or term in _ALWAYS:
            state = _term_state(holders, list(leaves), changed)
            figures = term_figures(term, holders, support=support.get(term), styles=styles)
            content.append({**_term_content(term, holders, state), "figures": figures})
        else:
            leaf = next(iter(holders.values()))
            same.append({"term": term, "words": term_words(term), "leaf": _leaf_facts(leaf)})
    roots = [_root_facts(name, db, len(leaves[name])) for name, db in databases.items()]
    return {
        "terms": content,
        "changes": _list_changes(databases, content),
        "same": same,
        "databases": roots,
        "styles": styles,
    }


def _databases_with(
    term: str, leaves: Mapping[str, Mapping[str, xr.Dataset]]
) -> dict[str, xr.Dataset]:
    """Return the leaves of a term, by the name of the database."""
    holders = {}
    for name, database_terms in leaves.items():
        if term in database_terms:
            holders[name] = database_terms[term]
    return holders


def _list_changes(
    databases: Mapping[str, xr.DataTree], content: Sequence[Mapping[str, Any]]
) -> dict[str, Any] | None:
    """Return the changes from the first database to the last, term by term."""
    first, last = next(iter(databases)), list(databases)[-1]
    if first == last:
        return None
    table = aerodb.compare(databases[first], databases[last])
    rows = []
    for item in content:
        if item["term"] not in table.index or item["state"] == "unchanged":
            continue
        row = table.loc[item["term"]]
        errors = row["max_in_stderr"]
        # two databases are compared here, whatever the others hold
        state = "replaced"
        if item["term"] not in aerodb.terms(databases[first]):
            state = "added"
        elif item["term"] not in aerodb.terms(databases[last]):
            state = "removed"
        rows.append(
            {
                **item,
                "state": state,
                "change": format_number(row["max_difference"], 2),
                "errors": fixed_decimals(errors, 1) if np.isfinite(errors) else MISSING,
                "where": row["location"],
                "note": row["note"],
                "flown": item["facts"].get(last, {}).get("flown", ""),
            }
        )
    return {"first": first, "last": last, "rows": rows}


def _term_order(term: str) -> tuple[int, bool, str]:
    """Return the sort key of a term: coefficient, then the basic term, then the name."""
    coefficient, _, name = term.partition("/")
    position = 9  # after all coefficients
    if coefficient in COEFFICIENTS:
        position = list(COEFFICIENTS).index(coefficient)
    return position, name != "basic", name


def _term_state(holders: Mapping[str, xr.Dataset], names: Sequence[str], changed: bool) -> str:
    """Return whether a term is missing in a database, replaced or unchanged."""
    lacking = [name for name in names if name not in holders]
    if lacking:
        return f"not in {', '.join(lacking)}"
    return "replaced" if changed else "unchanged"


def _term_content(term: str, holders: Mapping[str, xr.Dataset], state: str) -> dict[str, Any]:
    """Return the texts of a term; its scalar values if no database has a table."""
    first = next(iter(holders.values()))
    item: dict[str, Any] = {
        "term": term,
        "words": term_words(term),
        "state": state,
        "factors": [symbol_parts(regressor) for regressor in terms.list_regressors(first)],
        "facts": {name: _leaf_facts(leaf) for name, leaf in holders.items()},
    }
    if not any(leaf["value"].ndim for leaf in holders.values() if "value" in leaf):
        scalars = []
        for name, leaf in holders.items():
            stderr = format_number(float(leaf["stderr"]), 2) if "stderr" in leaf else ""
            scalars.append((name, format_number(float(leaf["value"]), 4), stderr))
        item["scalars"] = scalars
    return item


def _root_facts(name: str, db: xr.DataTree, count: int) -> dict[str, Any]:
    """Return name, number of terms and texts of a database."""
    facts: dict[str, Any] = {"name": name, "count": count}
    for key in ("title", "source", "history", "references"):
        facts[key] = str(db.attrs.get(key, ""))
    return facts


def _leaf_facts(leaf: xr.Dataset) -> dict[str, str]:
    """Return shape, sources of the nodes, multipliers and texts of a leaf."""
    shape = ", ".join(f"{axis} {leaf.sizes[axis]}" for axis in map(str, leaf["value"].dims))
    source = node_count = ""
    if "source" in leaf:
        # The table of sources holds an index into `terms.SOURCES` for every node.
        count = np.bincount(leaf["source"].values.ravel().astype(int), minlength=len(terms.SOURCES))
        pairs = zip(terms.SOURCES, count, strict=True)
        source = ", ".join(f"{number} {name}" for name, number in pairs if number)
        node_count = f"{count[FLIGHT]} of {count.sum()}"
    if ORIGIN in leaf.attrs:
        source = f"{source}; a priori from {leaf.attrs[ORIGIN]}"
    facts = {
        "shape": shape or "scalar",
        "flown": node_count,
        "regressors": " ".join(terms.list_multipliers(leaf)),
        "source": source or "not stated",
    }
    for key in ("references", "history", "comment"):
        facts[key] = str(leaf.attrs.get(key, ""))
    return facts
