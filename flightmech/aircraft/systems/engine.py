"""Engines: static thrust with a first-order lag, or a full deck (`flightmech.aircraft.systems.engine_deck`)."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ConfigDict, Field, field_validator, model_validator

from ...errors import SchemaError, UnitError
from ...support.configuration import Strict, si
from ...support.input_files.self_contained import demand_self_contained
from .engine_deck import Deck, DeckFiles, DeckTable, deck_of, leaf_of

if TYPE_CHECKING:
    import xarray as xr


Vector = tuple[float, float, float]
MOST = sys.float_info.max
THRUST_AXES = ("throttle", "mach", "h")
_Length = si("m")
_Vector = tuple[_Length, _Length, _Length]  # type: ignore[valid-type]


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
        Of the rotors, along `direction`, right-handed; with a deck on top of what its spools have. [kg m2 s-1]
    deck : Deck, optional
        Governor, spools and tables in place of `thrust`; every engine of an aircraft has one or none has.
    """

    position: Vector
    direction: Vector = (1.0, 0.0, 0.0)
    thrust: xr.Dataset | None = None
    time_constant: float = 0.0
    angular_momentum: float = 0.0
    deck: Deck | None = None

    def __post_init__(self) -> None:
        if self.thrust is not None and self.deck is not None:
            raise SchemaError("engine", ["thrust and deck are both given; keep one"])


class EngineTable(Strict):
    """An ``[[engine]]`` of the aircraft file."""

    model_config = ConfigDict(protected_namespaces=())

    position: _Vector = Field(description="Where the thrust acts, body axes, from the moment reference point.")
    direction: tuple[float, float, float] = Field(
        default=(1.0, 0.0, 0.0), description="Direction of the thrust, body axes; [1, 0, 0] pushes forward."
    )
    time_constant: si("s") = Field(  # type: ignore[valid-type]
        default=0.0, examples=["1.2 s"], description="First-order lag of the thrust behind its static value; 0 for none."
    )
    angular_momentum: si("kg m2 s-1") = Field(  # type: ignore[valid-type]
        default=0.0,
        examples=[12.0],
        description="Of the rotors, along the direction, right-handed; with a deck on top of what its spools have.",
    )
    thrust: dict[str, Any] | None = Field(
        default=None,
        json_schema_extra={"propertyNames": {"enum": [*THRUST_AXES, "value"]}},
        examples=[{"throttle": [0.0, 1.0], "value": [300.0, 4500.0]}],
        description="Static thrust [N] as a table over throttle, mach and h; value is ordered as the axes are written.",
    )
    thrust_file: str | None = Field(
        default=None, examples=["thrust.nc"], description="netCDF file with the table of the static thrust, relative to this file."
    )
    deck: DeckTable | None = Field(default=None, description="Governor, spools and tables in place of a table of thrust.")

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
        given = [name for name in ("thrust", "thrust_file", "deck") if getattr(self, name) is not None]
        if len(given) > 1:
            raise ValueError(f"{' and '.join(given)} are {'both' if len(given) == 2 else 'all'} given; keep one")
        return self


def engine_of(item: EngineTable, number: int, files: DeckFiles, problems: list[str]) -> Engine:
    """Return engine `number` of a file next to `files`; what is wrong with its tables goes to `problems`."""
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
        found = error.problems if isinstance(error, SchemaError) else [_missing(item, folder) or str(error)]
        problems += [f"engine.{number}.{key}: {text}" for text in found]
    return Engine(item.position, item.direction, thrust, item.time_constant, item.angular_momentum, deck)


def _missing(item: EngineTable, folder: Path) -> str:
    """Return a sentence when the file of the tables is not there: libraries name it in words of their own."""
    name = item.thrust_file or (item.deck.file if item.deck is not None else None)
    return "" if name is None or (folder / name).is_file() else f"no file {name!r} in {folder}; give its path from the aircraft file"


def _thrust_table(table: Mapping[str, Any]) -> xr.Dataset:
    unknown = sorted(set(table) - {*THRUST_AXES, "value"})
    if unknown:
        raise ValueError(f"unknown key {', '.join(unknown)}; allowed: {', '.join(THRUST_AXES)}, value")
    return leaf_of(table, "N")


def _thrust_file(path: Path) -> xr.Dataset:
    import xarray as xr

    from ...terms import check

    demand_self_contained(path)
    with xr.open_dataset(path, engine="h5netcdf") as dataset:
        leaf = dataset.load()
    problems = check(leaf)
    if problems:
        raise SchemaError(path.name, problems)
    return leaf
