"""Page of the databases: terms, tables on common axes, flight estimates, history, comparison."""

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
    is_clean,
    read_flown,
)
from aerodb.store.files import open as open_database
from aerodb.store.grids import regrid_leaf, union_axes
from aerodb.store.overview import describe_database, heading_lines
from aeromatch.workbench.opened import MATCH, OpenProject
from flightmech import terms as _terms
from flightmech.envelope.maps import configuration_text
from flightmech.errors import AeromatchWarning, SchemaError, UnknownName
from flightmech.names import lookup
from flightmech.support.figures import to_display_quantity

DATABASES, TUNED = "databases", "tuned"
"""Folders of the working folder: databases edited by hand, tuned models."""

# Regressor that pitch-rate terms of flights may include.
_ALPHA_RATE = "alphadothat"
# Greatest number of nodes of a table over the breakpoints of all databases.
_MOST_NODES = 200_000


def list_databases(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the databases of the working folder, and their aircraft files."""
    files = []
    for location, file in _database_files(opened).items():
        aircraft = _aircraft_place(opened, file)
        files.append({"file": location, "label": file.stem, "aircraft": aircraft})
    return {"files": files}


def _database_files(opened: OpenProject) -> dict[str, Path]:
    """Return the databases by their location: those of the match, edited ones, tuned ones."""
    files = []
    for name in opened.project.own_models:
        file = opened.work / MATCH / f"{name}.nc"
        if file.exists():
            files.append(file)
    for folder in (DATABASES, TUNED):
        for file in sorted((opened.work / folder).rglob("*.nc")):
            if not _is_engine(file):
                files.append(file)
    return {opened.places.named(file): file for file in files}


def _is_engine(file: Path) -> bool:
    """Return whether a file has the tables of an engine, by its name ``NAME_engine1.nc``."""
    return file.stem.rpartition("_")[2].rstrip("0123456789") == "engine"


def _aircraft_place(opened: OpenProject, file: Path) -> str:
    """Return the aircraft file of a database.

    It is the file of the same name, or else the last one of the match, or else the project's.
    """
    candidates = [file.with_suffix(".toml")]
    candidates += [
        opened.work / MATCH / f"{name}.toml" for name in reversed(opened.project.own_models)
    ]
    for candidate in candidates:
        if candidate.exists():
            return opened.places.named(candidate)
    return opened.places.named(opened.project.aircraft)


def _open(opened: OpenProject, location: str) -> xr.DataTree:
    """Return the database of a location."""
    files = _database_files(opened)
    if location not in files:
        raise UnknownName(location, files, "database")
    return opened.kept(("database",), [files[location]], lambda: open_database(files[location]))


def show_database(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return terms and history of a database (``file``)."""
    db = _open(opened, query.get("file", ""))
    leaves = aerodb.terms(db)
    terms = []
    for description in describe_database(db):
        name = description["term"]
        row = {
            **description,
            "axes": [_axis(axis["name"], axis["points"]) for axis in description["axes"]],
            "coefficient": name.split("/")[0],
            "size": leaves[name]["value"].size,
        }
        terms.append(row)
    # The first line is the title, the others are facts.
    title, *lines = heading_lines(db.attrs)
    edits = aerodb.store.history(db)
    return {
        "title": title,
        "about": lines,
        "terms": terms,
        "history": edits[["edit", "text"]].to_dict("records"),
        "undo": int(edits["edit"].notna().sum()),
    }


def _axis(name: str, points: Any) -> dict[str, Any]:
    """Return an axis in display units."""
    values, unit = to_display_quantity(name, np.asarray(points, float))
    # Pure numbers are printed without a unit.
    if unit == "1":
        unit = ""
    return {"name": name, "unit": unit, "points": values, "meaning": lookup(name).long_name}


def show_term(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return one term (``term``) of several databases (``files`` with commas).

    The result has the nodes of the first database with the term, and the term of all databases on
    common axes. Common axes have the breakpoints of all databases. Tables are multilinear, so the
    values between the nodes are the same.

    Raises
    ------
    UnknownName
        A database does not exist, or no database has the term.
    SchemaError
        The table over the common axes is too large.
    """
    name = query.get("term", "")
    places = [location for location in query.get("files", "").split(",") if location]
    # The term by database, and the terms of all databases for the message of an unknown name.
    leaves: dict[str, xr.Dataset] = {}
    available: set[str] = set()
    for location in places:
        terms = aerodb.terms(_open(opened, location))
        available.update(terms)
        if name in terms:
            leaves[location] = terms[name]
    if not leaves:
        raise UnknownName(name, available, "term")
    points = union_axes(*leaves.values())
    # A product of integers could overflow.
    size = int(np.prod([len(breakpoints) for breakpoints in points.values()], dtype=float))
    if size > _MOST_NODES:
        problem = (
            f"the databases together have {size} nodes, at most {_MOST_NODES} are drawn; show one "
            f"of them"
        )
        raise SchemaError(name, [problem])
    curves = []
    for location, leaf in leaves.items():
        curve = {"file": location, **_table(regrid_leaf(leaf, points))}
        curves.append({**curve, "multipliers": " ".join(_terms.list_multipliers(leaf))})
    first = next(iter(leaves))
    leaf = leaves[first]
    factors = []
    for key in ("K1", "K2"):
        if key in leaf:
            factors.append(f"{key} over {' '.join(map(str, leaf[key].dims))}")
    axes = [_axis(str(axis), leaf[axis].values) for axis in leaf["value"].dims]
    return {
        "term": name,
        "file": first,
        "regressors": list(_terms.list_regressors(leaf)),
        "power": str(_terms.power_factor(leaf) or ""),
        "factors": factors,
        "nodes": {"axes": axes, **_table(leaf)},
        "axes": [_axis(axis, breakpoints) for axis, breakpoints in points.items()],
        "curves": curves,
        "lacking": [location for location in places if location not in leaves],
        "points": _flight_points(opened, name, location=first, leaf=leaf, axes=list(points)),
    }


def _table(leaf: xr.Dataset) -> dict[str, Any]:
    """Return the nodes as lists, the last axis fastest; None for an absent list."""
    table: dict[str, Any] = {"value": leaf["value"].values.ravel(), "stderr": None, "source": None}
    if "stderr" in leaf:
        table["stderr"] = leaf["stderr"].values.ravel()
    if "source" in leaf:
        table["source"] = [_terms.SOURCES[int(code)] for code in leaf["source"].values.ravel()]
    return table


def _flight_points(
    opened: OpenProject, name: str, location: str, leaf: xr.Dataset, axes: list[str]
) -> dict[str, Any]:
    """Return the points of a term from flight, one row each.

    For a derivative they are the local estimates. For another term they are the partial residuals
    by manoeuvre: the measured coefficient minus all other terms of the database.
    """
    file = opened.work / MATCH / FLOWN
    if not file.exists():
        return {"rows": [], "of": "", "kind": ""}
    flight: FlightData = opened.kept(("flown",), [file], lambda: read_flown(file))
    regressors, coefficient = _terms.list_regressors(leaf), name.split("/")[0]
    # A table with one regressor is a derivative, which local models estimate directly.
    if len(regressors) != 1 or _terms.power_factor(leaf) is not None:
        database = _database_files(opened)[location]

        def make() -> pd.DataFrame:
            return aerodb.figures.partial_residuals(_open(opened, location), flight, name)

        table = opened.kept(("partial", name), [database, file], make)
        names: Iterable[Any] = ()
        if len(table):
            names = table["record"] + ": " + table["label"]
        return {"rows": _point_rows(table, axes, names), "of": coefficient, "kind": "partial"}
    regressor = regressors[0]
    table = flight.estimates
    table = table[(table["coefficient"] == coefficient) & (table["term"] == regressor)]
    text = f"{coefficient} per {regressor}"
    # Pitch rate and rate of angle of attack are nearly equal in most manoeuvres.
    if regressor == "qhat" and not flight.estimates["term"].eq(_ALPHA_RATE).any():
        text += f", which holds that per {_ALPHA_RATE}: the fits do not separate the two"
    return {"rows": _point_rows(table, axes, table["fit"]), "of": text, "kind": "estimate"}


def _point_rows(table: pd.DataFrame, axes: list[str], names: Iterable[Any]) -> list[dict[str, Any]]:
    """Return estimates with standard errors, configuration and coordinates on the axes."""
    if not len(table):
        return []
    rows = []
    clean = is_clean(table).tolist()
    for (_, row), is_row_clean, name in zip(table.iterrows(), clean, names, strict=True):
        coordinates = {}
        for axis in axes:
            if axis in table:
                coordinates[axis] = float(to_display_quantity(axis, np.array([row[axis]]))[0][0])
        point = {
            "fit": str(name),
            "value": float(row["estimate"]),
            "stderr": float(row["stderr"]),
            "clean": bool(is_row_clean),
            "configuration": configuration_text(row.to_dict()),
            "at": coordinates,
        }
        rows.append(point)
    return rows


def compare_databases(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the differences b - a of two databases (``a``, ``b``), by term and by coefficient."""
    a, b = query.get("a", ""), query.get("b", "")
    first, second = _open(opened, a), _open(opened, b)

    def make() -> tuple[list[dict[str, Any]], list[str]]:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", AeromatchWarning)
            frame = aerodb.compare(first, second)
        rows = []
        for name, row in frame.to_dict("index").items():
            rows.append({"term": str(name)} | {str(key): value for key, value in row.items()})
        # Warnings of other packages do not concern the databases.
        warned = [item for item in caught if issubclass(item.category, AeromatchWarning)]
        return rows, [str(item.message) for item in warned]

    files = _database_files(opened)
    rows, remarks = opened.kept(("comparison",), [files[a], files[b]], make)
    return {"a": a, "b": b, "rows": rows, "remarks": remarks}


ROUTES = {
    ("GET", "/api/databases"): list_databases,
    ("GET", "/api/database"): show_database,
    ("GET", "/api/term"): show_term,
    ("GET", "/api/comparison"): compare_databases,
}
"""Requests of the page of the databases, in the form of `records.ROUTES`."""
