"""Plan of the evaluation of a flight, as a TOML file.

title = "Citation II PH-LAB, 2018-03-12"
record = "flight.csv.gz"            # files are relative to this one
names = "citation_2018.toml"
aircraft = "citation.toml"

[loading]                           # if the record has no mass: dry items, and fuel by
                                    # engineN.fuel_flow
file = "loading.csv"
item = "item"
mass = { column = "mass_kg", unit = "kg" }
station = { column = "arm_in", unit = "in" }
fuel = "block_fuel"                 # the item that is fuel
leading_edge = "261.45 in"          # station of the leading edge of the mean chord
fuel_table = { file = "fuel.csv", mass = { column = "fuel_lb", unit = "lb" },
               moment = { column = "moment", unit = "in lb", scale = 100 } }

[thrust]                            # if the record has no thrust: points of the engine deck
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

[[bound]]                           # allowed range of a figure of the evaluation
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

from flightmech.errors import ParseError, SchemaError, UnitError
from flightmech.support.toml_files import read_toml
from flightmech.support.toml_models import Strict, validate_content
from flightmech.support.toml_quantities import InUnits
from flightmech.units import to_si
from flighttest.records.text_tables import TextTable, read_text_table


class SheetColumn(Strict):
    """One column: its name, its unit and a factor, such as 100 for hundreds of ``in lb``."""

    column: str
    unit: str = ""
    scale: float = 1.0

    def of(self, sheet: TextTable, expected: str) -> np.ndarray:
        """Return the column in SI.

        Parameters
        ----------
        sheet : TextTable
        expected : str
            SI unit of the quantity.

        Raises
        ------
        SchemaError
            The unit belongs to another quantity.
        ParseError
            A cell is not a number; an empty cell is NaN.
        UnknownName
            The sheet does not have the column.
        """
        x = np.array([sheet.number(row, self.column) for row in range(len(sheet.rows))], float)
        try:
            return to_si(self.scale * x, self.unit or expected, expected)
        except UnitError as error:
            raise SchemaError(f"sheet {sheet.path}", [f"column {self.column}: {error}"]) from None


def read_sheet(path: Path) -> TextTable:
    """Return a CSV sheet of test points.

    Raises
    ------
    ParseError
        The sheet has no line of names or no row, or a row has another length.
    """
    table = read_text_table(path, "a sheet in CSV with a line of names")
    if not table.rows:
        found = "a line of names alone" if table.names else "no line"
        raise ParseError(str(path), 1, found, "a line of column names and a line for each row")
    return table


_Length = Annotated[float, InUnits("m")]
_Window = tuple[float, float]
# Name of a figure and of a file.
_Name = Annotated[str, Field(pattern=r"^\w+$")]
# Keys of the plan whose values are names of files.
_FILE_KEYS = ("record", "names", "aircraft", "file")


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
    """A regression over manoeuvres or stationary points."""

    name: _Name
    model: str
    on: tuple[str, ...]
    window: _Window | None = None
    series: tuple[str, ...] = ()


class PlannedMode(Strict):
    """An eigenmotion in a window about the start of a manoeuvre."""

    name: _Name
    on: str
    window: _Window
    channels: tuple[str, ...]
    inputs: tuple[str, ...] = ()
    kind: Literal["oscillation", "aperiodic"] = "oscillation"
    trend: bool = True


class Bound(Strict):
    """Allowed range of one figure: ``value`` and ``within``, or ``low`` and ``high``.

    Numbers are in SI; texts have a unit.
    """

    of: str
    value: float | str | None = None
    within: float | str | None = None
    low: float | str | None = None
    high: float | str | None = None
    source: str
    reason: str = ""

    @model_validator(mode="after")
    def _check_form(self) -> Bound:
        has_value = self.value is not None
        has_limits = self.low is not None or self.high is not None
        if has_value != (self.within is not None) or has_value == has_limits:
            raise ValueError("give value and within, or low and high")
        return self


class EvaluationPlan(Strict):
    """Record, aircraft, sheets, figures and bounds of an evaluation."""

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
    def _check_parts(self) -> EvaluationPlan:
        problems = self._find_repeated()
        on_points = any("points" in fit.on for fit in self.fit)
        on_manoeuvres = [fit for fit in self.fit if set(fit.on) - {"points"}]
        if self.points is None and (self.line or on_points):
            problems.append("lines, and fits on points, need [points]")
        if self.manoeuvres is None and (self.mode or on_manoeuvres):
            problems.append("modes, and fits on manoeuvres, need [manoeuvres]")
        for fit in on_manoeuvres:
            if fit.window is None:
                problems.append(f"fit {fit.name} needs a window")
        if problems:
            raise ValueError("; ".join(problems))
        return self

    def _find_repeated(self) -> list[str]:
        """Return a fault for each name that two lines, fits or modes have."""
        # names become names of files, and some file systems ignore capitals
        parts: list[StraightLine | FitTable | PlannedMode] = [*self.line, *self.fit, *self.mode]
        names = [part.name.lower() for part in parts]
        problems = []
        for name in sorted(set(names)):
            if names.count(name) > 1:
                problems.append(
                    f"the name {name} is given twice (capitals do not count); lines, fits and "
                    "modes share one list"
                )
        return problems


def read_plan(path: str | Path) -> EvaluationPlan:
    """Read the plan of an evaluation; names of files are relative to it.

    Raises
    ------
    ParseError
        The file is not TOML.
    SchemaError
        Every unknown key, missing value, wrong unit and absent file at once.
    """
    path = Path(path)
    content = _resolve_files(read_toml(path), path.parent)
    plan = validate_content(EvaluationPlan, content, f"evaluation {path}")
    absent = [file for file in files_of(plan) if not file.is_file()]
    if absent:
        problems = [f"no file {file}; names are relative to the plan" for file in absent]
        raise SchemaError(f"evaluation {path}", problems)
    return plan


def _resolve_files(item: Any, folder: Path) -> Any:
    """Return the content with the names of its files relative to a folder."""
    if isinstance(item, list):
        return [_resolve_files(part, folder) for part in item]
    if not isinstance(item, dict):
        return item
    resolved = {}
    for key, part in item.items():
        if key in _FILE_KEYS and isinstance(part, str):
            resolved[key] = folder / part
        else:
            resolved[key] = _resolve_files(part, folder)
    return resolved


def files_of(plan: EvaluationPlan) -> list[Path]:
    """Return the files that a plan names."""
    files = [plan.record, plan.names, plan.aircraft]
    for part in (plan.loading, plan.thrust, plan.points, plan.manoeuvres):
        if part is not None:
            files.append(part.file)
    if plan.loading is not None:
        files.append(plan.loading.fuel_table.file)
    return [file for file in files if file is not None]
