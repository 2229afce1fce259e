"""The catalogue of a flight-test programme as TOML: conditions, manoeuvres with their limits and
time, fits, and what is wanted.

    title = "T-37, free air"
    margin = 0.8                        # part of the way from trim to each limit that a prediction may use
    cutoff = "4 Hz"                     # as in the project that will identify
    errors = { mass = 0.005, thrust = 0.015 }
    held = ["CL/altitude"]
    assumed = { "Cn/rudder" = -0.06 }   # for the prediction alone: terms that start from zero in the database
    rates = { gps = "5 Hz" }            # of the recorder, by instrument of the aircraft file; 50 Hz for the others

    [limits]                            # of every manoeuvre, on outputs of the model
    alpha = ["-3 deg", "12 deg"]
    nz = [0.2, 2.5]

    [[condition]]
    name = "clean, 170 kt, 5000 ft"
    setup = "150 s"                     # to get there and trim
    fixed = { V = "170 kt", h = "5000 ft" }

    [[manoeuvre]]
    name = "three axes"
    kind = "multisine"                  # all keys of a test input (`aeromatch flight design`)
    period = "30 s"
    band = ["0.1 Hz", "1.9 Hz"]
    setup = "15 s"                      # to trim again behind it
    [manoeuvre.axis.delta_e]
    amplitude = "2 deg"

    [[manoeuvre]]
    name = "sideslips"
    kind = "sideslip"                   # rudder to +amplitude and to -amplitude, heading held with bank
    amplitude = "8 deg"
    duration = "9 s"                    # each
    conditions = ["clean, 170 kt, 5000 ft"]     # all without it
    marks = ["steady_sideslip"]         # what flight records call it, next to its name
    abort = ["beta above 12 deg"]

    [[fit]]                             # formed at every condition from those of its manoeuvres that are flown there
    name = "pitch"
    manoeuvres = ["three axes"]
    models = ["CL = 1 + alpha + qhat + delta_e"]

    [[wanted]]                          # nodes of a term inside ranges of its axes
    term = "CL/basic"
    within = { alpha = ["0 deg", "8 deg"], mach = [0.2, 0.4] }
    stderr = 0.02                       # or ratio = 0.5, of the standard error before the flight

Kinds besides ``multisine``, ``multistep`` and ``sweep``: ``sideslip``, ``pull_up_push_down`` (a
sine of pitch attitude), ``level_speed`` (idle until the airspeed is `amplitude` lower, full power
until it is as much higher), ``device`` (`device` goes to `amplitude`, in `duration`, and back).
"""

from __future__ import annotations

import os
from typing import Annotated, Any, Literal

import pandas as pd
from pydantic import Field, field_validator, model_validator

from flightmech.errors import AeromatchError, SchemaError, UnitError, UnknownName
from flightmech.names import lookup
from flightmech.support.input_files import read_toml
from flightmech.support.toml_models import Strict, validate_content
from flightmech.support.toml_quantities import InUnits
from flightmech.units import parse_quantity
from flighttest.flight_programme.input_design.specification import ConditionTable, Design, design_of
from flighttest.reconstruction.dynamics.coefficient_errors import ERRORS
from flighttest.regression.equation_error.model import RegressionModel

INPUTS = ("multisine", "multistep", "sweep")
STEADY = ("sideslip", "pull_up_push_down", "level_speed", "device")
RATE = 50.0  # of an instrument whose rate is not given [Hz]
_Time = Annotated[float, InUnits("s")]
_Frequency = Annotated[float, InUnits("Hz")]
_OF_KIND = {
    "sideslip": "delta_r",
    "pull_up_push_down": "theta",
    "level_speed": "V",
}  # what the amplitude is of


class PlannedCondition(ConditionTable):
    """A steady flight in which manoeuvres are flown; `fixed`, `kind`, `unknowns` as in
    `flightmech.trim`.
    """

    name: str
    setup: _Time = Field(ge=0.0)
    parameters: dict[str, float] = Field(default_factory=dict)


class PlannedManoeuvre(Strict):
    """A manoeuvre that may be flown at the conditions named, at all of them without a name."""

    name: str
    kind: Literal[
        "multisine", "multistep", "sweep", "sideslip", "pull_up_push_down", "level_speed", "device"
    ]
    setup: _Time = Field(default=0.0, ge=0.0)
    conditions: tuple[str, ...] = ()
    marks: tuple[str, ...] = ()
    abort: tuple[str, ...] = ()
    amplitude: float = 0.0
    duration: _Time = 0.0
    device: str = ""
    hold: float | None = Field(default=None, ge=0.0, le=1.0)
    design: Design | None = None

    @model_validator(mode="after")
    def _complete(self) -> PlannedManoeuvre:
        if self.kind in STEADY and not (self.amplitude and self.duration > 0.0):
            raise ValueError(f"a {self.kind} needs amplitude and duration; give both")
        if (self.kind == "device") != bool(self.device):
            raise ValueError(
                "device belongs to the kind 'device'; name the input that moves, such as gear"
            )
        return self

    def marked(self, table: pd.DataFrame) -> pd.DataFrame:
        """Return the rows of a table of manoeuvres that are this one: by its name, or by one of its
        marks.

        A mark is the kind of a manoeuvre, or kind and control, as in the fits of a project.
        """
        labels = (table["manoeuvre"] + " " + table["control"].fillna("")).str.strip()
        wanted = (self.name, *self.marks)
        return table[labels.isin(wanted) | table["manoeuvre"].isin(wanted)]

    @property
    def feedback(self) -> float:
        """Return the share of the pilot's attitude gains that stays during the manoeuvre."""
        return (0.1 if self.kind == "multisine" else 0.0) if self.hold is None else self.hold


class PlannedFit(Strict):
    """Local models that are fitted at every condition to the manoeuvres named, as far as they are
    flown there.
    """

    name: str
    manoeuvres: tuple[str, ...] = Field(min_length=1)
    models: tuple[str, ...] = Field(min_length=1)
    conditions: tuple[str, ...] = ()


class WantedAccuracy(Strict):
    """Nodes of a term and the standard error that they must have after the flight."""

    term: str
    within: dict[str, tuple[float, float]] = Field(default_factory=dict)
    stderr: float | None = Field(default=None, gt=0.0)
    ratio: float | None = Field(default=None, gt=0.0, lt=1.0)

    @field_validator("within", mode="before")
    @classmethod
    def _in_si(cls, table: Any) -> Any:
        if not isinstance(table, dict):
            return table
        for name, pair in table.items():
            if not isinstance(pair, list) or len(pair) != 2:
                raise ValueError(f"{name}: expected [lowest, highest]")
        return {name: tuple(_si(name, item) for item in pair) for name, pair in table.items()}

    @model_validator(mode="after")
    def _one_bound(self) -> WantedAccuracy:
        if (self.stderr is None) == (self.ratio is None):
            raise ValueError("give stderr or ratio, one of them")
        return self


class Catalogue(Strict):
    """Everything that a programme may consist of, and what it must achieve."""

    title: str = ""
    margin: float = Field(default=1.0, gt=0.0, le=1.0)
    cutoff: _Frequency | None = None
    errors: dict[str, float] = Field(default_factory=dict)
    held: tuple[str, ...] = ()
    assumed: dict[str, float] = Field(default_factory=dict)
    rates: dict[str, _Frequency] = Field(default_factory=dict)
    limits: dict[str, tuple[float, float]] = Field(default_factory=dict)
    abort: tuple[str, ...] = ()
    seed: int = 0
    condition: tuple[PlannedCondition, ...] = Field(min_length=1)
    manoeuvre: tuple[PlannedManoeuvre, ...] = Field(min_length=1)
    fit: tuple[PlannedFit, ...] = Field(min_length=1)
    wanted: tuple[WantedAccuracy, ...] = Field(min_length=1)

    @field_validator("limits", mode="before")
    @classmethod
    def _limits_in_si(cls, table: Any) -> Any:
        return ConditionTable.model_validate({"limits": table}).limits

    @field_validator("manoeuvre", mode="before")
    @classmethod
    def _with_designs(cls, items: Any) -> Any:
        return (
            [_with_design(item) if isinstance(item, dict) else item for item in items]
            if isinstance(items, list)
            else items
        )

    @model_validator(mode="after")
    def _names_that_exist(self) -> Catalogue:
        problems = [
            *_twice("condition", self.condition),
            *_twice("manoeuvre", self.manoeuvre),
            *_twice("fit", self.fit),
        ]
        conditions, manoeuvres = [c.name for c in self.condition], [m.name for m in self.manoeuvre]
        users: list[tuple[str, PlannedManoeuvre | PlannedFit]] = [
            *(("manoeuvre", m) for m in self.manoeuvre),
            *(("fit", f) for f in self.fit),
        ]
        for what, item in users:
            problems += [
                f"{what} {item.name!r}: {UnknownName(c, conditions, 'condition')}"
                for c in item.conditions
                if c not in conditions
            ]
        for fit in self.fit:
            problems += [
                f"fit {fit.name!r}: {UnknownName(m, manoeuvres, 'manoeuvre')}"
                for m in fit.manoeuvres
                if m not in manoeuvres
            ]
            for text in fit.models:
                try:
                    RegressionModel.parse(text)
                except AeromatchError as error:
                    problems.append(f"fit {fit.name!r}: {error}")
        problems += [
            f"errors: {UnknownName(name, ERRORS, 'source of error')}"
            for name in self.errors
            if name not in ERRORS
        ]
        if problems:
            raise ValueError("; ".join(problems))
        return self

    def flyable(self) -> list[tuple[PlannedCondition, PlannedManoeuvre]]:
        """Return every condition with every manoeuvre that is allowed there."""
        return [
            (c, m)
            for c in self.condition
            for m in self.manoeuvre
            if not m.conditions or c.name in m.conditions
        ]


def read_catalogue(path: str | os.PathLike) -> Catalogue:
    """Return the catalogue of a flight-test programme from a TOML file.

    Raises
    ------
    ParseError
        Not TOML.
    SchemaError
        Every unknown key, missing value, wrong unit, and name of a condition or manoeuvre that the
        file does not have.
    """
    return validate_content(Catalogue, dict(read_toml(os.fspath(path))), os.fspath(path))


def _with_design(item: dict[str, Any]) -> dict[str, Any]:
    """Move the keys of a test input into a `Design`, and bring the amplitude of the other kinds to
    SI.
    """
    own = {"name", "kind", "setup", "conditions", "marks", "abort", "hold"}
    if item.get("kind") in INPUTS:
        try:
            design = design_of(
                {
                    "kind": item["kind"],
                    **{key: value for key, value in item.items() if key not in own},
                },
                "test input",
            )
            design.signal()
        except SchemaError as error:
            raise ValueError("; ".join(error.problems)) from error
        return {**{key: value for key, value in item.items() if key in own}, "design": design}
    name = _OF_KIND.get(str(item.get("kind")), str(item.get("device", "")))
    return {**item, "amplitude": _si(name, item["amplitude"])} if "amplitude" in item else item


def _twice(what: str, items: Any) -> list[str]:
    names = [item.name for item in items]
    return [
        f"{what} {name!r} is there twice; give every {what} a name of its own"
        for name in dict.fromkeys(names)
        if names.count(name) > 1
    ]


def _si(name: str, item: Any) -> float:
    """Return a quantity by name in SI; a name without unit is a plain number."""
    try:
        return parse_quantity(item, lookup(name).units if name else "1")
    except (UnknownName, UnitError) as error:
        raise ValueError(f"{name}: {error}") from error
