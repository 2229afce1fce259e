"""Commands that take a column of the recordings as another quantity, in another unit or sign."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from aeromatch.drafting.name_map.name_rows import leaf_of
from aeromatch.workbench.allowed_actions import PROJECT, ActionError
from aeromatch.workbench.new_project.sources import recordings_of
from aeromatch.workbench.opened import OpenProject
from flightmech.errors import UnitError, UnknownName
from flightmech.names import lookup
from flightmech.units import fitted_unit, parse_unit
from flighttest.records.readers.channel_correction import line_of
from flighttest.records.readers.columns import unit_of_column
from flighttest.records.readers.name_map import Channel, NameMap
from flighttest.records.readers.name_map_reading import read_names
from flighttest.records.readers.opening import open_recording
from flighttest.records.readers.recording import RecordedTable

_FILE = "names.toml"
_SIGNS = {"+": 1, "-": -1}
NOT_TAKEN = "-"
"""Quantity of a column that gives no channel."""


def edit_column(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the commands that change the line of a column in the name map of the project.

    The query has ``column``, ``quantity`` (``-`` for a column without a channel), ``unit`` (empty
    for that of the heading) and ``sign`` (``+`` or ``-``). The result has the ``commands``, and the
    ``unit`` that they give the column. ``problem`` is empty, or states why there are no commands,
    such as a column without a unit.

    Raises
    ------
    SchemaError, ParseError
        The name map has problems.
    """
    try:
        return {**_commands_of(opened, query), "problem": ""}
    except (ActionError, UnknownName) as error:
        return {"commands": [], "unit": "", "problem": str(error)}


def _commands_of(opened: OpenProject, query: Mapping[str, str]) -> dict[str, Any]:
    file = opened.file.parent / _FILE
    if not file.exists():
        raise ActionError(f"no {_FILE} in {file.parent}; draft the project first")
    names = read_names(file)
    column, quantity = query.get("column", ""), query.get("quantity", "")
    lines = []
    for leaf, channels in names.leaves.items():
        for name, channel in channels.items():
            if column in channel.columns:
                lines.append((leaf, name))
    if quantity == NOT_TAKEN:
        return {"commands": [_removal(*line) for line in lines], "unit": ""}
    lookup(quantity)
    sign = _SIGNS.get(query.get("sign", "+"))
    if sign is None:
        raise ActionError(f"sign {query['sign'][:10]!r}; + or -")
    table, content, tables = _find_table(opened, column)
    stated = content.units.get(column.removeprefix(f"{table}/"))
    # Without a leaf of its own, the quantity gets that of a draft.
    places = [leaf for leaf, channels in names.leaves.items() if quantity in channels]
    leaf = places[0] if places else leaf_of(quantity, table, tables)
    old = names.leaves.get(leaf, {}).get(quantity)
    unit = _chosen_unit(content, column.removeprefix(f"{table}/"), quantity, query.get("unit", ""))
    # The reader uses the unit of the file, so the map does not repeat it.
    changes: dict[str, Any] = {"unit": None if stated and unit == stated else unit, "sign": sign}
    if old is not None and column in old.columns:
        channel = old.model_copy(update=changes)
    else:
        is_optional = any(names.leaves[leaf][name].optional for leaf, name in lines)
        channel = Channel(column=column, optional=is_optional, **changes)
    text = line_of(quantity, channel).partition(" = ")[2]
    commands = [["set", f"{PROJECT}/{_FILE}", f"{leaf}.{quantity}", text]]
    commands += [_removal(*line) for line in lines if line[1] != quantity]
    return {"commands": commands, "unit": unit}


def _removal(leaf: str, name: str) -> list[str]:
    return ["set", f"{PROJECT}/{_FILE}", f"{leaf}.{name}", "--remove"]


def _tables_of(file: Path) -> dict[str, RecordedTable]:
    return open_recording(file, NameMap({})).tables


def _find_table(
    opened: OpenProject, column: str
) -> tuple[str, RecordedTable, dict[str, RecordedTable]]:
    """Return name and content of the table of a column, and all tables of its recording.

    Raises
    ------
    ActionError
        No recording has the column.
    """
    for file in recordings_of(opened).values():
        # Without the values: a reader of large files gives them at their first request.
        tables = opened.kept(("tables",), [file], partial(_tables_of, file))
        for table, content in tables.items():
            if column in content.columns or column.removeprefix(f"{table}/") in content.columns:
                return table, content, tables
    raise ActionError(f"no recording has the column {column[:60]!r}")


def _chosen_unit(content: RecordedTable, column: str, quantity: str, given: str) -> str:
    """Return the unit of a column: the given one, or that of the file or the heading.

    A column without a unit is never taken as SI in silence.
    """
    expected = lookup(quantity).units
    unit = given or unit_of_column(content, column, quantity) or ""
    if not unit:
        if expected == "1":
            return "1"
        raise ActionError(
            f"neither the file nor the heading of {column!r} states a unit; choose the unit that "
            f"was recorded, of the kind of {expected}"
        )
    try:
        is_same_kind = parse_unit(fitted_unit(unit, expected))[0] == parse_unit(expected)[0]
    except UnitError as error:
        raise ActionError(f"{column!r}: {error}") from error
    if not is_same_kind:
        raise ActionError(
            f"{column!r} is in {unit}, and {quantity} is in {expected}; choose another quantity, "
            f"or the unit that was recorded"
        )
    return unit


ROUTES = {("GET", "/api/new/column"): edit_column}
"""Requests of the table of columns, in the form of `records.ROUTES`."""
