"""Stacking of the printed tables of one case into arrays: SI, radians, a flag for every value."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from datcom_io.arrays.conditions import PagePlace, PrintedCondition, si_factor
from datcom_io.arrays.leaves import (
    OF_DIM,
    LeafBuilder,
    describe_quantity,
    empty_cells,
    unit_factor,
)
from datcom_io.cells import BLANK, FILLED, OK, is_number_flag
from datcom_io.printout.content import Page, PrintedCase
from datcom_io.printout.layouts.notes import FOOTNOTE_WORDS, list_footnote_words
from datcom_io.printout.rows import PrintedColumn
from datcom_io.printout.tables import PrintedTable, PrintedValues
from flightmech.errors import ParseError
from flightmech.units import DEGREE

# Half of the last printed digit of alpha and deflections, and a little for binary rounding. [deg]
HALF_UNIT = 0.0501
_CONDITION_UNITS = {
    "mach": "1",
    "h": "m",
    "V": "m s-1",
    "p_static": "Pa",
    "temperature": "K",
    "reynolds_per_m": "m-1",
}

PlacedTable = tuple[PagePlace, Page, PrintedTable]
"""A printed table, its page, and the place of the page."""


class StackedAxis(NamedTuple):
    """A dimension with its coordinate, in ``deg`` or in SI."""

    name: str
    values: Sequence[Any]
    units: str = ""


class Stacker:
    """Stacks the printed tables of one case into arrays.

    Parameters
    ----------
    case : PrintedCase
    conditions : list of PrintedCondition
        Flight conditions along the dimension ``condition``.
    spots : dict of int to PagePlace
        Place of each page by its first line; pages without a place are left out.
    fill_transonic : bool
        Also fill columns that are constant in alpha on transonic pages.
    """

    def __init__(
        self,
        case: PrintedCase,
        conditions: list[PrintedCondition],
        spots: dict[int, PagePlace],
        fill_transonic: bool,
    ):
        self.case = case
        self.conditions = conditions
        self.spots = spots
        self.fill_transonic = fill_transonic

    # Tables and axes of the case.

    def placed_tables(self, name: str) -> list[PlacedTable]:
        """Return place, page and table of every table of a kind that has a place."""
        # The program prints rows for angles that NALPHA counts and the cards do not give.
        most_rows = len(self.alphas()) or None
        placed = []
        for page, table in self.case.tables(name):
            if page.first not in self.spots:
                continue
            if table.layout.rows == ("FLTCON", "NALPHA"):
                table = table.first_rows(most_rows)
            placed.append((self.spots[page.first], page, table))
        return placed

    def placed_values(self, name: str) -> list[tuple[PagePlace, Page, PrintedValues]]:
        """Return place, page and group of every group of a kind that has a place."""
        placed = []
        for page, group in self.case.values(name):
            if page.first in self.spots:
                placed.append((self.spots[page.first], page, group))
        return placed

    def alphas(self) -> list[float]:
        """Return the angles of attack of the input cards. [deg]"""
        return self.case.deck.schedule("FLTCON", "ALSCHD", "NALPHA")

    def condition_axis(self) -> StackedAxis:
        """Return the axis of the flight conditions of the case."""
        return StackedAxis("condition", list(range(len(self.conditions))))

    def row_axis(
        self, placed: list[PlacedTable], name: str, exact: Sequence[float], column: int = 0
    ) -> StackedAxis:
        """Return the axis of the rows: the values of the deck, or the printed ones without a deck.
        [deg]

        All tables must agree with it.
        """
        values = list(exact)
        if not values:
            longest = max((table for _, _, table in placed), key=lambda table: len(table.rows))
            values = [float(x) for x in longest.values[:, column]]
        for _, _, table in placed:
            printed = table.values[:, column]
            self.check_axis(table.columns[column].name, printed, exact=values, lines=table.lines)
        return StackedAxis(name, values, "deg")

    def check_axis(
        self,
        name: str,
        printed: np.ndarray,
        exact: Sequence[float],
        lines: Sequence[int],
        half_unit: float = HALF_UNIT,
        units: str = "deg",
    ) -> None:
        """Raise if printed axis values differ from those of the deck by more than the half unit.

        `half_unit` is half of the last printed digit.
        """
        file = self.case.file
        if len(printed) > len(exact):
            expected = f"{len(exact)} as in the input cards"
            raise ParseError(file, lines[-1], f"{len(printed)} values of {name}", expected)
        unit = ""
        if units != "1":
            unit = f" {units}"
        for line, value, exact_value in zip(lines, printed, exact):
            if abs(value - exact_value) <= half_unit:
                continue
            # NDM is printed for an angle that the cards do not give: NaN on both sides.
            if not (np.isnan(value) and np.isnan(exact_value)):
                expected = f"{exact_value:g}{unit} as in the input cards of the case"
                if len(printed) == len(exact) and np.allclose(printed, -np.array(exact)):
                    expected += (
                        f". The whole column {name} has the opposite sign: it was changed after "
                        f"DATCOM had written it. Give the listing as DATCOM wrote it, with "
                        f"deflections positive trailing edge down"
                    )
                raise ParseError(file, line, f"{name} = {value:g}{unit}", expected)

    # Numbers of one printed column.

    def read_column(
        self, column: PrintedColumn, page: Page, table: PrintedTable
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return a printed column in SI and its flags.

        A constant column is filled downwards where that is allowed.
        """
        k = table.columns.index(column)
        flag = table.flags[:, k].copy()
        value = self.to_si(column, page, table.values[:, k], flag)
        # On a transonic page the first row is the value at zero lift, not that of all rows.
        transonic = self.case.deck.regime(page.condition("mach")) == "transonic"
        may_fill = column.constant and (self.fill_transonic or not transonic)
        if may_fill and len(flag) > 1 and (flag[1:] == BLANK).all():
            value[1:] = value[0]
            flag[1:] = FILLED if flag[0] == OK else flag[0]
        return value, flag

    def to_si(
        self, column: PrintedColumn, page: Page, value: np.ndarray, flag: np.ndarray
    ) -> np.ndarray:
        """Return printed numbers of a column in SI, NaN where no number is printed."""
        return np.where(is_number_flag(flag), value * self.column_factor(column, page), np.nan)

    def column_factor(self, column: PrintedColumn, page: Page) -> float:
        """Return the factor from the printed numbers of a column to SI."""
        if column.units == "1/angle":
            per = page.per or self.case.deck.deriv.lower()
            return 1.0 / DEGREE if per == "deg" else 1.0
        if column.units in OF_DIM:
            return si_factor(column.units, page.dim)
        return unit_factor(column.units)

    # Arrays of many tables.

    def stack(
        self,
        columns: Sequence[PrintedColumn],
        axes: list[StackedAxis],
        rows: StackedAxis,
        items: list[tuple[list[int], Page, PrintedTable]],
    ) -> LeafBuilder:
        """Return tables as arrays (axes..., rows).

        `items` holds the index along the axes, page and table of each table.
        """
        dims = tuple(axis.name for axis in axes)
        shape = tuple(len(axis.values) for axis in axes)
        cells = [(tuple(index), page, table) for index, page, table in items]
        lines = self.line_ranges(shape, [(index, table) for index, _, table in cells])
        leaf = LeafBuilder(self.make_coords([*axes, rows]))
        for column in columns:
            value, flag = empty_cells((*shape, len(rows.values)))
            for index, page, table in cells:
                column_value, column_flag = self.read_column(column, page, table)
                # A table may end before the last row of the axis.
                value[index][: len(column_value)] = column_value
                flag[index][: len(column_flag)] = column_flag
            leaf.add_described(column, (*dims, rows.name), value, flag)
        leaf.coords["lines"] = xr.Variable(dims, lines)
        pages = [(index, page) for index, page, _ in cells]
        leaf.coords["notes"] = self.footnotes(dims, shape, pages)
        return leaf

    def stack_over_alpha(self, placed: list[PlacedTable], alphas: StackedAxis) -> LeafBuilder:
        """Return tables of one kind as arrays (condition, alpha).

        The tables have one row per alpha and one page per flight condition.
        """
        return self.stack_over_rows(placed[0][2].columns[1:], placed, alphas)

    def stack_over_rows(
        self, columns: Sequence[PrintedColumn], placed: list[PlacedTable], rows: StackedAxis
    ) -> LeafBuilder:
        """Return tables of one kind, one page per flight condition, as arrays (condition, rows)."""
        items = [([spot.condition], page, table) for spot, page, table in placed]
        return self.stack(columns, [self.condition_axis()], rows=rows, items=items)

    def add_two_way(
        self,
        leaf: LeafBuilder,
        placed: list[PlacedTable],
        across: StackedAxis,
        heading: Sequence[float] | None = None,
        half_unit: float = HALF_UNIT,
    ) -> None:
        """Add two-way tables as a variable (condition, alpha, across).

        `heading` holds the expected heading values where they are not those of the axis.
        """
        layout_axis = placed[0][2].layout.across
        assert layout_axis is not None
        column = layout_axis.cell
        expected = across.values
        if heading is not None:
            expected = heading
        for _, _, table in placed:
            assert table.across is not None
            lines = [table.across_line] * len(table.across)
            self.check_axis(layout_axis.name, table.across, expected, lines, half_unit=half_unit)
        alphas = self.row_axis(placed, "alpha", self.alphas())
        value, flag = empty_cells((len(self.conditions), len(alphas.values), len(across.values)))
        for spot, page, table in placed:
            # The first column of the table is alpha.
            rows, count = len(table.rows), len(table.columns) - 1
            numbers, codes = table.values[:, 1:], table.flags[:, 1:]
            flag[spot.condition, :rows, :count] = codes
            value[spot.condition, :rows, :count] = self.to_si(column, page, numbers, codes)
        leaf.coords["alpha"] = self.make_coords([alphas])["alpha"]
        leaf.add_described(column, ("condition", "alpha", across.name), value, flag)
        leaf.coords[f"lines_{column.quantity}"] = self.line_ranges_by_condition(placed)

    # Coordinates.

    @staticmethod
    def footnotes(
        dims: Sequence[str], shape: tuple[int, ...], items: Iterable[tuple[Sequence[int], Page]]
    ) -> xr.Variable:
        """Return the footnotes that change what a table means, at the place of each table.

        They are words of `FOOTNOTE_WORDS`; the attributes explain them.
        """
        words_of_page = np.full(shape, "", dtype=object)
        for index, page in items:
            texts = [note.text for note in page.notes]
            words_of_page[tuple(index)] = " ".join(list_footnote_words(texts))
        meanings = {}
        for text in words_of_page.ravel():
            for word in text.split():
                meanings[word] = FOOTNOTE_WORDS[word]
        return xr.Variable(dims, words_of_page.astype(str), meanings)

    def line_ranges(
        self, shape: tuple[int, ...], items: Iterable[tuple[Sequence[int], PrintedTable]]
    ) -> np.ndarray:
        """Return the range of lines of each table at its place; two tables at one place raise."""
        ranges = np.full(shape, "", dtype=object)
        for index, table in items:
            earlier = ranges[tuple(index)]
            if earlier:
                raise ParseError(
                    self.case.file,
                    table.lines[0],
                    f"a second {table.name} table for the place of the one at lines {earlier}",
                    "one table per configuration, condition, height and deflection",
                )
            ranges[tuple(index)] = f"{table.lines[0]}-{table.lines[-1]}"
        return ranges.astype(str)

    def line_ranges_by_condition(self, placed: list[PlacedTable]) -> xr.Variable:
        """Return the range of lines of each table, one table for each flight condition."""
        items = [((spot.condition,), table) for spot, _, table in placed]
        return xr.Variable("condition", self.line_ranges((len(self.conditions),), items))

    @staticmethod
    def make_coordinate(axis: StackedAxis) -> xr.Variable:
        """Return the coordinate of an axis."""
        values, units = np.array(axis.values), axis.units
        if units == "deg":
            values, units = values * DEGREE, "rad"
        return xr.Variable(axis.name, values, describe_quantity(axis.name, units))

    def make_coords(self, axes: Sequence[StackedAxis]) -> dict[str, xr.Variable]:
        """Return the coordinates of axes, and those that name a flight condition."""
        coords = {axis.name: self.make_coordinate(axis) for axis in axes}
        for name, units in _CONDITION_UNITS.items():
            values = np.array([getattr(condition, name) for condition in self.conditions])
            coords[name] = xr.Variable("condition", values, {"units": units})
        for name, text in (("case", self.case.name), ("file", self.case.file)):
            texts = np.array([text] * len(self.conditions), dtype=str)
            coords[name] = xr.Variable("condition", texts)
        return coords
