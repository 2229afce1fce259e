"""Table and column of each channel of a name map in a recording.

A name map may write a column as ``TABLE/COLUMN``, as a column of the table of its leaf, or as a
column of the only table.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from flightmech.errors import AeromatchError, ParseError, SchemaError, UnitError, UnknownName
from flighttest.records.readers.columns import column_called, unit_of_column
from flighttest.records.readers.name_map import Channel, NameMap
from flighttest.records.readers.recording import LeftOut, RecordedTable, left_out_as

ColumnPlace = tuple[str, str]
"""Table and column."""


@dataclass
class MappedColumns:
    """Columns that the channels of a name map read.

    Attributes
    ----------
    places : dict of str to dict of str to ColumnPlace
        Leaf -> canonical name -> table and column.
    absent : list of str
        Columns of optional channels that the file does not have.
    notes : list of str
        Sentences about channels that depend on an omitted column.
    """

    places: dict[str, dict[str, ColumnPlace]] = field(default_factory=dict)
    absent: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def locate_columns(
    mapping: NameMap, tables: Mapping[str, RecordedTable], path: Path, left_out: Sequence[LeftOut]
) -> MappedColumns:
    """Return the column of each channel of a name map.

    Raises
    ------
    UnknownName
        One required column is not in the file.
    ParseError
        One required column has content that a record cannot hold.
    UnitError
        The unit of one column does not fit its channel.
    SchemaError
        Several of these problems.
    """
    mapped = MappedColumns()
    problems: list[AeromatchError] = []
    # Place and reason of an omitted column -> channels that need it.
    omitted: dict[str, list[str]] = {}
    for leaf, channels in mapping.leaves.items():
        places = mapped.places[leaf] = {}
        for name, channel in channels.items():
            try:
                table, column = _locate(leaf, channel, tables, path)
            except UnknownName as error:
                omission = _find_omission(leaf, channel, left_out)
                if omission is not None and not omission.remedy:
                    text = f"{omission.place} ({omission.reason})"
                    omitted.setdefault(text, []).append(name)
                if _is_dispensable(channel, omission):
                    mapped.absent.append(channel.columns[0])
                elif omission is not None:
                    problems.append(damaged_column(name, omission, path))
                else:
                    problems.append(error)
                continue
            places[name] = table, column
            unit_problem = _check_unit(channel, name, tables[table], column)
            if unit_problem is not None:
                problems.append(unit_problem)
    if len(problems) == 1:
        raise problems[0]
    if problems:
        texts = [str(problem) for problem in problems]
        raise SchemaError(f"name map {mapping.source} for {path.name}", texts)
    for text, names in omitted.items():
        mapped.notes.append(f"{text}: left out, and with it {', '.join(names)}")
    return mapped


def _find_omission(leaf: str, channel: Channel, left_out: Sequence[LeftOut]) -> LeftOut | None:
    """Return the first omitted part of the file that is a column of the channel."""
    for column in channel.columns:
        omission = left_out_as(column, leaf, left_out)
        if omission is not None:
            return omission
    return None


def _is_dispensable(channel: Channel, omission: LeftOut | None) -> bool:
    """Return whether a record may lack the channel."""
    if omission is None:
        return channel.optional
    # A damaged column of numbers is an error even for an optional channel.
    if omission.fault:
        return False
    return channel.optional or not omission.remedy


def damaged_column(name: str, omission: LeftOut, path: Path) -> ParseError:
    """Return the error of a channel whose column a record cannot hold."""
    content = omission.reason
    if not omission.fault:
        content = f"{omission.reason} in {omission.place}"
    text = f"{content}, which the name map reads as {name}"
    return ParseError(str(path), omission.line, text, omission.remedy)


def _check_unit(channel: Channel, name: str, table: RecordedTable, column: str) -> UnitError | None:
    """Return the error of a unit that does not fit the channel."""
    try:
        channel.convert(np.zeros(0), unit_of_column(table, column, name), name)
    except UnitError as error:
        return error
    return None


def _locate(
    leaf: str, channel: Channel, tables: Mapping[str, RecordedTable], path: Path
) -> ColumnPlace:
    """Return table and column of a channel, from the first of its columns in the file."""
    first_error: UnknownName | None = None
    for column in channel.columns:
        try:
            return _locate_column(leaf, column, tables, path)
        except UnknownName as error:
            first_error = first_error or error
    assert first_error is not None
    raise first_error


def _locate_column(
    leaf: str, requested: str, tables: Mapping[str, RecordedTable], path: Path
) -> ColumnPlace:
    """Return table and column that a text of a name map means."""
    # A table of one column may be named alone.
    if requested in tables and len(tables[requested].columns) == 1:
        return requested, next(iter(tables[requested].columns))
    # Names of tables and of columns may hold slashes, so that the longest table is tried first.
    for table in sorted(tables, key=len, reverse=True):
        if requested.startswith(table + "/"):
            column = column_called(requested[len(table) + 1 :], tables[table])
            if column:
                return table, column
    # A slash may also belong to the unit of a heading of the table of the leaf.
    leaf_table = _table_of_leaf(leaf, tables)
    table = leaf_table or "data"
    if table in tables:
        column = column_called(requested, tables[table])
        if column:
            return table, column
    group, _, heading = requested.rpartition("/")
    group = group or leaf_table or ""
    if group not in tables:
        raise UnknownName(
            group or leaf,
            tables,
            what="table",
            hint=f"{path.name} holds no such group for column {requested!r}; write group/column",
        )
    if heading not in tables[group].columns:
        raise UnknownName(
            heading,
            tables[group].columns,
            what="column",
            hint=f"the name map requires it in {path.name}, table {group}",
        )
    return group, heading


def _table_of_leaf(leaf: str, tables: Mapping[str, RecordedTable]) -> str | None:
    """Return the table with the name of the leaf, else the only table."""
    if leaf in tables:
        return leaf
    if len(tables) == 1:
        return next(iter(tables))
    return None
