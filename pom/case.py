"""A Proof-of-Match case: one row of the tolerance table, one window of one flight record, and how the model is driven."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar

from pydantic import Field, model_validator

from flightmech.configuration import Strict, load, validate
from flightmech.errors import AeromatchError, SchemaError, UnknownName
from flightmech.names import lookup
from flightmech.units import quantity

from . import table
from .criteria import Criterion
from .override import override
from .pilot import Loop

T = TypeVar("T")
SURFACES = ("delta_e", "delta_a", "delta_r", "delta_t", "delta_ta", "delta_tr", "delta_f", "delta_s", "delta_d")
BRAKES = ("brake_left", "brake_right")
INPUTS = (*SURFACES, "gear", "speedbrake", "delta_nw", *BRAKES)
WIND = ("wind_n", "wind_e", "wind_d")
INITIAL = ("V", "alpha", "beta", "gamma", "phi", "theta", "psi", "p", "q", "r", "h", "lat", "lon")
MASS = ("mass", "x_cg_b", "y_cg_b", "z_cg_b", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
CONDITIONS = (*INPUTS, *WIND, *INITIAL, *MASS, "delta_T", "runway_elevation")
SHOWN = ("V_cas", "h", "alpha", "beta", "phi", "theta", "psi", "p", "q", "r", "nz")


@dataclass(frozen=True)
class Drive:
    """How the model is driven.

    Attributes
    ----------
    surfaces : str
        ``recorded``: recorded surface positions; ``cockpit``: recorded travel of column, wheel and pedals; ``force``: recorded
        pilot forces; ``pilot``: the recorded controls plus what the loops of the math pilot add.
    engine : str
        ``thrust``: recorded thrust drives; ``n1``: the recorded fan speed; ``throttle``: the recorded lever drives the engine model.
    trim : bool or "ground"
        Trim the model to the flight condition at the start of the window; its biases are reported.  ``ground``: it stands or
        rolls on its wheels, whose height and attitude are sought; the surfaces stay as recorded.
    limits : dict of str to float
        Largest bias of the trim (``trim.delta_e`` ...) that is not remarked. [SI]
    pilot : tuple of Loop
        Loops of the math pilot; only with ``surfaces = "pilot"``.
    """

    surfaces: str = "recorded"
    engine: str = "thrust"
    trim: bool | str = True
    limits: dict[str, float] = field(default_factory=dict)
    pilot: tuple[Loop, ...] = ()

    @classmethod
    def from_dict(cls, item: Mapping[str, Any]) -> Drive:
        """Rebuild a drive from ``dataclasses.asdict``."""
        return cls(**{**item, "pilot": tuple(Loop(**loop) for loop in item.get("pilot", ()))})


@dataclass(frozen=True)
class PomCase:
    """A case, resolved: defaults filled in, criteria looked up, windows in seconds of the record's clock.

    Attributes
    ----------
    name, title, description : str
    id, standard, edition : str
        Test, standard and edition of the tolerance table.
    path, record, names, aircraft : str
        The case file, the flight record, its name map and the aircraft file.
    window : tuple of float
        Start and end of the replay. [s]
    drive : Drive
    conditions : dict of str to float
        What the case file says against the record. [SI]
    events : dict of str to float
        Marked instants that bound windows: ``input_end``, ``change_start`` ... [s]
    features : tuple of str
        Conditions of table rows that hold, e.g. ``reversible_controls``.
    shortened : str
        Why a window is shorter than the table asks; empty when none is.
    show : tuple of str
        Channels to show beside the judged ones.
    criteria : tuple of Criterion
    reference : str
        ``flight``; ``engineering``: data of an engineering simulator; ``footprint``: a recording without a reference, which has
        no band and no verdict.
    fraction : float
        Share of the tolerance that is applied. [1]
    wind : str
        ``record``: the wind of the reconstruction; ``measured``: that of the raw record; ``none``: calm air.
    ranges : dict of str to float
        Largest value in service by channel, the base of lone percentages (``range_max``, rule R3). [SI]
    certified : dict of str to float
        Certified values below which a criterion fails inside its band, by parameter (climb gradients of 1.c.2, 1.c.4). [SI]
    ticks : dict of str to str
        By advisory criterion: name, date and words of the engineer who ticked it.
    rationale : dict of str to str
        By criterion or channel: why it is as it is.
    source : dict of str to str
        Where the flight data come from: document, pages, flight, run, filters ...
    objective, procedure, manual, evaluation, notes : str
        What the test shows, how it is flown automatically and by hand, how it is evaluated, remarks.
    """

    name: str
    title: str
    id: str
    standard: str
    edition: str
    path: str
    record: str
    window: tuple[float, float]
    description: str = ""
    names: str = ""
    aircraft: str = ""
    drive: Drive = Drive()
    conditions: dict[str, float] = field(default_factory=dict)
    events: dict[str, float] = field(default_factory=dict)
    features: tuple[str, ...] = ()
    shortened: str = ""
    show: tuple[str, ...] = SHOWN
    criteria: tuple[Criterion, ...] = ()
    reference: str = "flight"
    fraction: float = 1.0
    wind: str = "record"
    ranges: dict[str, float] = field(default_factory=dict)
    certified: dict[str, float] = field(default_factory=dict)
    ticks: dict[str, str] = field(default_factory=dict)
    rationale: dict[str, str] = field(default_factory=dict)
    source: dict[str, str] = field(default_factory=dict)
    objective: str = ""
    procedure: str = ""
    manual: str = ""
    evaluation: str = ""
    notes: str = ""

    def files(self) -> list[str]:
        """Return the case file and the files it names."""
        return [name for name in (self.path, self.record, self.names, self.aircraft) if name]

    def to_dict(self) -> dict[str, Any]:
        """Return the case as plain data."""
        return asdict(self)

    @classmethod
    def from_dict(cls, item: Mapping[str, Any]) -> PomCase:
        """Rebuild a case from `to_dict`."""
        return cls(
            **{
                **item,
                "window": (item["window"][0], item["window"][1]),
                "drive": Drive.from_dict(item["drive"]),
                "features": tuple(item["features"]),
                "show": tuple(item["show"]),
                "criteria": tuple(Criterion.from_dict(c) for c in item["criteria"]),
            }
        )


class _Case(Strict):
    id: str
    standard: str = table.STANDARD
    edition: str = table.EDITION
    name: str
    title: str
    description: str = ""
    record: str
    names: str = ""
    aircraft: str = ""
    window: tuple[float, float]
    features: tuple[str, ...] = ()
    shortened: str = ""
    show: tuple[str, ...] = SHOWN
    mode_channel: str = ""
    engine_parameter: str = ""

    @model_validator(mode="after")
    def _window_rises(self) -> _Case:
        if not self.window[0] < self.window[1]:
            raise ValueError(f"window must start before it ends, not {self.window[0]:g} ... {self.window[1]:g} s")
        return self


class _Drive(Strict):
    surfaces: Literal["recorded"] = "recorded"
    engine: Literal["thrust", "n1", "throttle"] = "thrust"
    trim: bool | Literal["ground"] = True


class _File(Strict):
    case: _Case
    drive: _Drive = _Drive()
    conditions: dict[str, float | str] = Field(default_factory=dict)
    events: dict[str, float] = Field(default_factory=dict)
    tolerance: dict[str, Any] = Field(default_factory=dict)


def read_case(path: str | Path) -> PomCase:
    """Read a case file and resolve it against the tolerance table.

    Parameters
    ----------
    path : str or Path
        TOML file; `docs/pom.md` describes it.  Files it names are relative to it.

    Raises
    ------
    ParseError
        The file is not TOML.
    SchemaError
        With every problem of the file: unknown keys and their near names, units, events without a time, windows.
    """
    path = Path(path)
    content = load(path)
    try:
        file = validate(_File, content, f"case {path}")
    except SchemaError as error:
        raise SchemaError(error.what, [*error.problems, *_loose_problems(content)]) from None
    problems: list[str] = []
    conditions = _conditions(file.conditions, problems)
    for name in file.case.show:
        _collect(problems, "case.show", lookup, name)
    for word in file.case.features:
        if word not in table.features():
            problems.append(f"case.features: {UnknownName(word, table.features(), 'condition')}")
    _check_events(file.events, problems)
    places = {key: _place(path, getattr(file.case, key), key, problems) for key in ("record", "names", "aircraft")}
    criteria = _criteria(file, problems)
    if problems:
        raise SchemaError(f"case {path}", problems)
    case = file.case
    return PomCase(
        name=case.name,
        title=case.title,
        id=case.id,
        standard=case.standard,
        edition=case.edition,
        path=str(path),
        window=case.window,
        description=case.description,
        drive=Drive(**file.drive.model_dump()),
        conditions=conditions,
        events=dict(file.events),
        features=case.features,
        shortened=case.shortened,
        show=case.show,
        criteria=tuple(criteria),
        **places,
    )


def _loose_problems(content: dict[str, Any]) -> list[str]:
    """Return what can be said about the free tables of a file whose form is wrong elsewhere."""
    problems: list[str] = []
    conditions, events = content.get("conditions"), content.get("events")
    if isinstance(conditions, dict):
        _conditions(conditions, problems)
    if isinstance(events, dict):
        _check_events(events, problems)
    return problems


def _collect(problems: list[str], place: str, act: Callable[..., T], *items: Any) -> T | None:
    """Return ``act(*items)``; an error of the house becomes one more problem."""
    try:
        return act(*items)
    except SchemaError as error:
        problems += [f"{place}: {text}" for text in error.problems]
        return None
    except AeromatchError as error:
        problems.append(f"{place}: {error}")
        return None


def _conditions(found: Mapping[str, Any], problems: list[str]) -> dict[str, float]:
    values = {}
    for name, item in found.items():
        if name not in CONDITIONS:
            problems.append(f"conditions: {UnknownName(name, CONDITIONS, 'condition')}")
            continue
        value = _collect(problems, f"conditions.{name}", quantity, item, lookup(name).units)
        if value is not None:
            values[name] = value
    return values


def _check_events(found: Mapping[str, Any], problems: list[str]) -> None:
    for name in found:
        if name not in table.events():
            problems.append(f"events: {UnknownName(name, table.events(), 'event')}")


def _place(path: Path, name: str, key: str, problems: list[str]) -> str:
    if not name:
        return ""
    place = path.parent / name
    if not place.is_file():
        problems.append(f"case.{key}: no file {place}; the name is relative to the case file")
    return os.path.normpath(place)


def _criteria(file: _File, problems: list[str]) -> list[Criterion]:
    case = file.case
    rows = _collect(problems, "case.id", table.rows_of, case.id, case.standard, case.edition) or []
    criteria = []
    for row, name in zip(rows, table.names_of(rows), strict=True):
        window = _window(row, name, file, problems)
        found = table.criterion(row, name, window, case.features, case.mode_channel, case.engine_parameter)
        if found.applies and found.measure.startswith("response_") and not found.channel:
            problems.append(f"case.engine_parameter: missing; row {name} needs the channel of the critical engine parameter")
        if found.applies and found.measure == "steady" and "capture" not in file.events:
            problems.append(f"events.capture: missing; row {name} is a snapshot and needs its instant")
        criteria.append(found)
    for key, item in file.tolerance.items():
        changed = _collect(problems, f"tolerance.{key}", override, criteria, key, item, case.window)
        criteria = changed if changed is not None else criteria
    return criteria


def _window(row: table.Row, name: str, file: _File, problems: list[str]) -> tuple[float, float]:
    """Return the window of a row; longer than the case's window only with a stated reason."""
    start, stop = file.case.window
    if row["condition"] and not set(row["condition"].split(";")) <= set(file.case.features):
        return file.case.window
    found = []
    for mark, default in ((row["applies_from"], start), (row["applies_to"], stop)):
        time = _collect(problems, f"events, row {name}", table.bound, mark, file.events, default)
        found.append(default if time is None else float(time))
    asked = f"{found[0]:g} ... {found[1]:g} s"
    inside = max(found[0], start), min(found[1], stop)
    if not inside[0] < inside[1]:
        problems.append(f"events: row {name} asks for {asked}, outside the case window {start:g} ... {stop:g} s")
    elif inside != (found[0], found[1]) and not file.case.shortened:
        problems.append(
            f"case.window: {start:g} ... {stop:g} s is shorter than row {name} asks ({asked}, {row['applies_from']} to "
            f"{row['applies_to'] or 'the end'}); widen it, or say why in case.shortened"
        )
    return inside
