"""Tables of arrays in groups, as HDF5 and MATLAB files hold them.

A group (structure) with a clock among its arrays is a table.  A group without a clock adds its
arrays to the group above it, as ``group.array``.  Three layouts are read besides plain arrays:
``data`` with ``units`` or ``description`` is one array; Simulink's structure with time (``time``,
``signals.values``, ``signals.label``); and a matrix, whose columns are one array each.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np

from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.recording import (
    CLOCK_NAMES,
    Columns,
    LeftOut,
    RecordedTable,
    columns_of_array,
    not_spread,
)

ROOT = "data"
_REMEDY = "map an array of numbers with one value, or one row, for each sample of its clock"


class Array(NamedTuple):
    """An array of a file, which is read when it is requested.

    `stderr` is the standard error that the file states, in the unit of the array.
    """

    shape: tuple[int, ...]
    load: Callable[[], Any]
    unit: str | None = None
    stderr: float | None = None

    @classmethod
    def of(cls, values: np.ndarray, unit: str | None = None) -> Array:
        """Return an array that is in memory already."""
        return cls(values.shape, partial(np.asarray, values), unit)

    @property
    def size(self) -> int:
        """Number of values."""
        return int(np.prod(self.shape, dtype=np.int64))


@dataclass
class Group:
    """Arrays and groups by name.

    Attributes
    ----------
    arrays : dict of str to Array
    groups : dict of str to Group
    flags : str
        Flags that a record of this package carries, else empty.
    left_out : dict of str to str
        Items that are not arrays of numbers -> reason.
    """

    arrays: dict[str, Array] = field(default_factory=dict)
    groups: dict[str, Group] = field(default_factory=dict)
    flags: str = ""
    left_out: dict[str, str] = field(default_factory=dict)


def nested_tables(root: Group, names: NameMap) -> tuple[dict[str, RecordedTable], list[LeftOut]]:
    """Return the tables of nested arrays, and the omitted arrays.

    The table of the root is ``data``.
    """
    left_out = _omitted_items(root, "")
    tables: dict[str, RecordedTable] = {}
    arrays = _collect_tables(root, "", names, tables=tables, left_out=left_out)
    if arrays:
        root_table = _table(arrays, ROOT, names, flags=root.flags, left_out=left_out)
        tables = {ROOT: root_table, **tables}
    return tables, left_out


def _omitted_items(group: Group, prefix: str) -> list[LeftOut]:
    """Return the items of a group and of its inner groups that are not arrays of numbers."""
    left_out = []
    for name, reason in group.left_out.items():
        left_out.append(LeftOut(f"{prefix}{name}", reason, _REMEDY))
    for name, inner in group.groups.items():
        left_out += _omitted_items(inner, f"{prefix}{name}/")
    return left_out


def as_one_array(group: Group, texts: dict[str, str]) -> Array | None:
    """Return the array of a structure that is one channel.

    Such a structure has ``data`` next to ``units`` or ``description``.
    """
    if "data" not in group.arrays or not texts:
        return None
    data = group.arrays["data"]
    unit = texts.get("units", texts.get("unit", data.unit))
    return Array(data.shape, data.load, unit or None)


def _collect_tables(
    group: Group,
    path: str,
    names: NameMap,
    tables: dict[str, RecordedTable],
    left_out: list[LeftOut],
) -> dict[str, Array]:
    """Add the tables of a group to `tables` and return the arrays that have no clock."""
    arrays = dict(group.arrays)
    for name, inner in group.groups.items():
        inner_path = f"{path}/{name}" if path else name
        inner_arrays = _collect_tables(inner, inner_path, names, tables=tables, left_out=left_out)
        for key, array in inner_arrays.items():
            arrays[f"{name}.{key}"] = array
    if not path:
        return arrays
    if _clock_name(arrays, path, names) is None and names.clock_of(path).rate is None:
        return arrays
    tables[path] = _table(arrays, path, names, flags=group.flags, left_out=left_out)
    return {}


def _clock_name(arrays: Mapping[str, Array], path: str, names: NameMap) -> str | None:
    """Return the array that is the clock of a group, None if there is none."""
    column = names.clock_of(path).column
    if column is not None and column not in arrays and "/" in column:
        # TABLE/COLUMN of the name map is the clock of that table only.
        table, _, column_of_table = column.rpartition("/")
        column = column_of_table if table == path else None
    candidates = CLOCK_NAMES if column is None else (column,)
    for name in candidates:
        if name in arrays and arrays[name].size > 1:
            return name
    return None


def _table(
    arrays: Mapping[str, Array],
    path: str,
    names: NameMap,
    flags: str,
    left_out: list[LeftOut],
) -> RecordedTable:
    """Return the table of a group and add its omitted arrays to `left_out`."""
    length = _sample_count(arrays, _clock_name(arrays, path, names))
    loaders: dict[str, Callable[[], Any]] = {}
    units: dict[str, str] = {}
    errors: dict[str, float] = {}
    for name, array in arrays.items():
        columns = columns_of_array(name, array.shape, length)
        if not columns:
            reason = not_spread(array.shape, length)
            left_out.append(LeftOut(f"{path}/{name}", reason, _REMEDY))
        load = array.load
        if len(columns) > 1:
            load = cache(load)  # a matrix is read once, not once for each column
        for column, select in columns.items():
            loaders[column] = partial(_load_column, load, select)
            if array.unit:
                units[column] = array.unit
            if array.stderr is not None:
                errors[column] = array.stderr
    return RecordedTable(Columns(loaders), units, flags=flags, errors=errors)


def _sample_count(arrays: Mapping[str, Array], clock: str | None) -> int:
    """Return the size of the clock, else the most frequent longest dimension."""
    if clock is not None:
        return arrays[clock].size
    dimensions = Counter(max(array.shape) for array in arrays.values() if array.size > 1)
    if not dimensions:
        return 1
    return dimensions.most_common(1)[0][0]


def _load_column(load: Callable[[], Any], select: Callable[[Any], np.ndarray]) -> np.ndarray:
    """Return one column of an array of the file."""
    return select(np.asarray(load()))
