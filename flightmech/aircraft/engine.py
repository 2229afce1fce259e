"""A full engine deck: governor schedule, spools, flame, and tables of thrust, air flow, fuel flow
and temperature.

``[engine.deck]`` in the aircraft file; what the kernel makes of it stands in docs/engine.md::

    [engine.deck]
    file = "engine.nc"                 # a leaf per target, or tables here
    lever_delay = "0.1 s"

    [engine.deck.tables]
    n2_command = { throttle = [0.0, 1.0], value = [0.6, 1.0] }
    n2_up_time = "0.4 s"               # a number is a table without axes
    corrected_thrust = { corrected_n1 = [0.3, 1.1], mach = [0.0, 0.5], value = [["300 N", "150 N"], ["9000 N", "7000 N"]] }
    windmill_thrust = { value = -0.03, regressors = ["qbar"] }
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import ConfigDict, Field, field_validator, model_validator

from flightmech.errors import AeromatchError, SchemaError, UnitError, UnknownName
from flightmech.names import lookup
from flightmech.support.hdf5_seal import demand_self_contained
from flightmech.support.netcdf_trees import read_netcdf_tree
from flightmech.support.toml_models import Strict
from flightmech.support.toml_quantities import InUnits
from flightmech.terms import check_term, make_term
from flightmech.units import parse_quantity

if TYPE_CHECKING:
    import xarray as xr

Vector = tuple[float, float, float]
_SPOOLS = ("n1", "n2")
# what the tables of a deck give, and in which unit; `thrust` and those without `corrected_` are
# taken as they stand
TARGETS = {
    "thrust": "N",
    "corrected_thrust": "N",
    "windmill_thrust": "N",
    "air_flow": "kg s-1",
    "corrected_air_flow": "kg s-1",
    "fuel_flow": "kg s-1",
    "corrected_fuel_flow": "kg s-1",
    "itt": "K",
    "corrected_itt": "K",
    **{f"{n}_command": "1" for n in _SPOOLS},
    **{f"corrected_{n}_command": "1" for n in _SPOOLS},
    **{f"{n}_{way}_time": "s" for n in _SPOOLS for way in ("up", "down")},
    **{f"{n}_{way}_limit": "s-1" for n in _SPOOLS for way in ("up", "down")},
    **{f"corrected_{n}_windmill": "1" for n in _SPOOLS},
    "corrected_n2_driven": "1",
    "burn_margin": "1",
    "light_margin": "1",
}
OWN = (
    "throttle",
    "pla",
    *_SPOOLS,
    "corrected_n1",
    "corrected_n2",
    "temperature_ratio",
    "pressure_ratio",
)  # variables of one engine


@dataclass(frozen=True)
class EngineDeck:
    """Tables and constants of a full engine deck.

    Speeds are fractions of the rated speeds.  The defaults are round figures of a small turbofan,
    not of one engine.

    Parameters
    ----------
    tables : mapping of str to Dataset
        Target (the keys of `TARGETS`) to a term leaf; the variables of the engine itself (`OWN`)
        without its number.
    lever_delay : float
        Transport delay of the power lever. [s]
    pla_idle, pla_full : float
        Lever angle at throttle 0 and 1. [rad]
    n1_rundown, n2_rundown : float
        Time constants towards the windmilling speed when the engine does not burn. [s]
    starter_speed, starter_time : float
        Speed of the gas generator to which the starter turns it, and its time constant. [1], [s]
    light_speed, sustain_speed : float
        Least speed of the gas generator at which the engine lights, and at which it goes on
        burning. [1]
    flame_time : float
        Time constant of the flame. [s]
    itt_time : float
        Lag of the turbine temperature; 0 for none. [s]
    n1_rated, n2_rated : float
        Rotor speeds at 1, positive right-handed about the thrust. [rad s-1]
    n1_inertia, n2_inertia : float
        Moments of inertia of the rotors. [kg m2]
    inlet : tuple of float (3,), optional
        Where the ram drag acts, body axes, from the moment reference point; the engine's position
        without it. [m]
    """

    tables: Mapping[str, xr.Dataset]
    lever_delay: float = 0.0
    pla_idle: float = 0.0
    pla_full: float = 1.0
    n1_rundown: float = 8.0
    n2_rundown: float = 8.0
    starter_speed: float = 0.2
    starter_time: float = 4.0
    light_speed: float = 0.1
    sustain_speed: float = 0.05
    flame_time: float = 0.2
    itt_time: float = 0.0
    n1_rated: float = 0.0
    n2_rated: float = 0.0
    n1_inertia: float = 0.0
    n2_inertia: float = 0.0
    inlet: Vector | None = None

    def __post_init__(self) -> None:
        problems = list(_problems(self.tables))
        if problems:
            raise SchemaError("engine deck", problems)


_Length = Annotated[float, InUnits("m")]


class DeckTable(Strict):
    """An ``[engine.deck]`` of the aircraft file."""

    model_config = ConfigDict(protected_namespaces=())

    file: str | None = Field(
        default=None, description="netCDF file with a group for each table, relative to this file."
    )
    tables: dict[str, Any] = Field(
        default_factory=dict,
        json_schema_extra={"propertyNames": {"enum": list(TARGETS)}},
        examples=[{"n2_up_time": "0.4 s"}],
        description="Tables here: a number, or axes with value and, as needed, regressors and "
        "outside.",
    )
    lever_delay: Annotated[float, InUnits("s")] | None = Field(
        default=None, description="Transport delay of the power lever; 0 without it."
    )
    pla_idle: Annotated[float, InUnits("rad")] | None = Field(
        default=None, examples=["10 deg"], description="Lever angle at throttle 0; 0 without it."
    )
    pla_full: Annotated[float, InUnits("rad")] | None = Field(
        default=None,
        examples=["50 deg"],
        description="Lever angle at throttle 1; 1 rad without it.",
    )
    n1_rundown: Annotated[float, InUnits("s")] | None = Field(
        default=None,
        examples=["8 s"],
        description="Time constant of the fan towards its windmilling speed when the engine does "
        "not burn; 8 s without it.",
    )
    n2_rundown: Annotated[float, InUnits("s")] | None = Field(
        default=None, examples=["8 s"], description="The same of the gas generator; 8 s without it."
    )
    starter_speed: Annotated[float, InUnits("1")] | None = Field(
        default=None,
        examples=[0.2],
        description="Speed to which the starter turns the gas generator; 0.2 without it.",
    )
    starter_time: Annotated[float, InUnits("s")] | None = Field(
        default=None, examples=["4 s"], description="Time constant of the starter; 4 s without it."
    )
    light_speed: Annotated[float, InUnits("1")] | None = Field(
        default=None,
        examples=[0.1],
        description="Least speed of the gas generator at which the engine lights; 0.1 without it.",
    )
    sustain_speed: Annotated[float, InUnits("1")] | None = Field(
        default=None,
        examples=[0.05],
        description="Least speed of the gas generator at which it goes on burning; 0.05 without it.",
    )
    flame_time: Annotated[float, InUnits("s")] | None = Field(
        default=None,
        examples=["0.2 s"],
        description="Time constant of the flame; 0.2 s without it.",
    )
    itt_time: Annotated[float, InUnits("s")] | None = Field(
        default=None,
        examples=["1.5 s"],
        description="Lag of the turbine temperature; none without it.",
    )
    n1_rated: Annotated[float, InUnits("rad s-1")] | None = Field(
        default=None,
        examples=["1700 rad/s"],
        description="Speed of the fan at 1, positive right-handed about the thrust.",
    )
    n2_rated: Annotated[float, InUnits("rad s-1")] | None = Field(
        default=None,
        examples=["3400 rad/s"],
        description="Speed of the gas generator at 1, positive right-handed about the thrust.",
    )
    n1_inertia: Annotated[float, InUnits("kg m2")] | None = Field(
        default=None, examples=[0.5], description="Moment of inertia of the fan rotor."
    )
    n2_inertia: Annotated[float, InUnits("kg m2")] | None = Field(
        default=None, examples=[0.1], description="Moment of inertia of the gas generator's rotor."
    )
    inlet: tuple[_Length, _Length, _Length] | None = Field(
        default=None,
        examples=[[0.5, 0.0, 0.1]],
        description="Where the ram drag acts, body axes, from the moment reference point; the "
        "engine's position without it.",
    )


CONSTANTS = tuple(
    field.name for field in fields(EngineDeck) if field.name not in ("tables", "inlet")
)


class DeckFiles:
    """Files of tables in a folder, each read once: the engines of an aircraft usually share one
    deck.

    Attributes
    ----------
    folder : Path
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._read: dict[str, dict[str, xr.Dataset]] = {}

    def of(self, name: str) -> dict[str, xr.Dataset]:
        """Return the leaves of a file, as `open_tables`."""
        if name not in self._read:
            self._read[name] = open_tables(self.folder / name)
        return {target: leaf.copy() for target, leaf in self._read[name].items()}


def deck_of(item: DeckTable, files: DeckFiles) -> EngineDeck:
    """Return the deck of an aircraft file next to `files`.

    Raises
    ------
    SchemaError
        With all problems of its tables.
    """

    tables: dict[str, xr.Dataset] = {}
    problems: list[str] = []
    if item.file is not None:
        tables |= files.of(item.file)
    for target, content in item.tables.items():
        try:
            tables[target] = (
                leaf_from_toml(content, TARGETS[target]) if target in TARGETS else make_term(0.0)
            )
        except (AeromatchError, ValueError) as error:
            problems += [f"{target}: {text}" for text in getattr(error, "problems", [str(error)])]
            tables[target] = make_term(1.0)  # its place is taken: what else is wrong is still found
    problems += _problems(tables)
    if problems:
        raise SchemaError("engine deck", problems)
    given = {
        name: value for name in (*CONSTANTS, "inlet") if (value := getattr(item, name)) is not None
    }
    return EngineDeck(tables, **given)


def leaf_from_toml(item: Any, units: str) -> xr.Dataset:
    """Return a leaf from its form in a TOML file: a number, or a table of axes, ``value`` and, as
    wanted, ``regressors`` and ``outside``.

    Parameters
    ----------
    item : number, str or mapping
        Bare numbers are SI, texts carry their unit; `value` is ordered as the axes are written.
    units : str
        SI unit of the value; with regressors it is a bare number in units over those of the
        regressors.
    """

    if not isinstance(item, Mapping):
        return make_term(parse_quantity(item, units))
    if "value" not in item:
        raise ValueError(f"missing value, in {units} over the axes in the order they are written")
    words = [str(word) for word in item.get("regressors", ())]
    reserved = ("value", "regressors", "outside")
    axes = {
        name: [parse_quantity(point, lookup(name).units) for point in points]
        for name, points in item.items()
        if name not in reserved
    }
    value = np.vectorize(
        lambda number: parse_quantity(number, "1" if words else units), otypes=[float]
    )(np.array(item["value"], object))
    shape = tuple(len(points) for points in axes.values())
    if value.shape != shape:
        raise ValueError(
            f"value has the shape {value.shape}, the axes {' '.join(axes)} have {shape}"
        )
    return make_term(value, axes, words, outside=str(item.get("outside", "hold")))


def open_tables(path: Path) -> dict[str, xr.Dataset]:
    """Return the leaves of a netCDF file by their target, the name of the group.

    Raises
    ------
    SchemaError
        With all faults of the leaves.
    OSError
        The file is not there or no netCDF.
    """

    demand_self_contained(path)
    tree, problems = read_netcdf_tree(path)
    leaves = {str(name): node.to_dataset() for name, node in tree.children.items()}
    for name, leaf in leaves.items():
        problems += [f"{name}: {text}" for text in check_term(leaf)]
    if problems:
        raise SchemaError(path.name, problems)
    return leaves


def write_tables(tables: Mapping[str, xr.Dataset], path: Path, **attributes: str) -> None:
    """Write the leaves of a deck to a netCDF file, one group per target."""
    import xarray as xr

    tree = xr.DataTree.from_dict({f"/{name}": leaf for name, leaf in tables.items()})
    tree.attrs.update(attributes)
    tree.to_netcdf(path, engine="h5netcdf")


def _problems(tables: Mapping[str, xr.Dataset]) -> Iterator[str]:
    for target in sorted(set(tables) - set(TARGETS)):
        yield str(UnknownName(target, TARGETS, "table of an engine deck"))
    if not {"thrust", "corrected_thrust"} & set(tables):
        yield "no table of the thrust; give corrected_thrust or thrust"
    governed = [n for n in _SPOOLS if {f"{n}_command", f"corrected_{n}_command"} & set(tables)]
    if not governed:
        yield "no table of a commanded speed; give n1_command or n2_command over the lever, or their corrected_ forms"
    for n in governed:
        if f"{n}_up_time" not in tables:
            yield f"{n} has a command and no {n}_up_time, the time constant with which it follows"
    for name in sorted(
        set(tables)
        & {
            f"{n}_{way}_{kind}"
            for n in _SPOOLS
            for way in ("up", "down")
            for kind in ("time", "limit")
        }
    ):
        lowest = float(tables[name]["value"].min())
        if not lowest > 0.0:
            yield f"{name} holds {lowest:g}; it must be positive everywhere"


MOST = sys.float_info.max
THRUST_AXES = ("throttle", "mach", "h")
_Vector = tuple[_Length, _Length, _Length]


@dataclass(frozen=True)
class Engine:
    """One engine.

    Parameters
    ----------
    position : tuple of float (3,)
        Where the thrust acts, body axes, from the moment reference point. [m]
    direction : tuple of float (3,)
        Unit vector of the thrust, body axes; (1, 0, 0) pushes forward.
    thrust : Dataset, optional
        Static thrust, a term leaf over ``throttle``, ``mach`` and ``h``. [N]
    time_constant : float
        First-order lag of the thrust behind its static value; 0 for none. [s]
    angular_momentum : float
        Of the rotors, along `direction`, right-handed; with a deck on top of what its spools have.
        [kg m2 s-1]
    deck : Deck, optional
        Governor, spools and tables in place of `thrust`; every engine of an aircraft has one or
        none has.
    """

    position: Vector
    direction: Vector = (1.0, 0.0, 0.0)
    thrust: xr.Dataset | None = None
    time_constant: float = 0.0
    angular_momentum: float = 0.0
    deck: EngineDeck | None = None

    def __post_init__(self) -> None:
        if self.thrust is not None and self.deck is not None:
            raise SchemaError("engine", ["thrust and deck are both given; keep one"])


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

    @field_validator("direction")
    @classmethod
    def _unit_vector(cls, direction: Vector) -> Vector:
        length = float(np.linalg.norm(direction))
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
        given = [
            name for name in ("thrust", "thrust_file", "deck") if getattr(self, name) is not None
        ]
        if len(given) > 1:
            raise ValueError(
                f"{' and '.join(given)} are {'both' if len(given) == 2 else 'all'} given; keep one"
            )
        return self


def engine_of(item: EngineTable, number: int, files: DeckFiles, problems: list[str]) -> Engine:
    """Return engine `number` of a file next to `files`; what is wrong with its tables goes to
    `problems`.
    """
    folder = files.folder
    thrust = deck = None
    key = "deck" if item.deck is not None else "thrust"
    try:
        if item.thrust is not None:
            thrust = _thrust_table(item.thrust)
        elif item.thrust_file is not None:
            thrust = _thrust_file(folder / item.thrust_file)
        elif item.deck is not None:
            deck = deck_of(item.deck, files)
    except (SchemaError, UnitError, ValueError, OSError) as error:
        found = (
            error.problems
            if isinstance(error, SchemaError)
            else [_missing(item, folder) or str(error)]
        )
        problems += [f"engine.{number}.{key}: {text}" for text in found]
    return Engine(
        item.position, item.direction, thrust, item.time_constant, item.angular_momentum, deck
    )


def _missing(item: EngineTable, folder: Path) -> str:
    """Return a sentence when the file of the tables is not there: libraries name it in words of
    their own.
    """
    name = item.thrust_file or (item.deck.file if item.deck is not None else None)
    return (
        ""
        if name is None or (folder / name).is_file()
        else f"no file {name!r} in {folder}; give its path from the aircraft file"
    )


def _thrust_table(table: Mapping[str, Any]) -> xr.Dataset:
    unknown = sorted(set(table) - {*THRUST_AXES, "value"})
    if unknown:
        raise ValueError(
            f"unknown key {', '.join(unknown)}; allowed: {', '.join(THRUST_AXES)}, value"
        )
    return leaf_from_toml(table, "N")


def _thrust_file(path: Path) -> xr.Dataset:
    import xarray as xr

    demand_self_contained(path)
    with xr.open_dataset(path, engine="h5netcdf") as dataset:
        leaf = dataset.load()
    problems = check_term(leaf)
    if problems:
        raise SchemaError(path.name, problems)
    return leaf
