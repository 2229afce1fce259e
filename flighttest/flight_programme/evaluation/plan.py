"""What a flight is evaluated for, as a TOML file.

title = "Citation II PH-LAB, 2018-03-12"
record = "flight.csv.gz"            # files are relative to this one
names = "citation_2018.toml"
aircraft = "citation.toml"

[loading]                           # when the record holds no mass: dry items, and the fuel burnt by engineN.fuel_flow
file = "loading.csv"
item = "item"
mass = { column = "mass_kg", unit = "kg" }
station = { column = "arm_in", unit = "in" }
fuel = "block_fuel"                 # the item that is fuel
leading_edge = "261.45 in"          # station of the leading edge of the mean chord
fuel_table = { file = "fuel.csv", mass = { column = "fuel_lb", unit = "lb" },
               moment = { column = "moment", unit = "in lb", scale = 100 } }

[thrust]                            # when it holds no thrust: points of the engine deck, over corrected fuel flow and Mach
file = "deck.csv"
h = { column = "hp_m", unit = "m" }
...                                 # mach, delta_T, fuel_flow, thrust

[points]                            # stationary points: windows about the noted times
file = "stationary.csv"
time = { column = "t_s" }
series = "series"
window = [-30.0, -1.0]

[manoeuvres]
file = "manoeuvres.csv"
name = "motion"
time = { column = "t_start_s" }

[[line]]                            # a straight line through the means of stationary points
name = "trim"
y = "delta_e"
x = "alpha_vane"
series = ["trim"]

[[fit]]                             # a regression over manoeuvres, or over "points"
name = "pitching"
model = "Cm = 1 + alpha + qhat + delta_e"
on = ["short_period"]
window = [-3.0, 14.0]               # about the noted start

[[mode]]
name = "phugoid"
on = "phugoid"
window = [20.0, 150.0]
channels = ["V"]

[[bound]]                           # what a figure of the evaluation must lie within
of = "phugoid.period"
value = 42.2
within = "2.5 %"
source = "README of the data set"
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from flightmech.errors import ParseError, SchemaError, UnitError, UnknownName
from flightmech.support.input_files import WESTERN, csv_rows, read_text, read_toml
from flightmech.support.toml_models import Strict, validate_content
from flightmech.support.toml_quantities import InUnits
from flightmech.units import to_si


class SheetColumn(Strict):
    """One column: its name, its unit, and a factor for what the unit cannot express (``scale =
    100`` with ``unit = "in lb"``).
    """

    column: str
    unit: str = ""
    scale: float = 1.0

    def of(self, sheet: TestPointSheet, expected: str) -> np.ndarray:
        """Return the column in SI.

        Parameters
        ----------
        sheet : Sheet
        expected : str
            SI unit of the quantity.

        Raises
        ------
        SchemaError
            The unit is another quantity, or a cell is not a number; cells left empty are NaN.
        UnknownName
            No such column.
        """
        x = np.array([sheet.number(row, self.column) for row in range(len(sheet.rows))], float)
        try:
            return to_si(self.scale * x, self.unit or expected, expected)
        except UnitError as error:
            raise SchemaError(f"sheet {sheet.path}", [f"column {self.column}: {error}"]) from None


class TestPointSheet:
    """A CSV file as text cells.

    Parameters
    ----------
    path : path

    Raises
    ------
    ParseError
        No line of names, or a row of another length.
    """

    def __init__(self, path: Path):
        self.path = path
        lines = [
            line
            for line in csv_rows(
                read_text(path, "a sheet in CSV with a line of names", WESTERN), path
            )
            if line
        ]
        if len(lines) < 2:
            raise ParseError(
                str(path),
                1,
                f"{len(lines)} lines",
                "a line of column names and a line for each row",
            )
        self.names, self.rows = lines[0], lines[1:]
        for number, row in enumerate(self.rows, start=2):
            if len(row) != len(self.names):
                raise ParseError(
                    str(path),
                    number,
                    f"{len(row)} cells",
                    f"{len(self.names)}, as the line of names has",
                )

    def text(self, row: int, column: str) -> str:
        """Return one cell."""
        if column not in self.names:
            raise UnknownName(column, self.names, "column", f"sheet {self.path}")
        return self.rows[row][self.names.index(column)].strip()

    def number(self, row: int, column: str) -> float:
        """Return one cell as a number, NaN where it is empty."""
        text = self.text(row, column)
        try:
            return float(text) if text else float("nan")
        except ValueError:
            raise ParseError(
                str(self.path), row + 2, f"{text!r} in column {column}", "a number"
            ) from None


_Length = Annotated[float, InUnits("m")]
_Window = tuple[float, float]
_Name = Annotated[str, Field(pattern=r"^\w+$")]  # of a figure, and of a file


class FuelMomentTable(Strict):
    """Moment of the fuel in the tanks over its mass, about station 0."""

    file: Path
    mass: SheetColumn
    moment: SheetColumn


class Loading(Strict):
    """A loading sheet; the moment arm counts aft from station 0."""

    file: Path
    item: str
    mass: SheetColumn
    station: SheetColumn
    fuel: str
    leading_edge: _Length
    fuel_table: FuelMomentTable


class ThrustPoints(Strict):
    """Points of an engine deck: net thrust of one engine."""

    file: Path
    h: SheetColumn
    mach: SheetColumn
    delta_T: SheetColumn
    fuel_flow: SheetColumn
    thrust: SheetColumn
    error: float = Field(default=0.02, gt=0.0)


class StationaryTimes(Strict):
    """Times of stationary points; `window` about them, before the crew changed anything."""

    file: Path
    time: SheetColumn
    series: str = ""
    window: _Window


class Manoeuvres(Strict):
    """Noted start times."""

    file: Path
    name: str
    time: SheetColumn


class StraightLine(Strict):
    """A straight line through means; ``kind = "polar"`` is CD over CL squared."""

    name: _Name
    kind: Literal["line", "polar"] = "line"
    y: str = "CD"
    x: str = "CL"
    series: tuple[str, ...] = ()


class FitTable(Strict):
    """A regression."""

    name: _Name
    model: str
    on: tuple[str, ...]
    window: _Window | None = None
    series: tuple[str, ...] = ()


class PlannedMode(Strict):
    """An eigenmotion."""

    name: _Name
    on: str
    window: _Window
    channels: tuple[str, ...]
    inputs: tuple[str, ...] = ()
    kind: Literal["oscillation", "aperiodic"] = "oscillation"
    trend: bool = True


class Bound(Strict):
    """What one figure must lie within: ``value`` and ``within``, or ``low`` and ``high``; numbers
    are SI, texts carry their unit.
    """

    of: str
    value: float | str | None = None
    within: float | str | None = None
    low: float | str | None = None
    high: float | str | None = None
    source: str
    reason: str = ""

    @model_validator(mode="after")
    def _one_form(self) -> Bound:
        if (self.value is None) != (self.within is None) or (self.value is None) == (
            self.low is None and self.high is None
        ):
            raise ValueError("give value and within, or low and high")
        return self


class EvaluationPlan(Strict):
    """An evaluation."""

    title: str
    record: Path
    names: Path | None = None
    aircraft: Path
    rate: float = Field(default=50.0, gt=0.0)
    loading: Loading | None = None
    thrust: ThrustPoints | None = None
    points: StationaryTimes | None = None
    manoeuvres: Manoeuvres | None = None
    line: tuple[StraightLine, ...] = ()
    fit: tuple[FitTable, ...] = ()
    mode: tuple[PlannedMode, ...] = ()
    bound: tuple[Bound, ...] = ()

    @model_validator(mode="after")
    def _whole(self) -> EvaluationPlan:
        given = [
            *(x.name for x in self.line),
            *(x.name for x in self.fit),
            *(x.name for x in self.mode),
        ]
        names = [name.lower() for name in given]  # they become names of files
        twice = sorted({name for name in names if names.count(name) > 1})
        problems = [
            f"the name {name} is given twice (capitals do not count); lines, fits and modes "
            f"share one list"
            for name in twice
        ]
        if self.points is None and (self.line or any("points" in item.on for item in self.fit)):
            problems.append("lines, and fits on points, need [points]")
        if self.manoeuvres is None and (
            self.mode or any(set(item.on) - {"points"} for item in self.fit)
        ):
            problems.append("modes, and fits on manoeuvres, need [manoeuvres]")
        problems += [
            f"fit {item.name} needs a window"
            for item in self.fit
            if item.window is None and set(item.on) - {"points"}
        ]
        if problems:
            raise ValueError("; ".join(problems))
        return self


def read_plan(path: str | Path) -> EvaluationPlan:
    """Read the plan of an evaluation; names of files become relative to it.

    Raises
    ------
    ParseError
        Not TOML.
    SchemaError
        Every unknown key, missing value, wrong unit and absent file at once.
    """
    path = Path(path)
    plan = validate_content(
        EvaluationPlan, _placed(read_toml(path), path.parent), f"evaluation {path}"
    )
    absent = [str(file) for file in files_of(plan) if not file.is_file()]
    if absent:
        raise SchemaError(
            f"evaluation {path}",
            [f"no file {file}; names are relative to the plan" for file in absent],
        )
    return plan


_FILE_KEYS = ("record", "names", "aircraft", "file")


def _placed(item: Any, folder: Path) -> Any:
    """Return the content with the names of its files put behind the folder."""
    if isinstance(item, list):
        return [_placed(part, folder) for part in item]
    if not isinstance(item, dict):
        return item
    return {
        key: folder / part if key in _FILE_KEYS and isinstance(part, str) else _placed(part, folder)
        for key, part in item.items()
    }


def files_of(plan: EvaluationPlan) -> list[Path]:
    """Return the files that a plan names."""
    found = [plan.record, plan.names, plan.aircraft]
    found += [
        part.file
        for part in (plan.loading, plan.thrust, plan.points, plan.manoeuvres)
        if part is not None
    ]
    return [
        file
        for file in (*found, plan.loading.fuel_table.file if plan.loading else None)
        if file is not None
    ]
