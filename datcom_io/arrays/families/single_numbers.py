"""Stacking numbers that are printed one by one, with a label or in a row of their own, into arrays:
SI, a flag for every value.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from datcom_io.arrays.stacking import LeafBuilder, Stacker
from datcom_io.cells import ABSENT, OK, SUSPECT
from datcom_io.printout.content import Page
from datcom_io.printout.rows import PrintedColumn
from datcom_io.printout.tables import PrintedTable, PrintedValues
from flightmech.errors import ParseError
from flightmech.names import VOCABULARY, quantity_attributes

_PER = {"1/deg": "radian", "1/deg2": "radian squared"}


class PrintedNumber(NamedTuple):
    """One printed number with its flag and line. [as printed]"""

    line: int
    value: float
    flag: int


Numbers = Mapping[str, PrintedNumber]
"""Numbers by their printed name."""
Item = tuple[tuple[int, ...], Page, Numbers]
"""Index along the dimensions, page and numbers."""


def labelled_numbers(group: PrintedValues, subject: str = "") -> dict[str, PrintedNumber]:
    """Return the numbers of a group; with a subject only those whose labels begin with it, without
    it.
    """
    start = f"{subject} " if subject else ""
    cells = zip(group.labels, group.lines, group.values.tolist(), group.flags.tolist())
    return {
        label.removeprefix(start): PrintedNumber(*cell)
        for label, *cell in cells
        if label.startswith(start)
    }


def row_numbers(table: PrintedTable, k: int = 0) -> dict[str, PrintedNumber]:
    """Return the numbers of a row."""
    cells = zip(table.columns, table.values[k].tolist(), table.flags[k].tolist())
    return {
        column.name: PrintedNumber(table.lines[k], value, flag) for column, value, flag in cells
    }


class NumberStack:
    """A leaf in the making.

    `axes` maps dimensions to coordinate values, None for the dimension ``condition``; the
    coordinate ``lines`` goes over the first one.
    """

    def __init__(self, stacker: Stacker, axes: Mapping[str, Sequence | None]):
        self.stacker, self.axes = stacker, axes
        self.first = next(iter(axes))
        self.leaf = LeafBuilder(
            stacker.coords([stacker.condition_axis()]) if "condition" in axes else {}
        )
        self.sizes = {
            name: len(stacker.conditions if values is None else values)
            for name, values in axes.items()
        }
        for name, values in axes.items():
            if values is not None:
                self.leaf.coords[name] = xr.Variable(
                    name, np.array(values), quantity_attributes(name) if name in VOCABULARY else {}
                )
        self.seen: dict[int, list[int]] = {}

    def add(
        self, columns: Iterable[PrintedColumn], dims: Sequence[str], items: Iterable[Item]
    ) -> None:
        """Add a variable over `dims` for each column, filled where an item has a number of that
        name.
        """
        shape = tuple(self.sizes[dim] for dim in dims)
        items = list(items)
        for column in columns:
            value, flag = np.full(shape, np.nan), np.full(shape, ABSENT, np.uint8)
            for where, page, numbers in items:
                number = numbers.get(column.name)
                if number is None:
                    continue
                if flag[where] != ABSENT:
                    found = f"a second {column.name} for the place of an earlier one"
                    raise ParseError(
                        self.stacker.case.file,
                        number.line,
                        found,
                        f"one for each {' and '.join(dims)}",
                    )
                if number.flag in (OK, SUSPECT):
                    value[where] = number.value * self.stacker.factor(column, page)
                flag[where] = number.flag
                self.seen.setdefault(where[0], []).append(number.line)
            self.leaf.add(column, dims, value, flag)
            if column.units in _PER:
                self.leaf[column.quantity].attrs["per"] = _PER[column.units]

    def finished(self, long_names: Mapping[str, str], **attributes: str) -> LeafBuilder:
        """Return the leaf with long names, attributes and the range of lines of its numbers."""
        lines = np.full(self.sizes[self.first], "", dtype=object)
        for k, numbers in self.seen.items():
            lines[k] = f"{min(numbers)}-{max(numbers)}"
        self.leaf.coords["lines"] = xr.Variable(self.first, lines.astype(str))
        return self.leaf.described(long_names, **attributes)
