"""Engines: static thrust with a first-order lag, or a full deck (`flightmech.submodels.deck`)."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ConfigDict, field_validator, model_validator

from ..configuration import Strict, si
from ..errors import SchemaError, UnitError
from ..library import INPUT, OUTPUT, STATE, VARIABLE, Entry
from ..names import lookup
from ..terms import regressors
from .deck import OWN, Deck, DeckTable, deck_of, leaf_of

if TYPE_CHECKING:
    import xarray as xr

    from ..aircraft import Aircraft

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

    position: _Vector
    direction: tuple[float, float, float] = (1.0, 0.0, 0.0)
    time_constant: si("s") = 0.0  # type: ignore[valid-type]
    angular_momentum: si("kg m2 s-1") = 0.0  # type: ignore[valid-type]
    thrust: dict[str, Any] | None = None
    thrust_file: str | None = None
    deck: DeckTable | None = None

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


# quantity: unit, unit for people, description, least value
_CONSTANTS: dict[str, tuple[str, str, str, float]] = {
    "time_constant": ("s", "s", "first-order lag of the thrust", 0.0),
    "angular_momentum": ("kg m2 s-1", "kg m2 s-1", "angular momentum of the rotors along the thrust", -MOST),
    "lever_delay": ("s", "s", "transport delay of the power lever", 0.0),
    "pla_idle": ("rad", "deg", "lever angle at throttle 0", -MOST),
    "pla_full": ("rad", "deg", "lever angle at throttle 1", -MOST),
    "n1_rundown": ("s", "s", "time constant of n1 towards windmilling", 0.0),
    "n2_rundown": ("s", "s", "time constant of n2 towards windmilling", 0.0),
    "starter_speed": ("1", "%", "speed to which the starter turns the gas generator", 0.0),
    "starter_time": ("s", "s", "time constant of the starter", 0.0),
    "light_speed": ("1", "%", "least speed of the gas generator to light", 0.0),
    "sustain_speed": ("1", "%", "speed of the gas generator below which the flame goes out", 0.0),
    "flame_time": ("s", "s", "time constant of the flame", 0.0),
    "itt_time": ("s", "s", "lag of the inter-turbine temperature", 0.0),
    "n1_rated": ("rad s-1", "rpm", "rotor speed at n1 = 1, right-handed about the thrust", -MOST),
    "n2_rated": ("rad s-1", "rpm", "rotor speed at n2 = 1, right-handed about the thrust", -MOST),
    "n1_inertia": ("kg m2", "kg m2", "moment of inertia of the n1 rotor", 0.0),
    "n2_inertia": ("kg m2", "kg m2", "moment of inertia of the n2 rotor", 0.0),
}
_DRIVES = {
    "thrust_drive": ("thrust", "net thrust that drives when mode.engine is 2"),
    "n1_drive": ("n1", "n1 that drives when mode.engine is 1"),
}
_SWITCHES = ("cutoff", "starter", "ignition", "flameout")


def items(aircraft: Aircraft) -> dict[str, tuple[str, ...]]:
    """Return the items of the groups: engines are numbered from 1, all have spools or none has.

    Raises
    ------
    SchemaError
        Some engines have a deck and some have none.
    """
    numbers = tuple(str(number) for number in range(1, len(aircraft.engines) + 1))
    without = [number for number, engine in zip(numbers, aircraft.engines, strict=True) if engine.deck is None]
    if without and len(without) < len(numbers):
        raise SchemaError(aircraft.name, [f"engine {', '.join(without)} has no deck and others have one; give every engine one or none"])
    return {"engine": numbers, "spool": () if without else numbers}


def row(kind: int, group: str, item: str, name: str, aircraft: Aircraft) -> Entry:
    """Return the catalogue row of a name of an engine."""
    word = name.rsplit(".", 1)[-1]
    engine = aircraft.engines[int(item) - 1]
    if word in _DRIVES:
        like, text = _DRIVES[word]
        return _like(name, like)._replace(description=text)
    if kind == INPUT:
        return _like(name, word, *((0.0, 1.0) if word in _SWITCHES else aircraft.limits.get(word, (0.0, 1.0))))
    if kind in (OUTPUT, STATE, VARIABLE):
        return _like(name, word)
    if word in _CONSTANTS:
        units, display, text, low = _CONSTANTS[word]
        return Entry(name, units, display, text, getattr(engine if hasattr(engine, word) else engine.deck, word), low, MOST, 0)
    return _geometry(name, word, engine)


def _geometry(name: str, word: str, engine: Engine) -> Entry:
    axis = word.removesuffix("_inlet")[-1]
    if word.startswith("direction"):
        return Entry(name, "1", "1", f"direction of the thrust, body {axis}", engine.direction["xyz".index(axis)], -1.0, 1.0, 0)
    at_inlet = word.endswith("_inlet") and engine.deck is not None and engine.deck.inlet is not None
    at = engine.deck.inlet if at_inlet else engine.position  # type: ignore[union-attr]
    what = "ram drag" if word.endswith("_inlet") else "thrust"
    text = f"place of the {what} from the moment reference point, body {axis}"
    return Entry(name, "m", "m", text, at["xyz".index(axis)], -MOST, MOST, 0)  # type: ignore[index]


def terms(aircraft: Aircraft) -> Iterator[tuple[str, str, xr.Dataset]]:
    """Return the tables of thrust and of the decks."""
    for number, engine in enumerate(aircraft.engines, 1):
        tables = {} if engine.thrust is None else {"thrust": engine.thrust}
        for target, leaf in (tables if engine.deck is None else engine.deck.tables).items():
            yield f"engine{number}.{target}", f"engine{number}/{target}", _renamed(leaf, {name: f"engine{number}.{name}" for name in OWN})


def _like(name: str, quantity_: str, low: float = -MOST, high: float = MOST) -> Entry:
    found = lookup(quantity_)
    sign = f", positive {found.sign}" if found.sign else ""
    return Entry(name, found.units, found.display_units, found.long_name + sign, 0.0, low, high, 0)


def _renamed(leaf: xr.Dataset, own: Mapping[str, str]) -> xr.Dataset:
    renamed = leaf.rename({name: new for name, new in own.items() if name in leaf.dims})
    return renamed.assign_attrs(regressors=" ".join(own.get(word, word) for word in regressors(leaf)))


def engine_of(item: EngineTable, number: int, folder: Path, problems: list[str]) -> Engine:
    """Return engine `number` of a file in `folder`; what is wrong with its tables goes to `problems`."""
    thrust = deck = None
    key = "deck" if item.deck is not None else "thrust"
    try:
        if item.thrust is not None:
            thrust = _thrust_table(item.thrust)
        elif item.thrust_file is not None:
            thrust = _thrust_file(folder / item.thrust_file)
        elif item.deck is not None:
            deck = deck_of(item.deck, folder)
    except (SchemaError, UnitError, ValueError, OSError) as error:
        found = error.problems if isinstance(error, SchemaError) else [str(error)]
        problems += [f"engine.{number}.{key}: {text}" for text in found]
    return Engine(item.position, item.direction, thrust, item.time_constant, item.angular_momentum, deck)


def _thrust_table(table: Mapping[str, Any]) -> xr.Dataset:
    unknown = sorted(set(table) - {*THRUST_AXES, "value"})
    if unknown:
        raise ValueError(f"unknown key {', '.join(unknown)}; allowed: {', '.join(THRUST_AXES)}, value")
    return leaf_of(table, "N")


def _thrust_file(path: Path) -> xr.Dataset:
    import xarray as xr

    from ..terms import check

    with xr.open_dataset(path, engine="h5netcdf") as dataset:
        leaf = dataset.load()
    problems = check(leaf)
    if problems:
        raise SchemaError(path.name, problems)
    return leaf
