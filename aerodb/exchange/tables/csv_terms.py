"""Terms as CSV files for people and spreadsheets: one file per table in long form, and an index.

Every row of a term is a node: the axes with their units in brackets, value, standard error, source.
Factor tables have files of their own.  File names have a number, because some file systems do not
distinguish ``CL`` and ``Cl``.  The folder is written atomically.  Check cases and the undo history
stay in the database.
"""

from __future__ import annotations

import errno
import math
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
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
from aerodb.store.schema import check, require_valid, terms
from aerodb.store.undo_history import add_history_line
from flightmech import terms as _terms
from flightmech.errors import ParseError, SchemaError, UnknownName
from flightmech.names import lookup
from flightmech.support.atomic_write import folder_written_atomically
from flightmech.units import parse_unit

FORMAT = "aeromatch terms, format 1"
INDEX = "index.csv"
_TABLES = ("value", "K1", "K2")
_OPTIONAL = ("stderr", "source")
_HEADER = ("file", "term", "table", "axes", "regressors", "nodes")
_MOST_NAMED = 10  # repeated nodes that a message lists
# Nodes per row beyond which a grid is not built: its rows do not form a grid.
_MOST_NODES_PER_ROW = 10


def export_csv(db: xr.DataTree, folder: str | os.PathLike[str]) -> None:
    """Write the terms of a database as CSV files into a folder of their own.

    Parameters
    ----------
    db : DataTree
        The database.
    folder : path
        Folder to write.  A folder with an earlier export and no other file is replaced in one step.

    Raises
    ------
    SchemaError
        The database is faulty.
    FileExistsError
        The folder contains other files than an export.  It is not changed.
    """
    folder = Path(folder)
    require_valid(db)
    leaves = terms(db)
    facts = {name: flatten_attributes(leaf) for name, leaf in leaves.items()}
    root = {str(key): value for key, value in db.attrs.items()}
    problems = []
    for name, attributes in [("root", root), *facts.items()]:
        problems += [f"{name}: {text}" for text in unwritable_keys(attributes)]
    if problems:
        raise SchemaError("CSV files", problems)
    _demand_earlier_export(folder)
    with folder_written_atomically(folder) as part:
        rows: list[list[str]] = []
        for number, (name, leaf) in enumerate(leaves.items(), 1):
            stem = f"{number:03d}_{name.replace('/', '_')}"
            for table in _TABLES:
                if table not in leaf:
                    continue
                # Attributes and regressors stand once, with the table of values.
                is_value = table == "value"
                file = f"{stem}.csv" if is_value else f"{stem}_{table}.csv"
                header, cells = _to_long_form(leaf, table)
                table_facts = facts[name] if is_value else {}
                text = written_csv(f"{name}, {table}", table_facts, header, cells)
                (part / file).write_text(text, encoding="utf-8", newline="")
                axes = " ".join(map(str, leaf[table].dims))
                regressors = " ".join(_terms.list_regressors(leaf)) if is_value else ""
                rows.append([file, name, table, axes, regressors, str(leaf[table].size)])
        index = written_csv(FORMAT, root, _HEADER, rows)
        (part / INDEX).write_text(index, encoding="utf-8", newline="")


def _to_long_form(leaf: xr.Dataset, name: str) -> tuple[list[str], list[list[str]]]:
    """Return one table in long form: header and rows, the last axis fastest."""
    table = leaf[name]
    axes = [str(axis) for axis in table.dims]
    # Coordinates of all nodes, each of the shape of the table.
    mesh = np.meshgrid(*(leaf[axis].values.astype(float) for axis in axes), indexing="ij")
    columns: dict[str, list[str]] = {}
    for axis, points in zip(axes, mesh, strict=True):
        columns[f"{axis} [{lookup(axis).units}]"] = _exact_texts(points)
    columns[name] = _exact_texts(table.values)
    if name == "value" and "stderr" in leaf:
        columns["stderr"] = _exact_texts(leaf["stderr"].values)
    if name == "value" and "source" in leaf:
        codes = leaf["source"].values.ravel()
        columns["source"] = [_terms.SOURCES[int(code)] for code in codes]
    return list(columns), [list(row) for row in zip(*columns.values(), strict=True)]


def _exact_texts(values: np.ndarray) -> list[str]:
    return list(map(repr, values.astype(float).ravel().tolist()))


def _demand_earlier_export(folder: Path) -> None:
    """Raise unless a folder is missing, empty, or an earlier export without other files."""
    if not folder.exists():
        return
    if not folder.is_dir():
        raise FileExistsError(errno.EEXIST, "is a file; name a folder", str(folder))
    # Files of other programs must not be deleted.
    names = {file.name for file in folder.iterdir()}
    if names and names != _indexed_files(folder):
        text = "holds other files than an export of terms; name another folder, or empty this one"
        raise FileExistsError(errno.EEXIST, text, str(folder))


def _indexed_files(folder: Path) -> set[str]:
    """Return the files of an export by its index, with the index; empty if there is none."""
    try:
        index, _ = read_csv(folder / INDEX)
    except (OSError, ParseError):
        return set()
    if index.title != FORMAT:
        return set()
    return {INDEX, *index.columns.get("file", ())}


def import_csv(folder: str | os.PathLike[str]) -> xr.DataTree:
    """Return the database of a folder of CSV files.

    Parameters
    ----------
    folder : path
        Folder of `export_csv`; files may be edited.  Rows may have any order, every node once.
        Axes in another unit of the same quantity (``alpha [deg]``) are converted, and the history
        of the term records it.

    Raises
    ------
    FileNotFoundError, ParseError
        The folder has no index of terms, or a file is not a text.
    SchemaError
        All faults, with file and line.
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
    # A file without a line in the index may be a term whose line was deleted by mistake.
    unlisted = {file.name for file in folder.iterdir()} - set(index.columns["file"]) - {INDEX}
    problems += [f"{name} is not in {INDEX}; list it or take it away" for name in sorted(unlisted)]
    leaves = _read_tables(folder, index, problems)
    if not problems:
        nodes = {f"/{name}": restore_attributes(leaf, leaf.attrs) for name, leaf in leaves.items()}
        db = xr.DataTree.from_dict({"/": xr.Dataset(attrs=index.facts), **nodes})
        problems = check(db)
    if problems:
        raise SchemaError(str(folder), problems)
    return db


def _read_tables(folder: Path, index: CsvTable, problems: list[str]) -> dict[str, xr.Dataset]:
    """Return the terms of the files in the index, with their facts as attributes."""
    leaves: dict[str, xr.Dataset] = {}
    columns = (index.columns["file"], index.columns["term"], index.columns["table"])
    for line, file, term, kind in zip(index.lines, *columns, strict=False):
        location = f"{INDEX}, line {line}"
        # The table of values comes first, because it has the attributes.
        is_repeated = kind in leaves.get(term, ())
        is_early = kind != "value" and term not in leaves
        if kind not in _TABLES or is_repeated or is_early:
            problems.append(
                f"{location}: table {kind!r} of {term}; allowed: value once, then K1 and K2 at "
                f"most once"
            )
        elif Path(file).name != file or not (folder / file).is_file():
            problems.append(f"{location}: no file {file!r} in the folder")
        else:
            leaf = leaves.get(term, xr.Dataset())
            leaves[term] = _add_table(leaf, folder / file, kind, problems=problems)
    return leaves


def _add_table(leaf: xr.Dataset, path: Path, kind: str, problems: list[str]) -> xr.Dataset:
    """Return a leaf with the table of a file; the leaf itself if the file has problems."""
    count = len(problems)
    table, faults = read_csv(path)
    problems += faults
    axes = [name for name in table.columns if table.units[name]]
    names = [name for name in table.columns if not table.units[name]]
    problems += _column_problems(path.name, kind, axes, names)
    if len(problems) > count:
        return leaf
    coordinates = {axis: si_column(table, axis, problems) for axis in axes}
    columns = {}
    for name in names:
        if name == "source":
            columns[name] = _source_codes(table, problems)
        else:
            columns[name] = column_numbers(table, name, problems)
    if len(problems) > count:
        return leaf
    grid = _find_grid(table, coordinates, problems)
    if grid is None:
        return leaf
    points, order = grid
    shape = tuple(len(p) for p in points.values())
    variables = {}
    for name, column in columns.items():
        variables[name] = (tuple(points), column[order].reshape(shape))
    extended = leaf.assign_coords(points).assign(variables)
    extended.attrs |= table.facts
    # A conversion changes the numbers, so the history records it.
    converted = []
    for axis in axes:
        if parse_unit(table.units[axis]) != parse_unit(lookup(axis).units):
            converted.append(f"{axis} in {table.units[axis]}")
    if not converted:
        return extended
    return add_history_line(extended, f"import_csv: {path.name} gives {', '.join(converted)}")


def _column_problems(file: str, kind: str, axes: list[str], names: list[str]) -> list[str]:
    """Return the problems with axes and other columns of a table."""
    allowed = (kind, *_OPTIONAL) if kind == "value" else (kind,)
    problems = []
    for name in names:
        if name not in allowed:
            problems.append(
                f"{file}: column {name!r}; allowed: axes with their unit in brackets, "
                f"{', '.join(allowed)}"
            )
    if kind not in names:
        problems.append(f"{file}: no column {kind!r}")
    for axis in axes:
        try:
            lookup(axis)
        except UnknownName as error:
            problems.append(f"{file}: axis: {error}")
    return problems


def _source_codes(table: CsvTable, problems: list[str]) -> np.ndarray:
    """Return the column of sources as codes."""
    codes = np.zeros(len(table.lines), np.uint8)
    for i, (source, line) in enumerate(zip(table.columns["source"], table.lines, strict=False)):
        if source in _terms.SOURCES:
            codes[i] = _terms.SOURCES.index(source)
        else:
            problems.append(
                f"{table.name}, line {line}: source is {source!r}; allowed: "
                f"{', '.join(_terms.SOURCES)}"
            )
    return codes


def _find_grid(
    table: CsvTable, coordinates: Mapping[str, np.ndarray], problems: list[str]
) -> tuple[dict[str, np.ndarray], np.ndarray] | None:
    """Return breakpoints and the row of every node, or None if rows are missing or repeated."""
    points = {axis: np.unique(x) for axis, x in coordinates.items()}
    shape = tuple(len(p) for p in points.values())
    size, rows = math.prod(shape), len(table.lines)
    if size > _MOST_NODES_PER_ROW * max(rows, 1):
        problems.append(
            f"{table.name}: {rows} rows for {' x '.join(map(str, shape))} = {size} nodes; "
            f"every node needs a row"
        )
        return None
    # Flat index of the node of each row, in C order.
    nodes = np.zeros(rows, int)
    if points:
        indices = [points[axis].searchsorted(x) for axis, x in coordinates.items()]
        nodes = np.ravel_multi_index(indices, shape)
    unique_nodes, count = np.unique(nodes, return_counts=True)
    for repeated in unique_nodes[count > 1][:_MOST_NAMED]:
        repeated_lines = []
        for line, node in zip(table.lines, nodes, strict=False):
            if node == repeated:
                repeated_lines.append(str(line))
        problems.append(
            f"{table.name}, lines {', '.join(repeated_lines)}: the same node "
            f"{_describe_node(points, int(repeated))}; every node stands once"
        )
    # With neither repeated nor missing nodes the rows are a permutation of the nodes.
    missing = np.setdiff1d(np.arange(size), unique_nodes)
    if missing.size:
        problems.append(
            f"{table.name}: {missing.size} of {size} nodes have no row, the first is "
            f"{_describe_node(points, int(missing[0]))}"
        )
    if not rows == size == unique_nodes.size:
        return None
    return points, np.argsort(nodes)


def _describe_node(points: Mapping[str, np.ndarray], node: int) -> str:
    """Return the coordinates of a node by its flat index."""
    if not points:
        return "of a table without axes"
    indices = np.unravel_index(node, [len(p) for p in points.values()])
    return " ".join(f"{axis} {p[i]:.6g}" for (axis, p), i in zip(points.items(), indices))
