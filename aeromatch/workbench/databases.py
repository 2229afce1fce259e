"""Page of the databases: terms, tables on common axes, flight estimates, history, two databases
compared.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import aerodb
from aerodb.figures.lr743_set.flown import (
    FLOWN,
    FlightData,
    configuration_text,
    is_clean,
    read_flown,
)
from aerodb.store.files import open as open_database
from aerodb.store.grids import regrid_leaf, union_axes
from aerodb.store.overview import describe_database, heading_lines
from aeromatch.workbench.opened import MATCH, OpenProject
from flightmech import terms as _terms
from flightmech.errors import AeromatchWarning, SchemaError, UnknownName
from flightmech.names import lookup
from flightmech.support.figures import to_display_quantity

DATABASES, TUNED = "databases", "tuned"
"""Folders of the working folder: databases edited by hand, tuned models."""

_OF_A_MATCH = ("datcom", "corrected", "final")  # in the order in which they are made
_RATE_OF_ALPHA = "alphadothat"
_MOST_NODES = 200_000  # of a table over the breakpoints of all databases shown


def list_databases(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the databases of the working folder, and the aircraft files with which they fly."""
    found = _files(opened)
    return {
        "files": [
            {"file": place, "label": file.stem, "aircraft": _aircraft(opened, file)}
            for place, file in found.items()
        ]
    }


def _files(opened: OpenProject) -> dict[str, Path]:
    """Return the databases by their place."""
    work = opened.work
    found = [file for name in _OF_A_MATCH if (file := work / MATCH / f"{name}.nc").exists()]
    for folder in (DATABASES, TUNED):
        found += [file for file in sorted((work / folder).rglob("*.nc")) if not _is_engine(file)]
    return {opened.places.named(file): file for file in found}


def _is_engine(file: Path) -> bool:
    """Whether a file holds the tables of an engine, which stand next to an aircraft file as
    ``NAME_engine1.nc``.
    """
    return file.stem.rpartition("_")[2].rstrip("0123456789") == "engine"


def _aircraft(opened: OpenProject, file: Path) -> str:
    """Return the aircraft file of a database: that of its name, that of the match from which it was
    edited, or that of the project.
    """
    near = [
        file.with_suffix(".toml"),
        *(opened.work / MATCH / f"{name}.toml" for name in reversed(_OF_A_MATCH)),
    ]
    return opened.places.named(next((one for one in near if one.exists()), opened.project.aircraft))


def _opened(opened: OpenProject, place: str) -> xr.DataTree:
    known = _files(opened)
    if place not in known:
        raise UnknownName(place, known, "database")
    return opened.kept(("database",), [known[place]], lambda: open_database(known[place]))


def show_database(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return terms and history of a database (``file``)."""
    db = _opened(opened, query.get("file", ""))
    rows = [
        {**row, "axes": [_axis(axis["name"], axis["points"]) for axis in row["axes"]]}
        for row in describe_database(db)
    ]
    title, *about = heading_lines(db.attrs)
    edits = aerodb.store.history(db)
    return {
        "title": title,
        "about": about,
        "terms": [
            {
                **row,
                "coefficient": row["term"].split("/")[0],
                "size": aerodb.terms(db)[row["term"]]["value"].size,
            }
            for row in rows
        ],
        "history": edits[["edit", "text"]].to_dict("records"),
        "undo": int(edits["edit"].notna().sum()),
    }


def _axis(name: str, points: Any) -> dict[str, Any]:
    shown, unit = to_display_quantity(name, np.asarray(points, float))
    return {
        "name": name,
        "unit": "" if unit == "1" else unit,
        "points": shown,
        "meaning": lookup(name).long_name,
    }


def show_term(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return one term (``term``) of several databases (``files`` with commas): the nodes of the
    first that has it, and all on common axes.

    Common axes have the breakpoints of all of them, so that nothing is lost between the nodes:
    tables are multilinear.

    Raises
    ------
    UnknownName
        No database of that name, or none has the term.
    SchemaError
        The table over the common axes would be too large.
    """
    name, places = (
        query.get("term", ""),
        [place for place in query.get("files", "").split(",") if place],
    )
    held = {place: aerodb.terms(_opened(opened, place)) for place in places}
    leaves = {place: own[name] for place, own in held.items() if name in own}
    if not leaves:
        raise UnknownName(name, {one for own in held.values() for one in own}, "term")
    first = next(iter(leaves))
    points = union_axes(*leaves.values())
    size = int(np.prod([len(own) for own in points.values()], dtype=float))
    if size > _MOST_NODES:
        raise SchemaError(
            name,
            [
                f"the databases together have {size} nodes, at most {_MOST_NODES} are drawn; "
                f"show one of them"
            ],
        )
    return {
        "term": name,
        "file": first,
        "regressors": list(_terms.list_regressors(leaves[first])),
        "power": str(_terms.power_factor(leaves[first]) or ""),
        "factors": [
            f"{key} over {' '.join(map(str, leaves[first][key].dims))}"
            for key in ("K1", "K2")
            if key in leaves[first]
        ],
        "nodes": {"axes": _axes(leaves[first]), **_table(leaves[first])},
        "axes": [_axis(axis, own) for axis, own in points.items()],
        "curves": [
            {
                "file": place,
                **_table(regrid_leaf(leaf, points)),
                "multipliers": " ".join(_terms.list_multipliers(leaf)),
            }
            for place, leaf in leaves.items()
        ],
        "lacking": [place for place in places if place not in leaves],
        "points": _estimates(opened, name, first, leaves[first], list(points)),
    }


def _axes(leaf: xr.Dataset) -> list[dict[str, Any]]:
    return [_axis(str(axis), leaf[axis].values) for axis in leaf["value"].dims]


def _table(leaf: xr.Dataset) -> dict[str, Any]:
    """Return the nodes as lists, the last axis fastest."""
    codes = leaf["source"].values.ravel() if "source" in leaf else None
    return {
        "value": leaf["value"].values.ravel(),
        "stderr": leaf["stderr"].values.ravel() if "stderr" in leaf else None,
        "source": None if codes is None else [_terms.SOURCES[int(code)] for code in codes],
    }


def _estimates(
    opened: OpenProject, name: str, place: str, leaf: xr.Dataset, axes: list[str]
) -> dict[str, Any]:
    """Return what the flights show of a term, one row each.

    Of a term that is a derivative the local estimates; of any other the partial residuals: the
    measured coefficient less all other terms of the database shown, by manoeuvre.
    """
    file = opened.work / MATCH / FLOWN
    if not file.exists():
        return {"rows": [], "of": "", "kind": ""}
    flown: FlightData = opened.kept(("flown",), [file], lambda: read_flown(file))
    own, coefficient = _terms.list_regressors(leaf), name.split("/")[0]
    if len(own) != 1 or _terms.power_factor(leaf) is not None:
        database = _files(opened)[place]
        make = lambda: aerodb.figures.partial_residuals(_opened(opened, place), flown, name)  # noqa: E731
        table = opened.kept(("partial", name), [database, file], make)
        return {
            "rows": _rows(
                table, axes, table["record"] + ": " + table["label"] if len(table) else ()
            ),
            "of": coefficient,
            "kind": "partial",
        }
    table = flown.estimates
    table = table[(table["coefficient"] == coefficient) & (table["term"] == own[0])]
    separated = flown.estimates["term"].eq(_RATE_OF_ALPHA).any()
    mixed = (
        f", which holds that per {_RATE_OF_ALPHA}: the fits do not separate the two"
        if own[0] == "qhat" and not separated
        else ""
    )
    return {
        "rows": _rows(table, axes, table["fit"]),
        "of": f"{coefficient} per {own[0]}{mixed}",
        "kind": "estimate",
    }


def _rows(table: pd.DataFrame, axes: list[str], names: Iterable[Any]) -> list[dict[str, Any]]:
    """Return estimates with their standard errors, configuration and places on the axes."""
    clean: list[bool] = is_clean(table).tolist() if len(table) else []
    return [
        {
            "fit": str(name),
            "value": float(row["estimate"]),
            "stderr": float(row["stderr"]),
            "clean": bool(of_clean),
            "configuration": configuration_text(row),
            "at": {
                axis: float(to_display_quantity(axis, np.array([row[axis]]))[0][0])
                for axis in axes
                if axis in table
            },
        }
        for (_, row), of_clean, name in zip(table.iterrows(), clean, names, strict=True)
    ]


def compare_databases(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the differences b - a of two databases (``a``, ``b``): a row per term and per
    coefficient.
    """
    known = _files(opened)
    pair = [query.get(side, "") for side in ("a", "b")]
    trees = [_opened(opened, place) for place in pair]

    def work() -> tuple[list[dict[str, Any]], list[str]]:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", AeromatchWarning)
            frame = aerodb.compare(*trees)
        rows = [
            {"term": str(name), **{str(key): item for key, item in row.items()}}
            for name, row in frame.to_dict("index").items()
        ]
        return rows, [
            str(one.message) for one in caught if issubclass(one.category, AeromatchWarning)
        ]

    rows, remarks = opened.kept(("comparison",), [known[place] for place in pair], work)
    return {"a": pair[0], "b": pair[1], "rows": rows, "remarks": remarks}


ROUTES = {
    ("GET", "/api/databases"): list_databases,
    ("GET", "/api/database"): show_database,
    ("GET", "/api/term"): show_term,
    ("GET", "/api/comparison"): compare_databases,
}
"""What the page of the databases requests; as `records.ROUTES`."""
