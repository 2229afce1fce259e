"""File of an aircraft: its tables and keys, their checks, and the JSON schema for editors.

In a file bare numbers are SI, and texts have their unit. Positions are in body axes from the moment
reference point. Only `reference` is relative to the drawing datum::

    name = "T-37"
    S = "182 ft2"
    cbar = 1.66726
    b = "33.83 ft"
    reference = [-4.1, 0.0, 0.3]
    x_ref_mac = 0.25
    mass = 2400.0
    Ixx = 10826.0
    Iyy = 8135.0
    Izz = 15162.0
    cg = [0.0, 0.0, 0.2235]

    [[engine]]
    position = [0.0, -0.762, 0.0]
    direction = [1.0, 0.0, 0.0]
    time_constant = "1.2 s"

    [engine.thrust]
    throttle = [0.0, 1.0]
    mach = [0.0, 0.6]
    value = [[300.0, 150.0], [4559.0, 4100.0]]

    [limits]
    delta_e = ["-20 deg", "17 deg"]

    [control.delta_e]
    S_hinge = 1.5
    c_hinge = 0.35
    gearing = "-1.2 rad/m"

    [instruments.imu]
    position = [0.9, 0.25, 0.32]
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import (
    ConfigDict,
    Field,
    StringConstraints,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from flightmech.aircraft.aircraft import X_REF_MAC, Aircraft, inertia_tensor
from flightmech.aircraft.controls import (
    CONTROLS,
    DEVICE,
    TRAVEL,
    CircuitsTable,
    ControlGeometry,
    circuits_of,
)
from flightmech.aircraft.engine import Engine, EngineTable, engine_of
from flightmech.aircraft.facts import FactsTable, fact_problems
from flightmech.aircraft.fuel import FuelSection, check_feeds, fuel_of, warn_of_full_tanks
from flightmech.aircraft.landing_gear_file import GearTable, gear_of
from flightmech.aircraft.propulsion.engine_deck import DeckFiles
from flightmech.aircraft.separation import StallSection, separation_of
from flightmech.errors import SchemaError, UnitError
from flightmech.names import lookup
from flightmech.quantities import parse_quantity
from flightmech.support.toml_files import read_toml
from flightmech.support.toml_models import Strict, file_schema, fixed_array, validate_content
from flightmech.support.toml_quantities import InUnits, quantity_schema


def read_aircraft(path: str | Path) -> Aircraft:
    """Read an aircraft file.

    Parameters
    ----------
    path : str or path
        TOML file. Paths in the file are relative to its folder.

    Raises
    ------
    ParseError
        The text is not TOML.
    SchemaError
        With all problems: unknown keys, missing values, wrong units, invalid numbers.
    """
    path = Path(path)
    content = validate_content(_AircraftFile, read_toml(path), str(path))
    # Problems in the tables of the parts are collected, so that one error has all of them.
    problems: list[str] = []
    engines = _engines_of(content.engine, path.parent, problems)
    gear = gear_of(content.gear, problems) if content.gear else None
    fed = any(engine.feed or engine.crossfeed for engine in engines)
    fuel = fuel_of(content.fuel, path.parent, problems, fed=fed) if content.fuel else None
    # fuel with problems of its own has no tanks to compare with
    if fuel is not None or content.fuel is None:
        problems += check_feeds(engines, fuel)
    stall = separation_of(content.stall, path.parent, problems) if content.stall else None
    if stall and stall.station > 0.5 * content.b:
        problems.append(
            f"stall: station is {stall.station:.4g} m, beyond the wing tip at "
            f"{0.5 * content.b:.4g} m; give the distance of both stations from the plane of "
            f"symmetry, with its unit"
        )
    controls = {name: ControlGeometry(**dict(item)) for name, item in content.control.items()}
    circuits = circuits_of(content.circuit, controls, problems)
    facts = content.facts.facts()
    sizes = {"S": content.S, "cbar": content.cbar}
    problems += fact_problems(facts, content.mass, engines=len(engines), **sizes)
    if problems:
        raise SchemaError(str(path), problems)
    warn_of_full_tanks(engines, str(path))
    parts: dict[str, Any] = {
        "engines": engines,
        "controls": controls,
        "circuits": circuits,
        "gear": gear,
        "fuel": fuel,
        "stall": stall,
        "facts": facts,
    }
    # all other fields have the same name and type in the file
    for name in Aircraft.__dataclass_fields__:
        if name not in parts:
            parts[name] = getattr(content, name)
    return Aircraft(**parts)


# keys of an aircraft file that name a file of tables
_FILE_KEYS = ("file", "thrust_file")


def aircraft_files(path: str | Path) -> list[Path]:
    """Return an aircraft file and the files of tables that it names, each once.

    A file that is missing is left out, because `read_aircraft` reports it.

    Raises
    ------
    ParseError
        The text is not TOML.
    """
    path = Path(path)
    named = [path.parent / name for name in _named_files(read_toml(path))]
    return [path, *(file for file in dict.fromkeys(named) if file.is_file())]


def _named_files(content: Any) -> Iterator[str]:
    """Yield the names of files in the tables of an aircraft file."""
    if isinstance(content, dict):
        for key, value in content.items():
            if key in _FILE_KEYS and isinstance(value, str):
                yield value
            else:
                yield from _named_files(value)
    elif isinstance(content, list):
        for value in content:
            yield from _named_files(value)


class _EngineSection(Strict):
    """The engines of an aircraft file."""

    engine: list[EngineTable] = []


def read_engines(path: str | Path) -> tuple[Engine, ...]:
    """Read the engines of an aircraft file whose other values may still be missing.

    Raises
    ------
    ParseError
        The text is not TOML.
    SchemaError
        With all problems of ``[[engine]]``.
    """
    path = Path(path)
    section = {"engine": read_toml(path).get("engine", [])}
    content = validate_content(_EngineSection, section, str(path))
    problems: list[str] = []
    engines = _engines_of(content.engine, path.parent, problems)
    if problems:
        raise SchemaError(str(path), problems)
    return engines


def _engines_of(
    items: Iterable[EngineTable], folder: Path, problems: list[str]
) -> tuple[Engine, ...]:
    files = DeckFiles(folder)
    engines = []
    for number, item in enumerate(items, 1):
        engines.append(engine_of(item, number, files, problems))
    return tuple(engines)


# a reason that a reader can judge has more than a word; blanks and dots are none
Reason = Annotated[
    str, StringConstraints(strip_whitespace=True, min_length=15, pattern=r"[^\W_]\W+[^\W_]")
]
_Length = Annotated[float, InUnits("m")]
_Vector = tuple[_Length, _Length, _Length]
# JSON schema of a quantity whose unit depends on the control
_OF_CONTROL = quantity_schema("of the control")
_DEVICES = r"^device\.\w+\.(deflection|setting)$"
_LIMITS = {
    "type": "object",
    "propertyNames": {"anyOf": [{"enum": list(CONTROLS)}, {"pattern": _DEVICES}]},
    "additionalProperties": fixed_array([_OF_CONTROL] * 2),
}


class _NumberOrText(Strict):
    """Table of numbers, which can be texts with a unit. No other text is converted."""

    model_config = ConfigDict(protected_namespaces=())


# [control.NAME] of the file
class _ControlTable(_NumberOrText):
    S_hinge: Annotated[float, InUnits("m2")] = Field(
        description="Area behind the hinge line of all surfaces that the control moves together."
    )
    c_hinge: _Length = Field(description="Mean chord behind the hinge line.")
    gearing: Annotated[float, WithJsonSchema(_OF_CONTROL)] | None = Field(
        default=None,
        description="Deflection per travel of the cockpit control, negative in an ordinary "
        "aeroplane [rad/m; ailerons rad/rad].",
    )

    @field_validator("S_hinge", "c_hinge")
    @classmethod
    def _positive(cls, value: float) -> float:
        return _positive(value)

    @field_validator("gearing")
    @classmethod
    def _not_zero(cls, value: float | None) -> float | None:
        if value is not None and not (np.isfinite(value) and value != 0.0):
            raise ValueError(
                "expected a deflection per travel other than zero; leave it out when it is "
                "not known"
            )
        return value


_FARTHEST = 5.0  # mean chords from the leading edge back to the moment reference point


# The descriptions are those of the JSON schema, which editors show.
class _AircraftFile(_NumberOrText):
    name: str = Field(max_length=200, description="Name of the type.")
    S: Annotated[float, InUnits("m2")] = Field(description="Reference area.")
    cbar: _Length = Field(description="Reference chord.")
    b: _Length = Field(description="Reference span.")
    reference: _Vector | None = Field(
        default=None,
        description="Moment reference point from the drawing datum, body directions; without it "
        "that of the database.",
    )
    x_ref_mac: Annotated[float, InUnits("1")] = Field(
        default=X_REF_MAC,
        description="Place of the reference point behind the leading edge of the mean chord, in "
        "chords.",
    )
    mass: Annotated[float, InUnits("kg")] = Field(description="Gross mass with the fuel on board.")
    Ixx: Annotated[float, InUnits("kg m2")] = Field(
        description="Moment of inertia in roll about the c.g."
    )
    Iyy: Annotated[float, InUnits("kg m2")] = Field(
        description="Moment of inertia in pitch about the c.g."
    )
    Izz: Annotated[float, InUnits("kg m2")] = Field(
        description="Moment of inertia in yaw about the c.g."
    )
    Ixy: Annotated[float, InUnits("kg m2")] = Field(
        default=0.0,
        examples=[0.0],
        description="Product of inertia about the c.g., integral of xy dm.",
    )
    Ixz: Annotated[float, InUnits("kg m2")] = Field(
        default=0.0, description="Product of inertia about the c.g., integral of xz dm."
    )
    Iyz: Annotated[float, InUnits("kg m2")] = Field(
        default=0.0,
        examples=[0.0],
        description="Product of inertia about the c.g., integral of yz dm.",
    )
    cg: _Vector = Field(
        default=(0.0, 0.0, 0.0),
        description="Centre of gravity from the moment reference point, body axes.",
    )
    engine: list[EngineTable] = Field(default_factory=list, description="Engines, engine 1 first.")
    limits: Annotated[dict[str, tuple[float, float]], WithJsonSchema(_LIMITS)] = Field(
        default_factory=dict,
        examples=[{"delta_e": ["-20 deg", "17 deg"]}],
        description="Travel of the controls, [low, high] of each in its SI unit or with units.",
    )
    instruments: dict[str, dict[str, Any]] = Field(
        default_factory=dict,
        description="Instruments of the recorder, one table each; the names of the tables are "
        "free.",
    )
    control: dict[str, _ControlTable] = Field(
        json_schema_extra={"propertyNames": {"enum": list(TRAVEL)}},
        default_factory=dict,
        description="Hinge geometry and gearing of delta_e, delta_a and delta_r.",
    )
    circuit: CircuitsTable = Field(
        default=CircuitsTable(),
        description="Control circuits: what moves with column, wheel and pedal.",
    )
    gear: GearTable | None = Field(
        default=None, description="Landing gear: wheels, skids, steering, brakes and runway."
    )
    fuel: FuelSection | None = Field(
        default=None,
        description="Fuel on board, part of the mass; without it the mass does not change.",
    )
    stall: StallSection | None = Field(  # type: ignore[valid-type]
        default=None, description="Flow separation of both wing halves, a state of the simulation."
    )
    earth_outputs: bool = Field(
        default=False,
        description="Whether models have outputs in Earth-fixed and inertial axes (earth.x, "
        "inertial.vx) and the gravitation.",
    )
    acknowledged: dict[str, Reason] = Field(
        default={},
        examples=[{"static margin": "relaxed stability by design"}],
        description="Why unusual values of the database are right, by the subject that "
        "`aeromatch db check` prints; the report prints the reason.",
    )
    facts: FactsTable = FactsTable()
    history: str = Field(
        default="",
        examples=["rescaled to a span of 11 m"],
        description="Where computed numbers come from, one line per step.",
    )

    @field_validator("S", "cbar", "b", "mass", "Ixx", "Iyy", "Izz")
    @classmethod
    def _positive(cls, value: float) -> float:
        return _positive(value)

    @field_validator("x_ref_mac")
    @classmethod
    def _share_of_chord(cls, value: float) -> float:
        """Raise for a place in per cent: no aeroplane reaches five chords behind its wing."""
        if value > _FARTHEST:
            raise ValueError(
                f"{value:g} is {value:g} mean chords behind the leading edge; it is a share of the "
                f"mean chord, at most {_FARTHEST:g}: write {value / 100.0:g} or '{value:g} %' for "
                f"{value:g} %"
            )
        return value

    @field_validator("control", mode="before")
    @classmethod
    def _gearings(cls, table: Any) -> Any:
        """Convert the gearings to SI. Their unit depends on the control."""
        if not isinstance(table, dict):
            # the check of the type follows
            return table
        unknown = sorted(set(table) - set(TRAVEL))
        if unknown:
            raise ValueError(f"unknown control {', '.join(unknown)}; allowed: {', '.join(TRAVEL)}")
        return {name: _convert_gearing(item, TRAVEL[name][1]) for name, item in table.items()}

    @field_validator("limits", mode="before")
    @classmethod
    def _travel(cls, table: Any) -> dict[str, tuple[float, float]]:
        if not isinstance(table, dict):
            raise ValueError(
                'expected a table of control = [low, high], e.g. delta_e = ["-20 deg", "17 deg"]'
            )
        return {name: _parse_limits(name, item) for name, item in table.items()}

    @model_validator(mode="after")
    def _inertia(self) -> _AircraftFile:
        # moments and products of a body with mass have a positive definite tensor
        tensor = inertia_tensor(self)
        if not (np.linalg.eigvalsh(tensor) > 0.0).all():
            raise ValueError(
                "the inertia tensor is not positive definite; check moments and products of inertia"
            )
        return self


def aircraft_schema() -> dict[str, Any]:
    """Return the JSON schema of aircraft files, without the keys of the instruments.

    `flighttest` has the schema of the instruments.
    """
    return file_schema(
        _AircraftFile,
        "An aircraft: geometry, mass, engines, limits, instruments, control circuits, "
        "landing gear, fuel and stall.",
    )


def _positive(value: float) -> float:
    if not (np.isfinite(value) and value > 0.0):
        raise ValueError("expected a positive number")
    return value


def _convert_gearing(item: Any, units: str) -> Any:
    if not isinstance(item, dict) or "gearing" not in item:
        return item
    try:
        return {**item, "gearing": parse_quantity(item["gearing"], units)}
    except UnitError as error:
        raise ValueError(f"gearing: {error}") from error


def _parse_limits(name: str, item: Any) -> tuple[float, float]:
    # other controls exist only in the tables of a database
    if name not in CONTROLS and not re.match(_DEVICES, name):
        raise ValueError(
            f"unknown control {name}; allowed: {', '.join(CONTROLS)}, and "
            f"{DEVICE}NAME.deflection or {DEVICE}NAME.setting"
        )
    if not isinstance(item, list | tuple) or len(item) != 2:
        raise ValueError(f"{name}: expected [low, high]")
    try:
        low, high = (parse_quantity(limit, lookup(name).units) for limit in item)
    except UnitError as error:
        raise ValueError(f"{name}: {error}") from error
    if not low < high:
        raise ValueError(f"{name}: low {low:g} is not below high {high:g}")
    return low, high
