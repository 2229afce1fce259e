"""Arrays in groups, as HDF5 and MATLAB files hold them, as tables.

A group (structure) with a clock among its arrays is a table of its own; one without adds its arrays
to the group above it, as ``group.array``.  Three layouts of structures are known besides plain
arrays: ``data`` with ``units`` or ``description`` is one array; Simulink's structure with time
(``time``, ``signals.values``, ``signals.label``); and matrices, of which every column is one.
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
    """An array of a file, read when it is requested; `stderr` is the standard error that the file
    states, in its unit.
    """

    shape: tuple[int, ...]
    load: Callable[[], Any]
    unit: str | None = None
    stderr: float | None = None

    @classmethod
    def of(cls, values: np.ndarray, unit: str | None = None) -> Array:
        """Return an array that is in memory already."""
        return cls(values.shape, partial(_itself, values), unit)

    @property
    def size(self) -> int:
        """Number of values."""
        return int(np.prod(self.shape, dtype=np.int64))


@dataclass
class Group:
    """Arrays and groups by name, the flags that a record written by this package carries, and what
    is no array, with the reason.
    """

    arrays: dict[str, Array] = field(default_factory=dict)
    groups: dict[str, Group] = field(default_factory=dict)
    flags: str = ""
    left_out: dict[str, str] = field(default_factory=dict)


def nested_tables(root: Group, names: NameMap) -> tuple[dict[str, RecordedTable], list[LeftOut]]:
    """Return the tables of nested arrays, those of the root called ``data``, and the arrays that
    are left out.
    """
    found: dict[str, RecordedTable] = {}
    left_out = _no_arrays(root, "")
    left = _collect(root, "", names, (found, left_out))
    if left:
        found = {ROOT: _table(left, ROOT, names, root.flags, left_out), **found}
    return found, left_out


def _no_arrays(group: Group, place: str) -> list[LeftOut]:
    """Return what is no array of numbers in a group and those inside it."""
    left_out = [
        LeftOut(f"{place}{name}", reason, _REMEDY) for name, reason in group.left_out.items()
    ]
    for name, inner in group.groups.items():
        left_out += _no_arrays(inner, f"{place}{name}/")
    return left_out


def as_one_array(group: Group, texts: dict[str, str]) -> Array | None:
    """Return the array of a structure that is one channel: ``data`` next to ``units`` or
    ``description``.
    """
    if "data" not in group.arrays or not texts:
        return None
    data = group.arrays["data"]
    unit = texts.get("units", texts.get("unit", data.unit))
    return Array(data.shape, data.load, unit or None)


def _collect(
    group: Group, place: str, names: NameMap, found: tuple[dict[str, RecordedTable], list[LeftOut]]
) -> dict[str, Array]:
    """Add the tables of a group, and what they leave out, to `found` and return its arrays when it
    has no clock.
    """
    arrays = dict(group.arrays)
    for name, inner in group.groups.items():
        path = f"{place}/{name}" if place else name
        for key, array in _collect(inner, path, names, found).items():
            arrays[f"{name}.{key}"] = array
    if place and (
        _clock_name(arrays, place, names) is not None or names.clock_of(place).rate is not None
    ):
        found[0][place] = _table(arrays, place, names, group.flags, found[1])
        return {}
    return arrays


def _clock_name(arrays: Mapping[str, Array], place: str, names: NameMap) -> str | None:
    wanted = names.clock_of(place).column
    if (
        wanted is not None and wanted not in arrays and "/" in wanted
    ):  # table/column: the stamps of that table
        table, _, wanted = wanted.rpartition("/")
        wanted = wanted if table == place else None
    choice = (wanted,) if wanted is not None else CLOCK_NAMES
    return next((name for name in choice if name in arrays and arrays[name].size > 1), None)


def _table(
    arrays: Mapping[str, Array], place: str, names: NameMap, flags: str, left_out: list[LeftOut]
) -> RecordedTable:
    clock = _clock_name(arrays, place, names)
    longest = Counter(max(array.shape) for array in arrays.values() if array.size > 1)
    length = arrays[clock].size if clock else longest.most_common(1)[0][0] if longest else 1
    loaders: dict[str, Callable[[], Any]] = {}
    units: dict[str, str] = {}
    errors: dict[str, float] = {}
    for name, array in arrays.items():
        columns = columns_of_array(name, array.shape, length)
        if not columns:
            left_out.append(LeftOut(f"{place}/{name}", not_spread(array.shape, length), _REMEDY))
        load = (
            cache(array.load) if len(columns) > 1 else array.load
        )  # a matrix is read once, not once for each column
        for column, take in columns.items():
            loaders[column] = partial(_taken, load, take)
            if array.unit:
                units[column] = array.unit
            if array.stderr is not None:
                errors[column] = array.stderr
    return RecordedTable(Columns(loaders), units, flags=flags, errors=errors)


def _taken(load: Callable[[], Any], take: Callable[[Any], np.ndarray]) -> np.ndarray:
    return take(np.asarray(load()))


def _itself(values: np.ndarray) -> np.ndarray:
    return values
