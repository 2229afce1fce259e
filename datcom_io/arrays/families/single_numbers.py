"""Stacking of numbers that are printed one by one into arrays: SI, a flag for every value.

Such a number has a label, or stands in a row of its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from datcom_io.arrays.leaves import LeafBuilder, empty_cells
from datcom_io.arrays.stacking import Stacker
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
    """Return the numbers of a group by their labels.

    With a subject, only numbers whose labels begin with it are returned, without the subject.
    """
    start = ""
    if subject:
        start = f"{subject} "
    # Lists are faster than arrays for single numbers.
    cells = zip(group.labels, group.lines, group.values.tolist(), group.flags.tolist())
    numbers = {}
    for label, line, value, flag in cells:
        if label.startswith(start):
            numbers[label.removeprefix(start)] = PrintedNumber(line, value, flag)
    return numbers


def row_numbers(table: PrintedTable, k: int = 0) -> dict[str, PrintedNumber]:
    """Return the numbers of a row by their columns."""
    cells = zip(table.columns, table.values[k].tolist(), table.flags[k].tolist())
    return {
        column.name: PrintedNumber(table.lines[k], value, flag) for column, value, flag in cells
    }


class NumberStack:
    """Collects single numbers into the variables of a leaf.

    Parameters
    ----------
    stacker : Stacker
    axes : mapping of str to sequence or None
        Dimensions to coordinate values, None for the dimension ``condition``; the coordinate
        ``lines`` goes along the first one.
    """

    def __init__(self, stacker: Stacker, axes: Mapping[str, Sequence[Any] | None]):
        self.stacker = stacker
        self.lines_axis = next(iter(axes))
        self.lines: dict[int, list[int]] = {}  # of all numbers, by index along the first dimension
        self.sizes: dict[str, int] = {}
        coords: dict[str, xr.Variable] = {}
        if "condition" in axes:
            coords = stacker.make_coords([stacker.condition_axis()])
        for name, values in axes.items():
            if values is None:
                self.sizes[name] = len(stacker.conditions)
                continue
            self.sizes[name] = len(values)
            attrs = {}
            if name in VOCABULARY:
                attrs = quantity_attributes(name)
            coords[name] = xr.Variable(name, np.array(values), attrs)
        self.leaf = LeafBuilder(coords)

    def add(
        self, columns: Iterable[PrintedColumn], dims: Sequence[str], items: Iterable[Item]
    ) -> None:
        """Add a variable over `dims` for each column, from the numbers of its name."""
        # Every column becomes a variable; places without a number stay absent.
        shape = tuple(self.sizes[dim] for dim in dims)
        items = list(items)
        for column in columns:
            value, flag = empty_cells(shape)
            for index, page, numbers in items:
                number = numbers.get(column.name)
                if number is None:
                    continue
                if flag[index] != ABSENT:
                    raise ParseError(
                        self.stacker.case.file,
                        number.line,
                        f"a second {column.name} for the place of an earlier one",
                        f"one for each {' and '.join(dims)}",
                    )
                # Other flags have no number; their value stays NaN.
                if number.flag in (OK, SUSPECT):
                    value[index] = number.value * self.stacker.column_factor(column, page)
                flag[index] = number.flag
                self.lines.setdefault(index[0], []).append(number.line)
            self.leaf.add_described(column, dims, value, flag)
            if column.units in _PER:
                self.leaf[column.quantity].attrs["per"] = _PER[column.units]

    def finish(self, **attributes: str) -> LeafBuilder:
        """Return the leaf with its attributes and the range of lines of its numbers."""
        # The lines of all variables along the first dimension, as first and last one.
        ranges = np.full(self.sizes[self.lines_axis], "", dtype=object)
        for k, lines in self.lines.items():
            ranges[k] = f"{min(lines)}-{max(lines)}"
        self.leaf.coords["lines"] = xr.Variable(self.lines_axis, ranges.astype(str))
        return self.leaf.describe({}, **attributes)
