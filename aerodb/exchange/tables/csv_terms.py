"""Terms as CSV files that a person and a spreadsheet read: one file per table in long form, and an
index.

Every row of a term is a node: the axes with their units in brackets, value, standard error, source.
Factor tables have files of their own.  File names carry a number, because ``CL`` and ``Cl`` are one
name to some file systems.  The folder is written atomically; check cases and the undo history stay
in the database.
"""

from __future__ import annotations

import errno
import math
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.exchange.tables.csv_text import (
    CsvTable,
    column_numbers,
    flatten_attributes,
    read_csv,
    restore_attributes,
    si_column,
    unwritable_keys,
    written_csv,
)
from aerodb.store.evaluation import (
    SEED,
    TOLERANCE,
    check_case_inputs,
    compare_output,
    outputs_at,
    random_states,
)
from aerodb.store.schema import check, require_valid, terms
from aerodb.store.undo_history import add_history_line
from flightmech import terms as _terms
from flightmech.errors import ParseError, SchemaError, UnknownName
from flightmech.names import lookup
from flightmech.support.atomic_write import folder_written_atomically, write_text
from flightmech.units import parse_unit

CHECK_FORMAT = "aeromatch check cases, format 1"
_COUNT = 200


def export_checkcases(
    db: xr.DataTree, path: str | os.PathLike, count: int = _COUNT, seed: int = SEED
) -> None:
    """Write a table of check cases: states in SI, contributions as ``CL/basic``, coefficients as
    ``CL``.

    Parameters
    ----------
    db : DataTree
        The database.
    path : path
        CSV file to write, atomically.
    count : int
        Number of cases.
    seed : int
        Of the random numbers; the same seed gives the same cases.
    """
    require_valid(db)
    inputs = random_states(db, count, seed)
    outputs = outputs_at(db, inputs, count)
    header = ["case", *(f"{name} [{lookup(name).units}]" for name in inputs), *outputs]
    columns = [map(repr, values.tolist()) for values in (*inputs.values(), *outputs.values())]
    facts: dict[str, Any] = {
        key: db.attrs[key] for key in ("title", "aircraft", "force_axes", "S", "cbar", "b")
    }
    facts["agreement"] = (
        f"no output differs by more than {TOLERANCE:g} of the largest magnitude of its column"
    )
    facts["beyond_a_table"] = (
        "the end value holds, or the last line goes on where the term has outside = linear"
    )
    facts |= {"count": count, "seed": seed}
    rows = [[str(number), *cells] for number, cells in enumerate(zip(*columns), 1)]
    write_text(path, written_csv(CHECK_FORMAT, facts, header, rows))


def run_checkcases(db: xr.DataTree, path: str | os.PathLike) -> pd.DataFrame:
    """Return how a database agrees with a table of check cases.

    Returns
    -------
    DataFrame, index ``output``
        ``largest_difference`` (database minus table, signed), ``case`` (where it is),
        ``tolerance``, ``failed`` (number of cases beyond it), ``agrees``.  A term that the database
        lacks counts as zero.

    Raises
    ------
    ParseError
        Not a table of check cases.
    SchemaError
        Columns or cells that cannot be read; all of them, with file and line.
    """
    table, problems = read_csv(Path(path))
    if table.title != CHECK_FORMAT:
        raise ParseError(
            str(path),
            1,
            repr(table.title),
            f"'# {CHECK_FORMAT}' as aerodb.exchange.export_checkcases writes it",
        )
    inputs = {name: si_column(table, name, problems) for name in table.columns if table.units[name]}
    expected = {
        name: si_column(table, name, problems)
        for name in table.columns
        if not table.units[name] and name != "case"
    }
    missing = [name for name in check_case_inputs(db) if name not in inputs]
    problems += [
        f"{Path(path).name}: no column {name} [{lookup(name).units}], which the database needs"
        for name in missing
    ]
    if problems:
        raise SchemaError(str(path), problems)
    found = outputs_at(db, inputs, len(table.lines))
    rows = {
        name: compare_output(found.get(name, np.zeros(len(table.lines))), column)
        for name, column in expected.items()
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("output")


FORMAT = "aeromatch terms, format 1"
INDEX = "index.csv"
_TABLES = ("value", "K1", "K2")
_OPTIONAL = ("stderr", "source")
_HEADER = ("file", "term", "table", "axes", "regressors", "nodes")
_MOST_NAMED = 10  # nodes that stand twice and are named


def export_csv(db: xr.DataTree, folder: str | os.PathLike) -> None:
    """Write the terms of a database as CSV files into a folder of their own.

    Parameters
    ----------
    db : DataTree
        The database.
    folder : path
        Folder to write. One that holds an earlier export and nothing else is replaced, in one step.

    Raises
    ------
    SchemaError
        The database is faulty.
    FileExistsError
        The folder holds other files than an export; nothing is touched.
    """
    folder = Path(folder)
    require_valid(db)
    leaves = terms(db)
    facts = {name: flatten_attributes(leaf) for name, leaf in leaves.items()}
    root = {str(key): item for key, item in db.attrs.items()}
    problems = [
        f"{name}: {text}"
        for name, given in [("root", root), *facts.items()]
        for text in unwritable_keys(given)
    ]
    if problems:
        raise SchemaError("CSV files", problems)
    _demand_ours(folder)
    with folder_written_atomically(folder) as part:
        rows = []
        for number, (name, leaf) in enumerate(leaves.items(), 1):
            for table in (key for key in _TABLES if key in leaf):
                file = f"{number:03d}_{name.replace('/', '_')}{'' if table == 'value' else f'_{table}'}.csv"
                header = {} if table != "value" else facts[name]
                text = written_csv(f"{name}, {table}", header, *_long(leaf, table))
                (part / file).write_text(text, encoding="utf-8", newline="")
                words = " ".join(_terms.list_regressors(leaf)) if table == "value" else ""
                rows.append(
                    [
                        file,
                        name,
                        table,
                        " ".join(map(str, leaf[table].dims)),
                        words,
                        str(leaf[table].size),
                    ]
                )
        (part / INDEX).write_text(
            written_csv(FORMAT, root, _HEADER, rows), encoding="utf-8", newline=""
        )


def _long(leaf: xr.Dataset, name: str) -> tuple[list[str], list[list[str]]]:
    """Return one table in long form: header and rows, the last axis fastest."""
    table = leaf[name]
    axes = [str(axis) for axis in table.dims]
    mesh = np.meshgrid(*(leaf[axis].values.astype(float) for axis in axes), indexing="ij")
    columns: dict[str, Iterable[str]]
    columns = {
        f"{axis} [{lookup(axis).units}]": map(repr, points.ravel().tolist())
        for axis, points in zip(axes, mesh)
    }
    columns[name] = map(repr, table.values.astype(float).ravel().tolist())
    if name == "value" and "stderr" in leaf:
        columns["stderr"] = map(repr, leaf["stderr"].values.astype(float).ravel().tolist())
    if name == "value" and "source" in leaf:
        columns["source"] = (_terms.SOURCES[int(code)] for code in leaf["source"].values.ravel())
    return list(columns), [list(row) for row in zip(*columns.values())]


def _demand_ours(folder: Path) -> None:
    """Raise unless a folder is not there, empty, or an earlier export that nobody put a file into."""
    if not folder.exists():
        return
    if not folder.is_dir():
        raise FileExistsError(errno.EEXIST, "is a file; name a folder", str(folder))
    names = {file.name for file in folder.iterdir()}
    if names and names != _listed(folder):
        text = "holds other files than an export of terms; name another folder, or empty this one"
        raise FileExistsError(errno.EEXIST, text, str(folder))


def _listed(folder: Path) -> set[str]:
    """Return the files that the index of an export names, itself among them; none where there is no
    such index.
    """
    try:
        index, _ = read_csv(folder / INDEX)
    except (OSError, ParseError):
        return set()
    return {INDEX, *index.columns.get("file", ())} if index.title == FORMAT else set()


def import_csv(folder: str | os.PathLike) -> xr.DataTree:
    """Return the database of a folder of CSV files.

    Parameters
    ----------
    folder : path
        As `export_csv` writes it; files may be edited. Rows may stand in any order, every node
        once. Axes in another unit of the same quantity (``alpha [deg]``) are converted, which the
        history of the term records.

    Raises
    ------
    FileNotFoundError, ParseError
        No index of terms there, or a file that is no text.
    SchemaError
        Everything that is wrong, with file and line.
    """
    folder = Path(folder)
    if not (folder / INDEX).is_file():
        raise FileNotFoundError(
            errno.ENOENT,
            f"no {INDEX} there; name a folder that aerodb.exchange.export_csv wrote",
            str(folder),
        )
    index, problems = read_csv(folder / INDEX)
    if index.title != FORMAT or not {"file", "term", "table"} <= set(index.columns):
        raise ParseError(
            str(folder / INDEX),
            1,
            repr(index.title),
            f"'# {FORMAT}' and the columns {', '.join(_HEADER[:3])}",
        )
    stray = {file.name for file in folder.iterdir()} - set(index.columns["file"]) - {INDEX}
    problems += [f"{name} is not in {INDEX}; list it or take it away" for name in sorted(stray)]
    leaves: dict[str, xr.Dataset] = {}
    for line, file, term, kind in zip(
        index.lines, *(index.columns[key] for key in ("file", "term", "table"))
    ):
        place = f"{INDEX}, line {line}"
        if (
            kind not in _TABLES
            or kind in leaves.get(term, ())
            or (kind != "value" and term not in leaves)
        ):
            problems.append(
                f"{place}: table {kind!r} of {term}; allowed: value once, then K1 and K2 at "
                f"most once"
            )
        elif Path(file).name != file or not (folder / file).is_file():
            problems.append(f"{place}: no file {file!r} in the folder")
        else:
            leaves[term] = _with_table(
                leaves.get(term, xr.Dataset()), folder / file, kind, problems
            )
    if not problems:
        nodes = {f"/{name}": restore_attributes(leaf, leaf.attrs) for name, leaf in leaves.items()}
        db = xr.DataTree.from_dict({"/": xr.Dataset(attrs=index.facts), **nodes})
        problems = check(db)
    if problems:
        raise SchemaError(str(folder), problems)
    return db


def _with_table(leaf: xr.Dataset, path: Path, kind: str, problems: list[str]) -> xr.Dataset:
    """Return a leaf with the table of one file, its facts as attributes; without it where there are
    problems.
    """
    before = len(problems)
    table, faults = read_csv(path)
    axes = [name for name in table.columns if table.units[name]]
    rest = [name for name in table.columns if name not in axes]
    known = (kind, *(_OPTIONAL if kind == "value" else ()))
    strange = [name for name in rest if name not in known]
    problems += faults
    problems += [
        f"{path.name}: column {name!r}; allowed: axes with their unit in brackets, "
        f"{', '.join(known)}"
        for name in strange
    ]
    problems += [f"{path.name}: no column {kind!r}"] if kind not in rest else []
    problems += [f"{path.name}: axis: {fault}" for axis in axes for fault in _unknown(axis)]
    if len(problems) > before:
        return leaf
    coords = {axis: si_column(table, axis, problems) for axis in axes}
    columns = {
        name: _codes(table, problems) if name == "source" else column_numbers(table, name, problems)
        for name in rest
    }
    grid = _grid(table, coords, problems) if len(problems) == before else None
    if grid is None:
        return leaf
    points, order = grid
    shape = tuple(len(p) for p in points.values())
    found = leaf.assign_coords(points).assign(
        {name: (tuple(points), column[order].reshape(shape)) for name, column in columns.items()}
    )
    found.attrs |= table.facts
    given = [
        f"{axis} in {table.units[axis]}"
        for axis in axes
        if parse_unit(table.units[axis]) != parse_unit(lookup(axis).units)
    ]
    return (
        add_history_line(found, f"import_csv: {path.name} gives {', '.join(given)}")
        if given
        else found
    )


def _unknown(axis: str) -> Iterator[str]:
    try:
        lookup(axis)
    except UnknownName as error:
        yield str(error)


def _codes(table: CsvTable, problems: list[str]) -> np.ndarray:
    """Return the column of sources as codes."""
    found = np.zeros(len(table.lines), np.uint8)
    for place, (word, line) in enumerate(zip(table.columns["source"], table.lines)):
        if word in _terms.SOURCES:
            found[place] = _terms.SOURCES.index(word)
        else:
            problems.append(
                f"{table.name}, line {line}: source is {word!r}; allowed: "
                f"{', '.join(_terms.SOURCES)}"
            )
    return found


def _grid(
    table: CsvTable, coords: Mapping[str, np.ndarray], problems: list[str]
) -> tuple[dict[str, np.ndarray], np.ndarray] | None:
    """Return the breakpoints and, for every node in order, its row; None with problems when rows
    are missing or stand twice.
    """
    points = {axis: np.unique(x) for axis, x in coords.items()}
    shape = tuple(len(p) for p in points.values())
    size, rows = math.prod(shape), len(table.lines)
    if size > 10 * max(rows, 1):
        problems.append(
            f"{table.name}: {rows} rows for {' x '.join(map(str, shape))} = {size} nodes; "
            f"every node needs a row"
        )
        return None
    places = [points[axis].searchsorted(x) for axis, x in coords.items()]
    node = np.ravel_multi_index(places, shape) if places else np.zeros(rows, int)
    found, count = np.unique(node, return_counts=True)
    for twice in found[count > 1][:_MOST_NAMED]:
        lines = ", ".join(str(line) for line, at in zip(table.lines, node) if at == twice)
        problems.append(
            f"{table.name}, lines {lines}: the same node {_named(points, int(twice))}; every "
            f"node stands once"
        )
    missing = np.setdiff1d(np.arange(size), found)
    if missing.size:
        problems.append(
            f"{table.name}: {missing.size} of {size} nodes have no row, the first is "
            f"{_named(points, int(missing[0]))}"
        )
    return (points, np.argsort(node)) if rows == size == found.size else None


def _named(points: Mapping[str, np.ndarray], node: int) -> str:
    place = np.unravel_index(node, [len(p) for p in points.values()]) if points else ()
    return (
        " ".join(f"{axis} {points[axis][i]:.6g}" for axis, i in zip(points, place))
        or "of a table without axes"
    )
