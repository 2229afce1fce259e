"""Engines of an aircraft, and the section ``[[engine]]`` of the aircraft file.

An engine has a table of the static thrust with a lag, a full deck (`propulsion.engine_deck`), or a
propeller that a piston engine, a motor, a deck or a table of power turns.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import xarray as xr
from pydantic import ConfigDict, Field, field_validator, model_validator

from flightmech.aircraft.propulsion.electric_motor import (
    MOTOR_TARGETS,
    ElectricMotor,
    MotorTable,
)
from flightmech.aircraft.propulsion.engine_deck import (
    DeckFiles,
    DeckTable,
    EngineDeck,
    Vector,
    _Length,
    deck_of,
    leaf_from_toml,
)
from flightmech.aircraft.propulsion.piston_engine import (
    PISTON_TARGETS,
    PistonEngine,
    PistonTable,
)
from flightmech.aircraft.propulsion.propeller import (
    PROPELLER_TARGETS,
    Propeller,
    PropellerTable,
)
from flightmech.aircraft.propulsion.shaft_tables import read_part
from flightmech.errors import SchemaError, UnitError
from flightmech.short_text import ShortText
from flightmech.support.hdf5_seal import decoding_errors, demand_self_contained
from flightmech.support.toml_models import Strict
from flightmech.support.toml_quantities import InUnits
from flightmech.terms import check_term

# largest double, the bound of a limit that does not act
MOST = sys.float_info.max
THRUST_AXES = ("throttle", "mach", "h")
_Vector = tuple[_Length, _Length, _Length]


@dataclass(frozen=True)
class Engine(ShortText):
    """One engine.

    Parameters
    ----------
    position : tuple of float (3,)
        Point at which the thrust acts, body axes, from the moment reference point. [m]
    direction : tuple of float (3,)
        Unit vector of the thrust, body axes. The vector (1, 0, 0) pushes forward.
    thrust : Dataset, optional
        Static thrust, a term leaf over ``throttle``, ``mach`` and ``h``. [N]
    time_constant : float
        First-order lag of the thrust behind its static value, 0 without a lag. [s]
    angular_momentum : float
        Angular momentum of the rotors along `direction`, right-handed. The momentum of the spools
        of a deck is added. [kg m2 s-1]
    deck : EngineDeck, optional
        Governor, spools and tables in place of `thrust`. All engines of an aircraft have a deck, or
        none has. With a propeller the tables of thrust are that of the jet, and the propeller
        has a table of shaft power.
    propeller : Propeller, optional
        Propeller at `position`. All engines of an aircraft have one, or none has.
    piston : PistonEngine, optional
        What turns the propeller.
    motor : ElectricMotor, optional
        What turns the propeller.
    feed : tuple of str
        Names of the tanks of `Fuel.tanks` that the engine draws from.
    crossfeed : tuple of str
        Names of further tanks that it draws from while the cross-feed is open.
    """

    position: Vector
    direction: Vector = (1.0, 0.0, 0.0)
    thrust: xr.Dataset | None = None
    time_constant: float = 0.0
    angular_momentum: float = 0.0
    deck: EngineDeck | None = None
    propeller: Propeller | None = None
    piston: PistonEngine | None = None
    motor: ElectricMotor | None = None
    feed: tuple[str, ...] = ()
    crossfeed: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        problems = list(_check_sources(self))
        if problems:
            raise SchemaError("engine", problems)


def list_leaves(engine: Engine) -> dict[str, xr.Dataset]:
    """Return all tables of an engine by target."""
    leaves = {} if engine.thrust is None else {"thrust": engine.thrust}
    for part in (engine.deck, engine.propeller, engine.piston, engine.motor):
        if part is not None:
            leaves |= part.tables
    return leaves


def engine_drives(engines: Sequence[Engine]) -> frozenset[str]:
    """Return the inputs that can drive all engines of an aircraft, as the kernel checks them.

    They are of ``throttle n1_drive thrust_drive torque_drive rpm_drive manifold_pressure_drive``.
    An engine without tables is driven by its thrust alone.
    """
    if not engines:
        return frozenset()
    drives = {"thrust_drive"}
    decked = [engine.deck is not None for engine in engines]
    propelled = [engine.propeller is not None for engine in engines]
    powered = [engine.thrust is not None or engine.deck is not None for engine in engines]
    if all(propelled) or all(powered):
        drives.add("throttle")
    # the gas generator of a coupled deck turns with the propeller
    if all(decked) and not any(engine.deck.coupled for engine in engines if engine.deck):
        drives.add("n1_drive")
    if all(propelled):
        drives |= {"torque_drive", "rpm_drive"}
    if all(engine.piston is not None for engine in engines):
        drives.add("manifold_pressure_drive")
    return frozenset(drives)


def _check_sources(engine: Engine) -> Iterator[str]:
    """Yield the problems of the parts of an engine with each other."""
    if engine.thrust is not None and engine.deck is not None:
        yield "thrust and deck are both given; keep one"
    movers = [name for name in ("deck", "piston", "motor") if getattr(engine, name) is not None]
    if engine.propeller is None:
        for name in ("piston", "motor"):
            if name in movers:
                yield f"{name} is given without a propeller; add the section propeller"
        if engine.deck is not None and engine.deck.coupled:
            yield "the deck is coupled to a propeller that is not given; add the section propeller"
        return
    if len(movers) > 1:
        yield f"{' and '.join(movers)} turn one propeller; keep one"
    if engine.thrust is not None:
        yield "thrust and propeller are both given; the thrust is that of CT_prop: delete thrust"
    if engine.time_constant:
        yield "time_constant lags a static thrust; a propeller has its inertia: delete it"
    powers = {"shaft_power", "corrected_shaft_power"} & set(engine.propeller.tables)
    if not powers and not {"piston", "motor"} & set(movers):
        yield "nothing turns the propeller; give a table shaft_power, or a piston engine or motor"
    if powers and {"piston", "motor"} & set(movers):
        yield f"{min(powers)} and {movers[0]} turn one propeller; keep one"
    for name in ("corrected_shaft_power", "shaft_bsfc"):
        if name in engine.propeller.tables and engine.deck is None:
            yield f"{name} needs the deck of a gas turbine; give one, or use shaft_power"


class EngineTable(Strict):
    """An ``[[engine]]`` of the aircraft file."""

    model_config = ConfigDict(protected_namespaces=())

    position: _Vector = Field(
        description="Where the thrust acts, body axes, from the moment reference point."
    )
    direction: tuple[float, float, float] = Field(
        default=(1.0, 0.0, 0.0),
        description="Direction of the thrust, body axes; [1, 0, 0] pushes forward.",
    )
    time_constant: Annotated[float, InUnits("s")] = Field(
        default=0.0,
        examples=["1.2 s"],
        description="First-order lag of the thrust behind its static value; 0 for none.",
    )
    angular_momentum: Annotated[float, InUnits("kg m2 s-1")] = Field(
        default=0.0,
        examples=[12.0],
        description="Of the rotors, along the direction, right-handed; with a deck on top of what "
        "its spools have.",
    )
    thrust: dict[str, Any] | None = Field(
        default=None,
        json_schema_extra={"propertyNames": {"enum": [*THRUST_AXES, "value"]}},
        examples=[{"throttle": [0.0, 1.0], "value": [300.0, 4500.0]}],
        description="Static thrust [N] as a table over throttle, mach and h; value is ordered as "
        "the axes are written.",
    )
    thrust_file: str | None = Field(
        default=None,
        examples=["thrust.nc"],
        description="netCDF file with the table of the static thrust, relative to this file.",
    )
    deck: DeckTable | None = Field(
        default=None, description="Governor, spools and tables in place of a table of thrust."
    )
    propeller: PropellerTable | None = Field(
        default=None, description="Propeller at the position, with its governor and shaft."
    )
    piston: PistonTable | None = Field(
        default=None, description="Piston engine that turns the propeller."
    )
    motor: MotorTable | None = Field(
        default=None, description="Electric motor that turns the propeller."
    )
    feed: list[str] = Field(
        default_factory=list,
        examples=[["left"]],
        description="Names of the tanks of [fuel] that the engine draws from, the lowest order "
        "first. Every engine has a feed or none has; with it each tank has a state.",
    )
    crossfeed: list[str] = Field(
        default_factory=list,
        examples=[["right"]],
        description="Names of further tanks that it draws from while the input crossfeed is 1.",
    )

    @field_validator("direction")
    @classmethod
    def _unit_vector(cls, direction: Vector) -> Vector:
        length = float(np.linalg.norm(direction))
        # an infinite component passes the check of each number
        if not np.isfinite(length) or length == 0.0:
            raise ValueError("expected a direction with a length, e.g. [1, 0, 0]")
        x, y, z = (component / length for component in direction)
        return x, y, z

    @field_validator("time_constant")
    @classmethod
    def _not_negative(cls, value: float) -> float:
        if value < 0.0:
            raise ValueError("expected zero or a positive time")
        return value

    @model_validator(mode="after")
    def _one_source(self) -> EngineTable:
        keys = ("thrust", "thrust_file", "deck")
        sources = [key for key in keys if getattr(self, key) is not None]
        if len(sources) > 1:
            number = "both" if len(sources) == 2 else "all"
            raise ValueError(f"{' and '.join(sources)} are {number} given; keep one")
        return self


def engine_of(item: EngineTable, number: int, files: DeckFiles, problems: list[str]) -> Engine:
    """Return an engine of the aircraft file.

    Parameters
    ----------
    item : EngineTable
    number : int
        Number of the engine, for the problems.
    files : DeckFiles
        Files in the folder of the aircraft file.
    problems : list of str
        Problems of the tables are appended to it.
    """
    parts: dict[str, Any] = {}
    readers: dict[str, Callable[[], Any]] = {
        "thrust": lambda: _read_thrust(item, files.folder),
        "deck": lambda: None if item.deck is None else deck_of(item.deck, files),
        **{name: partial(_read_section, item, name, files) for name in _SECTIONS},
    }
    for key, read in readers.items():
        try:
            parts[key] = read()
        except (SchemaError, UnitError, ValueError, OSError) as error:
            # the engine is made without the part, so that the problems of others are found too
            if isinstance(error, SchemaError):
                texts = error.problems
            else:
                texts = [_describe_missing_file(item, files.folder) or str(error)]
            problems += [f"engine.{number}.{key}: {text}" for text in texts]
            parts[key] = None
    engine: dict[str, Any] = {
        "position": item.position,
        "direction": item.direction,
        "time_constant": item.time_constant,
        "angular_momentum": item.angular_momentum,
        "feed": tuple(item.feed),
        "crossfeed": tuple(item.crossfeed),
    }
    if any(parts[name] is None and getattr(item, name) is not None for name in readers):
        # A faulty part is a problem of its own: the others do not lack it.
        return Engine(**engine)
    try:
        return Engine(**engine, **parts)
    except SchemaError as error:
        problems += [f"engine.{number}: {text}" for text in error.problems]
        return Engine(**engine)


# Sections of an engine that a dataclass with tables stands for: class, tables, name for problems.
_SECTIONS: dict[str, tuple[type, Mapping[str, str], str]] = {
    "propeller": (Propeller, PROPELLER_TARGETS, "propeller"),
    "piston": (PistonEngine, PISTON_TARGETS, "piston engine"),
    "motor": (ElectricMotor, MOTOR_TARGETS, "electric motor"),
}


def _read_section(item: EngineTable, name: str, files: DeckFiles) -> Any:
    section = getattr(item, name)
    if section is None:
        return None
    part, targets, what = _SECTIONS[name]
    return read_part(section, files, part=part, targets=targets, what=what)


def _read_thrust(item: EngineTable, folder: Path) -> xr.Dataset | None:
    if item.thrust is not None:
        return _thrust_table(item.thrust)
    if item.thrust_file is not None:
        return _thrust_file(folder / item.thrust_file)
    return None


def _describe_missing_file(item: EngineTable, folder: Path) -> str:
    """Return a sentence if the file of the tables does not exist, else an empty text.

    The messages of the libraries that open the file differ from each other.
    """
    sections = (item.deck, item.propeller, item.piston, item.motor)
    names = [item.thrust_file, *(section.file for section in sections if section is not None)]
    for name in names:
        if name and not (folder / name).is_file():
            return f"no file {name!r} in {folder}; give its path from the aircraft file"
    return ""


def _thrust_table(table: Mapping[str, Any]) -> xr.Dataset:
    unknown = sorted(set(table) - {*THRUST_AXES, "value"})
    if unknown:
        raise ValueError(
            f"unknown key {', '.join(unknown)}; allowed: {', '.join(THRUST_AXES)}, value"
        )
    return leaf_from_toml(table, "N")


def _thrust_file(path: Path) -> xr.Dataset:
    demand_self_contained(path)
    with (
        decoding_errors(path, "a table of thrust, netCDF-4"),
        xr.open_dataset(path, engine="h5netcdf", phony_dims="access") as dataset,
    ):
        leaf = dataset.load()
    problems = check_term(leaf)
    if problems:
        raise SchemaError(path.name, problems)
    return leaf
