"""Full engine deck: governor schedule, spools, flame, and tables of thrust, air and fuel flow.

The deck is the section ``[engine.deck]`` of the aircraft file.
docs/explanation/simulation/engine.md has the equations of the kernel::

    [engine.deck]
    file = "engine.nc"                 # one group per target, or tables here
    lever_delay = "0.1 s"

    [engine.deck.tables]
    n2_command = { throttle = [0.0, 1.0], value = [0.6, 1.0] }
    n2_up_time = "0.4 s"               # a number is a table without axes
    windmill_thrust = { value = -0.03, regressors = ["qbar"] }

    [engine.deck.tables.corrected_thrust]
    corrected_n1 = [0.3, 1.1]
    mach = [0.0, 0.5]
    value = [["300 N", "150 N"], ["9000 N", "7000 N"]]
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import xarray as xr
from pydantic import ConfigDict, Field

from flightmech.errors import AeromatchError, SchemaError, UnknownName
from flightmech.names import lookup
from flightmech.quantities import parse_quantity
from flightmech.short_text import ShortText
from flightmech.support.array_files.netcdf_trees import read_netcdf_tree
from flightmech.support.array_files.netcdf_writing import write_netcdf
from flightmech.support.hdf5_seal import decoding_errors, demand_self_contained
from flightmech.support.toml_models import Strict
from flightmech.support.toml_quantities import InUnits
from flightmech.terms import check_term, make_term

Vector = tuple[float, float, float]
_SPOOLS = ("n1", "n2")


def _spool_targets() -> dict[str, str]:
    """Return the targets that exist for each spool, with their units."""
    targets = {f"{spool}_command": "1" for spool in _SPOOLS}
    targets |= {f"corrected_{spool}_command": "1" for spool in _SPOOLS}
    for spool in _SPOOLS:
        targets |= {f"{spool}_up_time": "s", f"{spool}_down_time": "s"}
    for spool in _SPOOLS:
        targets |= {f"{spool}_up_limit": "s-1", f"{spool}_down_limit": "s-1"}
    return targets | {f"corrected_{spool}_windmill": "1" for spool in _SPOOLS}


# Units of the tables of a deck. A `corrected_` target is multiplied by the factors of temperature
# and pressure. The others, such as `thrust`, are used without a correction.
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
    **_spool_targets(),
    "corrected_n2_driven": "1",
    "burn_margin": "1",
    "light_margin": "1",
}
# variables of one engine, without its number
OWN = (
    "throttle",
    "pla",
    *_SPOOLS,
    "corrected_n1",
    "corrected_n2",
    "temperature_ratio",
    "pressure_ratio",
)


@dataclass(frozen=True)
class EngineDeck(ShortText):
    """Tables and constants of a full engine deck.

    Speeds are fractions of the rated speeds. The defaults are typical of a small turbofan, and do
    not describe a particular engine.

    Parameters
    ----------
    tables : mapping of str to Dataset
        A term leaf for each target, a key of `TARGETS`. Variables of the engine itself (`OWN`)
        have no number.
    lever_delay : float
        Transport delay of the power lever. [s]
    pla_idle, pla_full : float
        Lever angle at throttle 0 and 1. [rad]
    n1_rundown, n2_rundown : float
        Time constants towards the windmilling speed while the engine does not burn. [s]
    starter_speed, starter_time : float
        Speed of the gas generator on the starter, and its time constant. [1], [s]
    light_speed, sustain_speed : float
        Lowest speed of the gas generator for ignition, and for a stable flame. [1]
    flame_time : float
        Time constant of the flame. [s]
    itt_time : float
        Lag of the turbine temperature, 0 without a lag. [s]
    n1_rated, n2_rated : float
        Rotor speeds at the fraction 1, positive right-handed about the thrust. [rad s-1]
    n1_inertia, n2_inertia : float
        Moments of inertia of the rotors. [kg m2]
    coupled : bool
        Whether the gas generator turns with the propeller, at ``engine_rpm`` over `n1_rated`. Its
        command is not used then.
    inlet : tuple of float (3,), optional
        Point at which the ram drag acts, body axes, from the moment reference point. The default
        is the position of the engine. [m]
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
    coupled: bool = False
    inlet: Vector | None = None

    def __post_init__(self) -> None:
        problems = list(_check_tables(self.tables, self.coupled))
        if self.coupled and not self.n1_rated:
            problems.append("coupled needs n1_rated, the speed of the gas generator at n1 = 1")
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
        description="Least speed of the gas generator at which it goes on burning; 0.05 without "
        "it.",
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
    coupled: bool | None = Field(
        default=None,
        examples=[True],
        description="Whether the gas generator turns with the propeller, geared; a turbine of its "
        "own turns the propeller without it.",
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
    """Files of tables in a folder. Each file is read once for all engines.

    Attributes
    ----------
    folder : Path
        Folder of the aircraft file.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._read: dict[str, dict[str, xr.Dataset]] = {}

    def of(self, name: str) -> dict[str, xr.Dataset]:
        """Return copies of the leaves of a file, as `open_tables`."""
        if name not in self._read:
            self._read[name] = open_tables(self.folder / name)
        return {target: leaf.copy() for target, leaf in self._read[name].items()}


def deck_of(item: DeckTable, files: DeckFiles) -> EngineDeck:
    """Return the deck of an aircraft file.

    Parameters
    ----------
    item : DeckTable
    files : DeckFiles
        Files in the folder of the aircraft file.

    Raises
    ------
    SchemaError
        With all problems of the tables.
    """
    tables: dict[str, xr.Dataset] = {}
    problems: list[str] = []
    if item.file is not None:
        tables |= files.of(item.file)
    for target, content in item.tables.items():
        if target not in TARGETS:
            # _check_tables reports the name
            tables[target] = make_term(0.0)
            continue
        try:
            tables[target] = leaf_from_toml(content, TARGETS[target])
        except (AeromatchError, ValueError) as error:
            problems += [f"{target}: {text}" for text in getattr(error, "problems", [str(error)])]
            # a valid value, so that _check_tables reports only other problems
            tables[target] = make_term(1.0)
    problems += _check_tables(tables, bool(item.coupled))
    if problems:
        raise SchemaError("engine deck", problems)
    constants = {}
    for name in (*CONSTANTS, "inlet"):
        value = getattr(item, name)
        # None leaves the default of EngineDeck
        if value is not None:
            constants[name] = value
    return EngineDeck(tables, **constants)


def leaf_from_toml(item: Any, units: str) -> xr.Dataset:
    """Return a leaf from its form in a TOML file.

    Parameters
    ----------
    item : number, str or mapping
        A number, or a table with axes, ``value`` and optionally ``regressors`` and ``outside``.
        Bare numbers are SI, texts have their unit. The dimensions of ``value`` have the order in
        which the axes are written.
    units : str
        SI unit of the value. With regressors the value is a bare number, in this unit over the
        units of the regressors.
    """
    if not isinstance(item, Mapping):
        return make_term(parse_quantity(item, units))
    if "value" not in item:
        raise ValueError(f"missing value, in {units} over the axes in the order they are written")
    regressors = [str(name) for name in item.get("regressors", ())]
    axes = {}
    for name, points in item.items():
        if name not in ("value", "regressors", "outside"):
            axes[name] = _parse_points(points, lookup(name).units)
    if regressors:
        units = "1"
    # an object array keeps texts and numbers of nested lists as they are
    entries = np.array(item["value"], object)
    value = np.vectorize(lambda entry: parse_quantity(entry, units), otypes=[float])(entries)
    shape = tuple(len(points) for points in axes.values())
    if value.shape != shape:
        raise ValueError(
            f"value has the shape {value.shape}, the axes {' '.join(axes)} have {shape}"
        )
    return make_term(value, axes, regressors, outside=str(item.get("outside", "hold")))


def _parse_points(points: Any, units: str) -> list[float]:
    return [parse_quantity(point, units) for point in points]


def open_tables(path: Path) -> dict[str, xr.Dataset]:
    """Return the leaves of a netCDF file by target, the name of the group.

    Raises
    ------
    SchemaError
        With all faults of the leaves.
    OSError
        The file does not exist, or is not a netCDF file.
    """
    demand_self_contained(path)
    with decoding_errors(path, "tables of an engine, netCDF-4"):
        tree, problems = read_netcdf_tree(path)
    leaves = {str(name): node.to_dataset() for name, node in tree.children.items()}
    for name, leaf in leaves.items():
        problems += [f"{name}: {text}" for text in check_term(leaf)]
    if problems:
        raise SchemaError(path.name, problems)
    return leaves


def write_tables(tables: Mapping[str, xr.Dataset], path: Path, **attributes: str) -> None:
    """Write the leaves of a deck to a netCDF file, one group per target."""
    tree = xr.DataTree.from_dict({f"/{name}": leaf for name, leaf in tables.items()})
    tree.attrs.update(attributes)
    write_netcdf(tree, path)


def _check_tables(tables: Mapping[str, xr.Dataset], coupled: bool) -> Iterator[str]:
    """Yield the problems of the tables of a deck."""
    for target in sorted(set(tables) - set(TARGETS)):
        yield str(UnknownName(target, TARGETS, "table of an engine deck"))
    if not {"thrust", "corrected_thrust"} & set(tables):
        yield "no table of the thrust; give corrected_thrust or thrust"
    spools = [n for n in _SPOOLS if {f"{n}_command", f"corrected_{n}_command"} & set(tables)]
    if not spools and not coupled:
        yield (
            "no table of a commanded speed; give n1_command or n2_command over the lever, or their "
            "corrected_ forms"
        )
    for spool in spools:
        if f"{spool}_up_time" not in tables:
            yield (
                f"{spool} has a command and no {spool}_up_time, the time constant with which it "
                f"follows"
            )
    for name in sorted(tables):
        if name in TARGETS and name.endswith(("_time", "_limit")):
            # "not >" is also true for NaN
            lowest = float(tables[name]["value"].values.min())
            if not lowest > 0.0:
                yield f"{name} holds {lowest:g}; it must be positive everywhere"
