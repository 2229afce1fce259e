"""Catalogue of a flight-test programme as TOML.

The catalogue has the conditions, the manoeuvres with their limits and time, the fits, and the
wanted accuracy.

    title = "T-37, free air"
    margin = 0.8                        # usable part of the distance from trim to each limit
    cutoff = "4 Hz"                     # as in the project of the identification
    errors = { mass = 0.005, thrust = 0.015 }
    held = ["CL/altitude"]
    assumed = { "Cn/rudder" = -0.06 }   # for the prediction: terms that are zero in the database
    rates = { gps = "5 Hz" }            # samples per second by instrument; 50 Hz for the others

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
    setup = "15 s"                      # to trim again after it
    [manoeuvre.axis.delta_e]
    amplitude = "2 deg"

    [[manoeuvre]]
    name = "sideslips"
    kind = "sideslip"                   # rudder to +amplitude and -amplitude, bank holds heading
    amplitude = "8 deg"
    duration = "9 s"                    # each
    conditions = ["clean, 170 kt, 5000 ft"]     # all if omitted
    marks = ["steady_sideslip"]         # further names in flight records
    abort = ["beta above 12 deg"]

    [[fit]]                             # at every condition, from its manoeuvres at that condition
    name = "pitch"
    manoeuvres = ["three axes"]
    models = ["CL = 1 + alpha + qhat + delta_e"]

    [[wanted]]                          # nodes of a term inside ranges of its axes
    term = "CL/basic"
    within = { alpha = ["0 deg", "8 deg"], mach = [0.2, 0.4] }
    stderr = 0.02                       # or ratio = 0.5, of the standard error before the flight

    [[wanted_row]]                      # row of a proof of match (`aeromatch pom spread`)
    row = "2.c.10"
    condition = "clean, 170 kt, 5000 ft"
    manoeuvre = "three axes"            # its motion is the case
    ratio = 0.5                         # two standard errors of the miss, over the tolerance

Further kinds are ``sideslip``, ``pull_up_push_down``, ``level_speed``, ``device``, ``low_pass`` and
``landing``.  The pitch attitude of a ``pull_up_push_down`` is a sine.  A ``level_speed`` has idle
power until the airspeed is `amplitude` lower, then full power until it is `amplitude` higher.  In a
``device`` the input `device` goes to `amplitude`, in `duration`, and back.  A ``low_pass`` flies
`duration` level at each of its `heights` (of the moment reference point over the runway, in spans)
with a sine of pitch attitude; every height is a manoeuvre of its own, with its own fits.  A
``landing`` flares from `height` (in spans) and ends at the first contact of a wheel, at the latest
after `duration`.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable
from typing import Annotated, Any, Literal

import pandas as pd
from pydantic import Field, field_validator, model_validator

from flightmech.errors import AeromatchError, SchemaError, UnitError, UnknownName
from flightmech.names import lookup
from flightmech.quantities import parse_quantity
from flightmech.support.toml_files import read_toml
from flightmech.support.toml_models import Strict, validate_content
from flightmech.support.toml_quantities import InUnits
from flighttest.flight_programme.input_design.specification import ConditionTable, Design, design_of
from flighttest.flight_programme.planning.low_passes import split_heights
from flighttest.reconstruction.dynamics.coefficient_errors import ERRORS
from flighttest.regression.equation_error.model import RegressionModel

INPUTS = ("multisine", "multistep", "sweep")
NEAR_GROUND = ("low_pass", "landing")
STEADY = ("sideslip", "pull_up_push_down", "level_speed", "device", *NEAR_GROUND)
# Samples per second of an instrument without a rate [Hz].
RATE = 50.0
_Time = Annotated[float, InUnits("s")]
_Frequency = Annotated[float, InUnits("Hz")]
# Quantity of the amplitude, by kind; the amplitude of a device is that of its input.
_OF_KIND = {"sideslip": "delta_r", "pull_up_push_down": "theta", "level_speed": "V"}
_OF_KIND["low_pass"] = "theta"
# Keys of a test input that belong to the manoeuvre; all others belong to its design.
_MANOEUVRE_KEYS = {"name", "kind", "setup", "conditions", "marks", "abort", "hold"}
# Share of the attitude gains during a multisine, which is too long for fixed controls.
_MULTISINE_HOLD = 0.1


class PlannedCondition(ConditionTable):
    """A steady flight for manoeuvres; `fixed`, `kind`, `unknowns` as in `flightmech.trim`."""

    name: str
    setup: _Time = Field(ge=0.0)
    parameters: dict[str, float] = Field(default_factory=dict)


class PlannedManoeuvre(Strict):
    """A manoeuvre at the named conditions, or at all conditions if none is named."""

    name: str
    kind: Literal[
        "multisine",
        "multistep",
        "sweep",
        "sideslip",
        "pull_up_push_down",
        "level_speed",
        "device",
        "low_pass",
        "landing",
    ]
    setup: _Time = Field(default=0.0, ge=0.0)
    conditions: tuple[str, ...] = ()
    marks: tuple[str, ...] = ()
    abort: tuple[str, ...] = ()
    amplitude: float = 0.0
    duration: _Time = 0.0
    device: str = ""
    # over the span
    height: float = Field(default=0.0, ge=0.0)
    hold: float | None = Field(default=None, ge=0.0, le=1.0)
    design: Design | None = None

    @model_validator(mode="after")
    def _check_keys(self) -> PlannedManoeuvre:
        if self.kind == "landing":
            if not (self.height > 0.0 and self.duration > 0.0):
                raise ValueError(
                    "a landing needs height (of the flare, in spans) and duration; give both"
                )
        elif self.kind in STEADY and not (self.amplitude and self.duration > 0.0):
            raise ValueError(f"a {self.kind} needs amplitude and duration; give both")
        if self.kind == "low_pass" and not self.height > 0.0:
            raise ValueError("a low_pass needs heights in spans, such as [0.2, 0.4, 0.8]")
        if self.height and self.kind not in NEAR_GROUND:
            raise ValueError(f"height belongs to the kinds {', '.join(NEAR_GROUND)}; leave it out")
        if (self.kind == "device") != bool(self.device):
            raise ValueError(
                "device belongs to the kind 'device'; name the input that moves, such as gear"
            )
        return self

    def marked(self, table: pd.DataFrame) -> pd.DataFrame:
        """Return the rows of a table of manoeuvres that have the name or a mark of this one.

        A mark is the kind of a manoeuvre, or kind and control, as in the fits of a project.
        """
        labels = (table["manoeuvre"] + " " + table["control"].fillna("")).str.strip()
        names = (self.name, *self.marks)
        return table[labels.isin(names) | table["manoeuvre"].isin(names)]

    @property
    def feedback(self) -> float:
        """Share of the pilot's attitude gains that stays during the manoeuvre."""
        if self.hold is not None:
            return self.hold
        if self.kind == "multisine":
            return _MULTISINE_HOLD
        return 0.0


class PlannedFit(Strict):
    """Local models that are fitted at every condition to the named manoeuvres there."""

    name: str
    manoeuvres: tuple[str, ...] = Field(min_length=1)
    models: tuple[str, ...] = Field(min_length=1)
    conditions: tuple[str, ...] = ()


class WantedAccuracy(Strict):
    """Nodes of a term, and their largest standard error after the flights."""

    term: str
    within: dict[str, tuple[float, float]] = Field(default_factory=dict)
    stderr: float | None = Field(default=None, gt=0.0)
    ratio: float | None = Field(default=None, gt=0.0, lt=1.0)

    @field_validator("within", mode="before")
    @classmethod
    def _in_si(cls, table: Any) -> Any:
        if not isinstance(table, dict):
            return table
        ranges = {}
        for name, pair in table.items():
            if not isinstance(pair, list) or len(pair) != 2:
                raise ValueError(f"{name}: expected [lowest, highest]")
            ranges[name] = (_si(name, pair[0]), _si(name, pair[1]))
        return ranges

    @model_validator(mode="after")
    def _check_bound(self) -> WantedAccuracy:
        if (self.stderr is None) == (self.ratio is None):
            raise ValueError("give stderr or ratio, one of them")
        return self


class WantedRow(Strict):
    """Row of a proof of match whose result the database shall predict.

    `ratio` is the largest width: two standard errors of the predicted miss over the tolerance.
    `events` are instants that the row needs, from the start of the manoeuvre; `window` is that of
    the replay, else 2 s before the manoeuvre to its end. [s]
    """

    row: str
    condition: str
    manoeuvre: str
    ratio: float = Field(gt=0.0)
    standard: str = ""
    edition: str = ""
    features: tuple[str, ...] = ()
    mode_channel: str = ""
    events: dict[str, float] = Field(default_factory=dict)
    window: tuple[float, float] | None = None

    @property
    def name(self) -> str:
        """Name of the row in tables."""
        return f"{self.row}, {self.condition}, {self.manoeuvre}"


class Catalogue(Strict):
    """Conditions, manoeuvres and fits of a programme, and the wanted accuracy."""

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
    wanted: tuple[WantedAccuracy, ...] = ()
    wanted_row: tuple[WantedRow, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _one_manoeuvre_per_height(cls, content: Any) -> Any:
        return split_heights(content)

    @field_validator("limits", mode="before")
    @classmethod
    def _limits_in_si(cls, table: Any) -> Any:
        return ConditionTable.model_validate({"limits": table}).limits

    @field_validator("manoeuvre", mode="before")
    @classmethod
    def _with_designs(cls, items: Any) -> Any:
        if not isinstance(items, list):
            return items
        return [_with_design(item) for item in items]

    @model_validator(mode="after")
    def _check_names(self) -> Catalogue:
        problems = [
            *_find_repeated("condition", self.condition),
            *_find_repeated("manoeuvre", self.manoeuvre),
            *_find_repeated("fit", self.fit),
        ]
        conditions = [condition.name for condition in self.condition]
        for manoeuvre in self.manoeuvre:
            where = f"manoeuvre {manoeuvre.name!r}"
            problems += _find_unknown(where, manoeuvre.conditions, conditions, what="condition")
        for fit in self.fit:
            where = f"fit {fit.name!r}"
            problems += _find_unknown(where, fit.conditions, conditions, what="condition")
        problems += self._check_fits()
        problems += self._check_rows()
        if not (self.wanted or self.wanted_row):
            problems.append("nothing is wanted; give [[wanted]] nodes or a [[wanted_row]]")
        problems += _find_unknown("errors", self.errors, ERRORS, what="source of error")
        if problems:
            raise ValueError("; ".join(problems))
        return self

    def _check_fits(self) -> list[str]:
        """Return the faults of manoeuvres and models of the fits."""
        problems = []
        manoeuvres = [manoeuvre.name for manoeuvre in self.manoeuvre]
        for fit in self.fit:
            where = f"fit {fit.name!r}"
            problems += _find_unknown(where, fit.manoeuvres, manoeuvres, what="manoeuvre")
            for text in fit.models:
                try:
                    RegressionModel.parse(text)
                except AeromatchError as error:
                    problems.append(f"{where}: {error}")
        return problems

    def _check_rows(self) -> list[str]:
        """Return the faults of the wanted rows: names that do not exist, and rows given twice."""
        problems = _find_repeated("wanted_row", self.wanted_row)
        flyable = {(condition.name, manoeuvre.name) for condition, manoeuvre in self.flyable()}
        for wanted in self.wanted_row:
            item = (wanted.condition, wanted.manoeuvre)
            if item not in flyable:
                names = "; ".join(sorted(", ".join(pair) for pair in flyable))
                problems.append(
                    f"wanted_row {wanted.row!r}: {', '.join(item)} is not a manoeuvre of the "
                    f"catalogue at that condition; there are {names}"
                )
        return problems

    def flyable(self) -> list[tuple[PlannedCondition, PlannedManoeuvre]]:
        """Return every condition with every manoeuvre that is allowed there."""
        pairs = []
        for condition in self.condition:
            for manoeuvre in self.manoeuvre:
                if not manoeuvre.conditions or condition.name in manoeuvre.conditions:
                    pairs.append((condition, manoeuvre))
        return pairs


def read_catalogue(path: str | os.PathLike) -> Catalogue:
    """Return the catalogue of a flight-test programme from a TOML file.

    Raises
    ------
    ParseError
        The file is not TOML.
    SchemaError
        Every unknown key, missing value and wrong unit, and every name of a condition or manoeuvre
        that the file does not have.
    """
    return validate_content(Catalogue, dict(read_toml(os.fspath(path))), os.fspath(path))


def _with_design(item: Any) -> Any:
    """Return a manoeuvre with the keys of a test input as a `Design`, and amplitudes in SI."""
    # a value of another type is reported by the validation of the field
    if not isinstance(item, dict):
        return item
    if item.get("kind") not in INPUTS:
        if "amplitude" not in item:
            return item
        name = _OF_KIND.get(str(item.get("kind")), str(item.get("device", "")))
        return {**item, "amplitude": _si(name, item["amplitude"])}
    manoeuvre, content = {}, {"kind": item["kind"]}
    for key, value in item.items():
        if key in _MANOEUVRE_KEYS:
            manoeuvre[key] = value
        else:
            content[key] = value
    try:
        design = design_of(content, "test input")
        # faults of the signal are reported with those of the file
        design.signal()
    except SchemaError as error:
        raise ValueError("; ".join(error.problems)) from error
    return {**manoeuvre, "design": design}


def _find_repeated(what: str, items: Any) -> list[str]:
    """Return a fault for each name that several items have."""
    names = [item.name for item in items]
    problems = []
    for name in dict.fromkeys(names):
        if names.count(name) > 1:
            problems.append(f"{what} {name!r} is there twice; give every {what} a name of its own")
    return problems


def _find_unknown(
    where: str, names: Iterable[str], allowed: Collection[str], *, what: str
) -> list[str]:
    """Return a fault for each name that is not allowed."""
    problems = []
    for name in names:
        if name not in allowed:
            problems.append(f"{where}: {UnknownName(name, allowed, what)}")
    return problems


def _si(name: str, item: Any) -> float:
    """Return a quantity by name in SI; without a name it is a plain number."""
    try:
        units = lookup(name).units if name else "1"
        return parse_quantity(item, units)
    except (UnknownName, UnitError) as error:
        raise ValueError(f"{name}: {error}") from error
