"""Columns of a printed table.

Columns are 1-based and count the carriage-control column."""

from __future__ import annotations

from typing import NamedTuple


class Column(NamedTuple):
    """One printed column.

    ``units`` is that of the print: ``deg``, ``1``, ``1/deg``, or ``1/angle`` where card DERIV decides between degree and
    radian.  ``quantity`` is the variable's name in the DataTree.  ``constant`` flags a column whose first row may hold for all rows.
    ``words`` flags a column of texts: every cell is ``ok`` with a text and no number.
    """

    name: str
    first: int
    last: int
    quantity: str = ""
    units: str = "1"
    constant: bool = False
    words: bool = False


class Across(NamedTuple):
    """The second axis of a two-way table: its values stand in a heading line, one value column under each.

    ``first`` and ``last`` bound the first heading value, ``cell`` the first value column; both repeat every ``step`` columns.
    """

    name: str
    quantity: str
    first: int
    last: int
    cell: Column
    step: int


Line = tuple[int, str]
