"""Stacking the printed tables of one case into arrays: SI, radians, a flag beside every value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from flightmech.errors import ParseError
from flightmech.names import VOCABULARY, attrs
from flightmech.units import DEGREE

from .arrange import Condition, Spot
from .cells import ABSENT, BLANK, FILLED, FLAGS, OK
from .layouts.form import Column
from .listing import Case, Page
from .tables import Table

HALF_UNIT = 0.0501  # of the axes, printed with one decimal [deg]
_CONDITION_UNITS = {"mach": "1", "h": "m", "V": "m s-1", "p_static": "Pa", "temperature": "K", "reynolds_per_m": "m-1"}
_LONG_NAMES = {
    "CN": "normal-force coefficient, body axes",
    "CA": "axial-force coefficient, body axes, positive aft",
    "xcp": "centre of pressure forward of the moment centre, in chords: CM/CN, and CMA/CLA from the first row without CM or CN on",
    "ground_height": "height of the drawing datum (z = 0) over the ground, infinite in free air",
    "q_ratio": "dynamic pressure at the horizontal tail over that of the free stream",
    "epsilon": "downwash angle at the horizontal tail",
    "epsilon_alpha": "slope of the downwash angle with alpha",
    "dCL": "increment of the lift coefficient, constant in alpha",
    "dCm": "increment of the pitching-moment coefficient",
    "dCLmax": "increment of the largest lift coefficient",
    "dCDmin": "increment of the smallest drag coefficient",
    "dCDi": "increment of the induced-drag coefficient",
    "CL_alpha_delta": "lift-curve slope of the surface with the device deflected",
    "Ch_alpha": "hinge-moment coefficient per alpha, on twice the area moment of the control about its hinge line",
    "Ch_delta": "hinge-moment coefficient per deflection, on twice the area moment of the control about its hinge line",
}
_FLAG_ATTRS = {"flag_values": " ".join(map(str, range(len(FLAGS)))), "flag_meanings": " ".join(FLAGS)}


class Axis(NamedTuple):
    """A dimension with its coordinate in SI."""

    name: str
    values: Sequence
    units: str = ""


class Stacker:
    """Stacks the printed tables of one case into arrays."""

    def __init__(self, case: Case, conditions: list[Condition], spots: dict[int, Spot], fill_transonic: bool):
        self.case, self.conditions, self.spots, self.fill_transonic = case, conditions, spots, fill_transonic

    def placed(self, name: str) -> list[tuple[Spot, Page, Table]]:
        """Return place, page and table of every table of a kind that has a place."""
        return [(self.spots[page.first], page, table) for page, table in self.case.tables(name) if page.first in self.spots]

    def with_two_way(
        self,
        found: xr.Dataset,
        placed: list[tuple[Spot, Page, Table]],
        across: Axis,
        printed: Sequence[float] | None = None,
        half_unit: float = HALF_UNIT,
    ) -> xr.Dataset:
        """Add two-way tables as a variable (condition, alpha, across); `printed` are the heading values when they are not the axis."""
        column = placed[0][2].layout.across
        assert column is not None
        wanted = across.values if printed is None else printed
        for _, _, table in placed:
            assert table.across is not None
            self.demand(column.name, table.across, wanted, [table.across_line] * len(table.across), half_unit)
        alphas = self.axis(placed, "alpha", self.alphas())
        shape = (len(self.conditions), len(alphas.values), len(across.values))
        value, flag = np.full(shape, np.nan), np.full(shape, ABSENT, np.uint8)
        lines = np.full(shape[0], "", dtype=object)
        for spot, _, table in placed:
            rows, count = len(table.rows), len(table.columns) - 1
            flag[spot.condition, :rows, :count] = table.flags[:, 1:]
            value[spot.condition, :rows, :count] = np.where(table.flags[:, 1:] == OK, table.values[:, 1:], np.nan)
            lines[spot.condition] = f"{table.lines[0]}-{table.lines[-1]}"
        found = found.assign_coords({"alpha": self.coords([alphas])["alpha"]})
        add_variable(found, column.cell, ["condition", "alpha", across.name], value, flag)
        return found.assign_coords({f"lines_{column.cell.house}": ("condition", lines.astype(str))})

    def stack(self, columns: Sequence[Column], axes: list[Axis], rows: Axis, items: list[tuple[list[int], Page, Table]]) -> xr.Dataset:
        """Return tables as arrays (axes..., rows); `items` holds index along the axes, page and table."""
        outer = tuple(len(axis.values) for axis in axes)
        lines = np.full(outer, "", dtype=object)
        for where, _, table in items:
            if lines[tuple(where)]:
                found = f"a second {table.name} table for the place of the one at lines {lines[tuple(where)]}"
                raise ParseError(self.case.file, table.lines[0], found, "one table per configuration, condition, height and deflection")
            lines[tuple(where)] = f"{table.lines[0]}-{table.lines[-1]}"
        stacked = xr.Dataset(coords=self.coords([*axes, rows]))
        for column in columns:
            value, flag = np.full((*outer, len(rows.values)), np.nan), np.full((*outer, len(rows.values)), ABSENT, np.uint8)
            for where, page, table in items:
                part_value, part_flag = self.column(column, page, table)
                value[tuple(where)][: len(part_value)], flag[tuple(where)][: len(part_flag)] = part_value, part_flag
            add_variable(stacked, column, [axis.name for axis in (*axes, rows)], value, flag)
        return stacked.assign_coords(lines=([axis.name for axis in axes], lines.astype(str)))

    def column(self, column: Column, page: Page, table: Table) -> tuple[np.ndarray, np.ndarray]:
        """Return a printed column in SI and its flags, a constant column filled downwards where that is allowed."""
        at = table.columns.index(column)
        flag = table.flags[:, at].copy()
        per = page.per or self.case.deck.deriv.lower()
        per_degree = column.units == "1/deg" or (column.units == "1/angle" and per == "deg")
        factor = DEGREE if column.units == "deg" else 1.0 / DEGREE if per_degree else 1.0
        value = np.where(flag == OK, table.values[:, at] * factor, np.nan)
        transonic = self.case.deck.regime(page.condition("mach")) == "transonic"
        if column.constant and len(flag) > 1 and (flag[1:] == BLANK).all() and (self.fill_transonic or not transonic):
            value[1:] = value[0]
            flag[1:] = FILLED if flag[0] == OK else flag[0]
        return value, flag

    def alphas(self) -> list[float]:
        """Return the schedule of the input cards. [deg]"""
        return self.case.deck.schedule("FLTCON", "ALSCHD", "NALPHA")

    def condition_axis(self) -> Axis:
        """Return the axis of the flight conditions of the case."""
        return Axis("condition", list(range(len(self.conditions))))

    def axis(self, placed: list[tuple[Spot, Page, Table]], name: str, exact: Sequence[float], column: int = 0) -> Axis:
        """Return a row axis: the deck's values, or the printed ones without a deck; all tables must agree with it. [deg]"""
        longest = max((table for _, _, table in placed), key=lambda table: len(table.rows))
        values = list(exact) or [float(x) for x in longest.values[:, column]]
        for _, _, table in placed:
            self.demand(table.columns[column].name, table.values[:, column], values, table.lines)
        return Axis(name, values, "deg")

    def demand(self, name: str, printed: np.ndarray, exact: Sequence[float], lines: Sequence[int], half_unit: float = HALF_UNIT) -> None:
        """Raise when printed axis values are not the deck's, to the half unit of the print."""
        if len(printed) > len(exact):
            raise ParseError(self.case.file, lines[-1], f"{len(printed)} values of {name}", f"{len(exact)} as in the input cards")
        for line, shown, wanted in zip(lines, printed, exact):
            if not abs(shown - wanted) <= half_unit:
                raise ParseError(self.case.file, line, f"{name} = {shown:g} deg", f"{wanted:g} deg as in the input cards of the case")

    def coords(self, axes: Sequence[Axis]) -> Mapping[str, object]:
        """Return the coordinates of axes, and what names a flight condition."""
        coords: dict[str, object] = {}
        for axis in axes:
            values = np.array(axis.values) * DEGREE if axis.units == "deg" else np.array(axis.values)
            units = {"deg": "rad"}.get(axis.units, axis.units)
            known = attrs(axis.name) if axis.name in VOCABULARY else {"units": units} if units else {}
            if axis.name in _LONG_NAMES:
                known["long_name"] = _LONG_NAMES[axis.name]
            coords[axis.name] = (axis.name, values, known)
        for name, units in _CONDITION_UNITS.items():
            coords[name] = ("condition", np.array([getattr(condition, name) for condition in self.conditions]), {"units": units})
        count = len(self.conditions)
        coords["case"] = ("condition", np.array([self.case.name] * count, dtype=str))
        coords["file"] = ("condition", np.array([self.case.file] * count, dtype=str))
        return coords


def add_variable(dataset: xr.Dataset, column: Column, dims: Sequence[str], value: np.ndarray, flag: np.ndarray) -> None:
    """Put a variable and its twin of flags into a Dataset."""
    known = attrs(column.house) if column.house in VOCABULARY else {"units": "rad" if column.units == "deg" else "1"}
    if column.house in _LONG_NAMES:
        known["long_name"] = _LONG_NAMES[column.house]
    if column.units in ("1/angle", "1/deg"):
        known["per"] = "radian"
    dataset[column.house] = (dims, value, {**known, "printed_as": column.name})
    dataset[f"{column.house}_flag"] = (dims, flag, dict(_FLAG_ATTRS))
