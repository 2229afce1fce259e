"""Stacking the printed tables of one case into arrays: SI, radians, a flag for every value."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import xarray as xr

from datcom_io.arrays.conditions import PagePlace, PrintedCondition, si_factor
from datcom_io.cells import ABSENT, BLANK, FILLED, FLAGS, OK, is_number_flag
from datcom_io.printout.content import Page, PrintedCase
from datcom_io.printout.layouts.notes import FOOTNOTE_WORDS, list_footnote_words
from datcom_io.printout.rows import PrintedColumn
from datcom_io.printout.tables import PrintedTable, PrintedValues
from flightmech.errors import ParseError
from flightmech.names import VOCABULARY, quantity_attributes
from flightmech.units import DEGREE, parse_unit

OF_DIM = {
    "length": "m",
    "area": "m2",
    "speed": "m s-1",
    "pressure": "Pa",
    "temperature": "K",
    "reynolds": "m-1",
}  # unit of card DIM
_SI = {"deg": "rad", "lbf": "N", **OF_DIM}
LONG_NAMES = {
    "CN": "normal-force coefficient, body axes",
    "CA": "axial-force coefficient, body axes, positive aft",
    "xcp": "centre of pressure forward of the moment centre, in chords: CM/CN, and CMA/CLA from "
    "the first row without CM or CN on",
    "ground_height": "height of the drawing datum (z = 0) over the ground, infinite in free air",
    "q_ratio": "dynamic pressure at the horizontal tail over that of the free stream",
    "epsilon": "downwash angle at the horizontal tail",
    "epsilon_alpha": "slope of the downwash angle with alpha",
}
_FLAG_ATTRS = {
    "flag_values": " ".join(map(str, range(len(FLAGS)))),
    "flag_meanings": " ".join(FLAGS),
}


class LeafBuilder:
    """Variables and coordinates by name, and attributes.

    Parameters
    ----------
    coords : mapping of str to Variable, optional
    """

    def __init__(self, coords: Mapping[str, xr.Variable] | None = None):
        self.variables: dict[str, xr.Variable] = {}
        self.coords = dict(coords or {})
        self.attrs: dict[str, str | float] = {}

    def __getitem__(self, name: str) -> xr.Variable:
        """Return a variable or a coordinate."""
        return self.variables[name] if name in self.variables else self.coords[name]

    def add(
        self, column: PrintedColumn, dims: Sequence[str], value: np.ndarray, flag: np.ndarray
    ) -> None:
        """Add the numbers of a column [SI] and the variable of their flags."""
        known = (
            quantity_attributes(column.quantity)
            if column.quantity in VOCABULARY
            else {"units": _SI.get(column.units, "1")}
        )
        if column.quantity in LONG_NAMES:
            known["long_name"] = LONG_NAMES[column.quantity]
        if column.units in ("1/angle", "1/deg"):
            known["per"] = "radian"
        self.variables[column.quantity] = xr.Variable(
            dims, value, {**known, "printed_as": column.name}
        )
        self.variables[f"{column.quantity}_flag"] = xr.Variable(dims, flag, _FLAG_ATTRS)

    def add_renamed(self, other: LeafBuilder, names: Mapping[str, str]) -> None:
        """Add the variables and coordinates of another leaf over the same axes, some under other
        names; what is there stays.
        """
        for own, others in ((self.variables, other.variables), (self.coords, other.coords)):
            for name, variable in others.items():
                own.setdefault(names.get(name, name), variable)

    def described(self, long_names: Mapping[str, str], **attributes: str | float) -> LeafBuilder:
        """Give variables and coordinates their long names, those that are there, and the leaf its
        attributes; return the leaf.
        """
        for name, text in long_names.items():
            if name in self.variables or name in self.coords:
                self[name].attrs["long_name"] = text
        self.attrs |= attributes
        return self

    def dataset(self) -> xr.Dataset:
        """Return the leaf as a Dataset."""
        return xr.Dataset({**self.coords, **self.variables}, attrs=self.attrs).set_coords(
            list(self.coords)
        )


HALF_UNIT = 0.0501  # of the axes, printed with one decimal [deg]
_CONDITION_UNITS = {
    "mach": "1",
    "h": "m",
    "V": "m s-1",
    "p_static": "Pa",
    "temperature": "K",
    "reynolds_per_m": "m-1",
}


@lru_cache
def _factor(units: str) -> float:
    return parse_unit(units)[1]


class StackedAxis(NamedTuple):
    """A dimension with its coordinate in SI."""

    name: str
    values: Sequence
    units: str = ""


class Stacker:
    """Stacks the printed tables of one case into arrays."""

    def __init__(
        self,
        case: PrintedCase,
        conditions: list[PrintedCondition],
        spots: dict[int, PagePlace],
        fill_transonic: bool,
    ):
        self.case, self.conditions, self.spots, self.fill_transonic = (
            case,
            conditions,
            spots,
            fill_transonic,
        )

    def placed(self, name: str) -> list[tuple[PagePlace, Page, PrintedTable]]:
        """Return place, page and table of every table of a kind that has a place."""
        most = (
            len(self.alphas()) or None
        )  # rows of angles that NALPHA counts and the cards do not give have no place
        return [
            (
                self.spots[page.first],
                page,
                table.first_rows(most) if table.layout.rows == ("FLTCON", "NALPHA") else table,
            )
            for page, table in self.case.tables(name)
            if page.first in self.spots
        ]

    def placed_values(self, name: str) -> list[tuple[PagePlace, Page, PrintedValues]]:
        """Return place, page and group of every group of a kind that has a place."""
        return [
            (self.spots[page.first], page, group)
            for page, group in self.case.values(name)
            if page.first in self.spots
        ]

    def with_two_way(
        self,
        found: LeafBuilder,
        placed: list[tuple[PagePlace, Page, PrintedTable]],
        across: StackedAxis,
        printed: Sequence[float] | None = None,
        half_unit: float = HALF_UNIT,
    ) -> None:
        """Add two-way tables as a variable (condition, alpha, across); `printed` are the heading
        values when they are not the axis.
        """
        column = placed[0][2].layout.across
        assert column is not None
        wanted = across.values if printed is None else printed
        for _, _, table in placed:
            assert table.across is not None
            self.demand(
                column.name,
                table.across,
                wanted,
                [table.across_line] * len(table.across),
                half_unit,
            )
        alphas = self.axis(placed, "alpha", self.alphas())
        shape = (len(self.conditions), len(alphas.values), len(across.values))
        value, flag = np.full(shape, np.nan), np.full(shape, ABSENT, np.uint8)
        for spot, page, table in placed:
            rows, count = len(table.rows), len(table.columns) - 1
            flag[spot.condition, :rows, :count] = table.flags[:, 1:]
            value[spot.condition, :rows, :count] = self.si(
                column.cell, page, table.values[:, 1:], table.flags[:, 1:]
            )
        found.coords["alpha"] = self.coords([alphas])["alpha"]
        found.add(column.cell, ("condition", "alpha", across.name), value, flag)
        found.coords[f"lines_{column.cell.quantity}"] = self.lines_of_conditions(placed)

    def over_alpha(
        self, placed: list[tuple[PagePlace, Page, PrintedTable]], alphas: StackedAxis
    ) -> LeafBuilder:
        """Return tables of one kind, with one row per alpha and one page per flight condition, as
        arrays (condition, alpha).
        """
        items = [([spot.condition], page, table) for spot, page, table in placed]
        return self.stack(placed[0][2].columns[1:], [self.condition_axis()], alphas, items)

    def stack(
        self,
        columns: Sequence[PrintedColumn],
        axes: list[StackedAxis],
        rows: StackedAxis,
        items: list[tuple[list[int], Page, PrintedTable]],
    ) -> LeafBuilder:
        """Return tables as arrays (axes..., rows); `items` holds index along the axes, page and
        table.
        """
        dims, outer = tuple(axis.name for axis in axes), tuple(len(axis.values) for axis in axes)
        places = [(tuple(where), page, table) for where, page, table in items]
        lines = self.lines(outer, [(where, table) for where, _, table in places])
        stacked = LeafBuilder(self.coords([*axes, rows]))
        for column in columns:
            value, flag = (
                np.full((*outer, len(rows.values)), np.nan),
                np.full((*outer, len(rows.values)), ABSENT, np.uint8),
            )
            for where, page, table in places:
                part_value, part_flag = self.column(column, page, table)
                value[where][: len(part_value)], flag[where][: len(part_flag)] = (
                    part_value,
                    part_flag,
                )
            stacked.add(column, (*dims, rows.name), value, flag)
        stacked.coords["lines"] = xr.Variable(dims, lines)
        stacked.coords["notes"] = self.notes(
            dims, outer, [(where, page) for where, page, _ in places]
        )
        return stacked

    @staticmethod
    def notes(
        dims: Sequence[str], shape: tuple[int, ...], items: Iterable[tuple[Sequence[int], Page]]
    ) -> xr.Variable:
        """Return the footnotes that change what a table means, as words of `FOOTNOTE_WORDS`, at the
        place of each table.
        """
        words = np.full(shape, "", dtype=object)
        for where, page in items:
            words[tuple(where)] = " ".join(list_footnote_words([note.text for note in page.notes]))
        meant = dict.fromkeys(word for text in words.ravel() for word in text.split())
        return xr.Variable(dims, words.astype(str), {word: FOOTNOTE_WORDS[word] for word in meant})

    def lines(
        self, shape: tuple[int, ...], items: Iterable[tuple[Sequence[int], PrintedTable]]
    ) -> np.ndarray:
        """Return the range of lines of each table at its place; two tables for one place raise."""
        lines = np.full(shape, "", dtype=object)
        for where, table in items:
            if lines[tuple(where)]:
                found = (
                    f"a second {table.name} table for the place of the one at lines "
                    f"{lines[tuple(where)]}"
                )
                raise ParseError(
                    self.case.file,
                    table.lines[0],
                    found,
                    "one table per configuration, condition, height and deflection",
                )
            lines[tuple(where)] = f"{table.lines[0]}-{table.lines[-1]}"
        return lines.astype(str)

    def lines_of_conditions(
        self, placed: list[tuple[PagePlace, Page, PrintedTable]]
    ) -> xr.Variable:
        """Return the range of lines of each table, one table for each flight condition."""
        lines = self.lines(
            (len(self.conditions),), [((spot.condition,), table) for spot, _, table in placed]
        )
        return xr.Variable("condition", lines)

    def column(
        self, column: PrintedColumn, page: Page, table: PrintedTable
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return a printed column in SI and its flags, a constant column filled downwards where
        that is allowed.
        """
        at = table.columns.index(column)
        flag = table.flags[:, at].copy()
        value = self.si(column, page, table.values[:, at], flag)
        transonic = self.case.deck.regime(page.condition("mach")) == "transonic"
        if (
            column.constant
            and len(flag) > 1
            and (flag[1:] == BLANK).all()
            and (self.fill_transonic or not transonic)
        ):
            value[1:] = value[0]
            flag[1:] = FILLED if flag[0] == OK else flag[0]
        return value, flag

    def si(
        self, column: PrintedColumn, page: Page, value: np.ndarray, flag: np.ndarray
    ) -> np.ndarray:
        """Return printed numbers of a column in SI, NaN where there is none."""
        return np.where(is_number_flag(flag), value * self.factor(column, page), np.nan)

    def factor(self, column: PrintedColumn, page: Page) -> float:
        """Return the factor from the printed numbers of a column to SI."""
        if column.units == "1/angle":
            return 1.0 / DEGREE if (page.per or self.case.deck.deriv.lower()) == "deg" else 1.0
        return (
            si_factor(column.units, page.dim) if column.units in OF_DIM else _factor(column.units)
        )

    def alphas(self) -> list[float]:
        """Return the schedule of the input cards. [deg]"""
        return self.case.deck.schedule("FLTCON", "ALSCHD", "NALPHA")

    def condition_axis(self) -> StackedAxis:
        """Return the axis of the flight conditions of the case."""
        return StackedAxis("condition", list(range(len(self.conditions))))

    def axis(
        self,
        placed: list[tuple[PagePlace, Page, PrintedTable]],
        name: str,
        exact: Sequence[float],
        column: int = 0,
    ) -> StackedAxis:
        """Return a row axis: the deck's values, or the printed ones without a deck; all tables must
        agree with it. [deg]
        """
        longest = max((table for _, _, table in placed), key=lambda table: len(table.rows))
        values = list(exact) or [float(x) for x in longest.values[:, column]]
        for _, _, table in placed:
            self.demand(table.columns[column].name, table.values[:, column], values, table.lines)
        return StackedAxis(name, values, "deg")

    def demand(
        self,
        name: str,
        printed: np.ndarray,
        exact: Sequence[float],
        lines: Sequence[int],
        half_unit: float = HALF_UNIT,
        units: str = "deg",
    ) -> None:
        """Raise when printed axis values are not the deck's, to the half unit of the print."""
        if len(printed) > len(exact):
            raise ParseError(
                self.case.file,
                lines[-1],
                f"{len(printed)} values of {name}",
                f"{len(exact)} as in the input cards",
            )
        unit = f" {units}" if units != "1" else ""
        for line, shown, wanted in zip(lines, printed, exact):
            if not (
                abs(shown - wanted) <= half_unit or (np.isnan(shown) and np.isnan(wanted))
            ):  # NDM: no angle in the cards
                raise ParseError(
                    self.case.file,
                    line,
                    f"{name} = {shown:g}{unit}",
                    f"{wanted:g}{unit} as in the input cards of the case",
                )

    @staticmethod
    def coordinate(axis: StackedAxis) -> xr.Variable:
        """Return the coordinate of an axis."""
        values = np.array(axis.values) * DEGREE if axis.units == "deg" else np.array(axis.values)
        units = {"deg": "rad"}.get(axis.units, axis.units)
        known = (
            quantity_attributes(axis.name)
            if axis.name in VOCABULARY
            else {"units": units}
            if units
            else {}
        )
        if axis.name in LONG_NAMES:
            known["long_name"] = LONG_NAMES[axis.name]
        return xr.Variable(axis.name, values, known)

    def coords(self, axes: Sequence[StackedAxis]) -> dict[str, xr.Variable]:
        """Return the coordinates of axes, and what names a flight condition."""
        coords = {axis.name: self.coordinate(axis) for axis in axes}
        for name, units in _CONDITION_UNITS.items():
            coords[name] = xr.Variable(
                "condition",
                np.array([getattr(condition, name) for condition in self.conditions]),
                {"units": units},
            )
        count = len(self.conditions)
        coords["case"] = xr.Variable("condition", np.array([self.case.name] * count, dtype=str))
        coords["file"] = xr.Variable("condition", np.array([self.case.file] * count, dtype=str))
        return coords
