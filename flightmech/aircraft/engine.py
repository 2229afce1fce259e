"""Engines of an aircraft, and the section ``[[engine]]`` of the aircraft file.

An engine has a table of the static thrust with a lag, or a full deck (`engine_deck`).
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import xarray as xr
from pydantic import ConfigDict, Field, field_validator, model_validator

from flightmech.aircraft.engine_deck import (
    DeckFiles,
    DeckTable,
    EngineDeck,
    Vector,
    _Length,
    deck_of,
    leaf_from_toml,
)
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
    folder = files.folder
    thrust = deck = None
    # name of the source in the file, for the problems
    key = "deck" if item.deck is not None else "thrust"
    try:
        if item.thrust is not None:
            thrust = _thrust_table(item.thrust)
        elif item.thrust_file is not None:
            thrust = _thrust_file(folder / item.thrust_file)
        elif item.deck is not None:
            deck = deck_of(item.deck, files)
    except (SchemaError, UnitError, ValueError, OSError) as error:
        # the engine is made without the table, so that the problems of other parts are found too
        if isinstance(error, SchemaError):
            texts = error.problems
        else:
            texts = [_describe_missing_file(item, folder) or str(error)]
        problems += [f"engine.{number}.{key}: {text}" for text in texts]
    return Engine(
        position=item.position,
        direction=item.direction,
        thrust=thrust,
        time_constant=item.time_constant,
        angular_momentum=item.angular_momentum,
        deck=deck,
    )


def _describe_missing_file(item: EngineTable, folder: Path) -> str:
    """Return a sentence if the file of the tables does not exist, else an empty text.

    The messages of the libraries that open the file differ from each other.
    """
    name = item.thrust_file
    if not name and item.deck is not None:
        name = item.deck.file
    if name is None or (folder / name).is_file():
        return ""
    return f"no file {name!r} in {folder}; give its path from the aircraft file"


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
