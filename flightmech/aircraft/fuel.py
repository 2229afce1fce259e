"""Fuel on board, and the section ``[fuel]`` of the aircraft file.

Burnt fuel changes mass, centre of gravity and inertia. The values ``mass``, ``cg`` and the inertias
of the aircraft include the fuel on board at the start::

    [fuel]
    mass = "380 kg"
    position = [0.0, 0.0, 0.2]

or tanks, emptied by their ``order``, in proportion to their capacity if the order is the same::

    [fuel]
    mass = "380 kg"
    tank = [
        { position = [0.1, -2.0, 0.1], capacity = "120 kg", order = 1 },
        { position = [0.1, 2.0, 0.1], capacity = "120 kg", order = 1 },
        { position = [-0.2, 0.0, 0.2], capacity = "200 kg", order = 2 },
    ]

or ``file``, a netCDF file with a leaf over ``fuel`` for each moment, added to ``position``.

If the engines state the tanks that feed them, the content of each tank is a state::

    [fuel]
    mass = "380 kg"
    tank = [
        { name = "left", position = [0.1, -2.0, 0.1], capacity = "200 kg", content = "180 kg" },
        { name = "right", position = [0.1, 2.0, 0.1], capacity = "200 kg", content = "200 kg" },
    ]

    [[engine]]
    feed = ["left"]
    crossfeed = ["right"]

Pumps move fuel from tank to tank (`flightmech.aircraft.propulsion.fuel_transfer`).
"""

from __future__ import annotations

import re
import sys
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import ConfigDict, Field, field_validator, model_validator

from flightmech.aircraft.propulsion.engine_deck import open_tables
from flightmech.aircraft.propulsion.fuel_transfer import (
    Transfer,
    TransferTable,
    tanks_reached,
    transfer_problems,
    transfers_of,
)
from flightmech.aircraft.propulsion.tank import Tank
from flightmech.errors import AeromatchWarning, SchemaError
from flightmech.short_text import ShortText
from flightmech.support.toml_models import Strict
from flightmech.support.toml_quantities import InUnits
from flightmech.terms import make_term

if TYPE_CHECKING:
    import xarray as xr

    from flightmech.aircraft.engine import Engine

Vector = tuple[float, float, float]
MOST = sys.float_info.max
# first and second moments about the moment reference point
MOMENTS = ("moment_x", "moment_y", "moment_z")
INERTIAS = ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
# Tanks, and feeds from a tank to an engine, that a model holds.
_MOST_ITEMS = 16
# Difference of the contents from the mass of the fuel that rounding of units makes, of the mass.
_ROUNDING = 1e-6
_NAME = r"^[a-z_][a-z0-9_]*$"


@dataclass(frozen=True)
class Fuel(ShortText):
    """Fuel on board.

    Parameters
    ----------
    mass : float
        Fuel on board at the start, part of the mass of the aircraft. [kg]
    position : tuple of float (3,)
        Position of the fuel as a mass point, body axes, from the moment reference point. [m]
    tables : mapping of str to Dataset
        Moments in addition to the mass at `position`, as term leaves over ``fuel``: first moments
        `MOMENTS` [kg m] and second moments `INERTIAS` [kg m2] about the moment reference point. The
        products are the integrals of xy dm and so on.
    tanks : tuple of Tank
        Tanks with a state each, in place of `position` and `tables`. Every engine states which of
        them feed it. The sum of their contents is `mass`.
    transfers : tuple of Transfer
        Pumps from tank to tank.
    """

    mass: float
    position: Vector = (0.0, 0.0, 0.0)
    tables: Mapping[str, xr.Dataset] = field(default_factory=dict)
    tanks: tuple[Tank, ...] = ()
    transfers: tuple[Transfer, ...] = ()

    def __post_init__(self) -> None:
        allowed = (*MOMENTS, *INERTIAS)
        problems = []
        for name in self.tables:
            if name not in allowed:
                problems.append(f"{name} is not a table of the fuel; allowed: {', '.join(allowed)}")
        if self.tanks:
            problems += _check_tanks(self)
        problems += transfer_problems(self.transfers, self.tanks)
        if problems:
            raise SchemaError("fuel", problems)


def _check_tanks(fuel: Fuel) -> Iterator[str]:
    """Yield the problems of tanks with a state each."""
    if fuel.tables or any(fuel.position):
        yield "tanks are mass points; give no tables and no position with them"
    if len(fuel.tanks) > _MOST_ITEMS:
        yield f"{len(fuel.tanks)} tanks; a model holds {_MOST_ITEMS}, combine some"
    for number, tank in enumerate(fuel.tanks, 1):
        if not re.fullmatch(_NAME, tank.name):
            yield (
                f"tank {number} has the name {tank.name!r}; give small letters, digits and _, e.g. "
                f"left, by which engines state what feeds them"
            )
        if not tank.content >= 0.0:
            yield f"tank {tank.name} holds {tank.content:g} kg; give zero or a positive mass"
        # the factor allows for the rounding of units
        if tank.content > tank.capacity * (1.0 + 1e-9):
            yield (
                f"{tank.content:g} kg of fuel do not go into tank {tank.name} of "
                f"{tank.capacity:g} kg"
            )
    for name, count in Counter(tank.name for tank in fuel.tanks).items():
        if count > 1:
            yield f"{count} tanks have the name {name}; give each its own"
    held = sum(tank.content for tank in fuel.tanks)
    if abs(held - fuel.mass) > _ROUNDING * max(fuel.mass, held):
        yield f"the tanks hold {held:g} kg, mass is {fuel.mass:g} kg; give equal numbers"


def check_feeds(engines: Sequence[Engine], fuel: Fuel | None) -> list[str]:
    """Return the problems of the feeds of engines with the tanks of the aircraft."""
    tanks = () if fuel is None else fuel.tanks
    fed = any(engine.feed or engine.crossfeed for engine in engines)
    if not fed and not tanks:
        return []
    names = [tank.name for tank in tanks]
    if not names:
        return ["the engines have a feed, but there are no tanks; add tank to [fuel], or delete it"]
    problems = []
    reached: set[str] = set()
    for number, engine in enumerate(engines, 1):
        problems += [f"engine.{number}.feed: {text}" for text in _check_feed(engine, names)]
        reached |= {*engine.feed, *engine.crossfeed}
    assert fuel is not None, "names of tanks come from the fuel"
    reached = tanks_reached(fuel.transfers, reached)
    for name in names:
        if name not in reached:
            problems.append(
                f"fuel: tank {name} feeds no engine; name it in a feed or crossfeed, or as the "
                f"source of a transfer"
            )
    feeds = sum(len(engine.feed) + len(engine.crossfeed) for engine in engines)
    if feeds > _MOST_ITEMS:
        problems.append(f"{feeds} feeds from tanks to engines; a model holds {_MOST_ITEMS}")
    return problems


def _check_feed(engine: Engine, names: Sequence[str]) -> Iterator[str]:
    """Yield the problems of the feed of one engine from tanks of these names."""
    sources = [*engine.feed, *engine.crossfeed]
    if engine.motor is not None:
        if sources:
            yield "a motor draws no fuel; delete feed and crossfeed"
        return
    if not engine.feed:
        yield f"no tank feeds the engine; give one or more of {', '.join(names)}"
    for name, count in Counter(sources).items():
        if name not in names:
            yield f"{name} is not a tank; allowed: {', '.join(names)}"
        if count > 1:
            yield f"{name} is there {count} times in feed and crossfeed; keep one"


def warn_of_full_tanks(engines: Sequence[Engine], file: str) -> None:
    """Warn of engines that tanks feed and that burn no fuel, so that the tanks are never empty.

    Parameters
    ----------
    engines : sequence of Engine
    file : str
        Name of the aircraft file.
    """
    idle = []
    for number, engine in enumerate(engines, 1):
        tables = () if engine.deck is None else tuple(engine.deck.tables)
        # a piston engine has its consumption by its power
        burns = engine.piston is not None or any(name.endswith("fuel_flow") for name in tables)
        if engine.feed and not burns:
            idle.append(str(number))
    if idle:
        warnings.warn(
            f"{file}: tanks feed engine {', '.join(idle)}, which burns no fuel, so that they stay "
            f"as full as they are; give a table fuel_flow or corrected_fuel_flow",
            AeromatchWarning,
            stacklevel=3,
        )


def tank_tables(tanks: Sequence[Tank]) -> dict[str, xr.Dataset]:
    """Return the moments of the fuel in tanks over the fuel on board.

    Parameters
    ----------
    tanks : sequence of Tank
        Mass points, emptied by their `order`.

    Returns
    -------
    dict of str to Dataset
        `MOMENTS` and `INERTIAS`. They are exact, because the content of each tank is piecewise
        linear in the fuel on board.
    """
    fuel, contents = _fill(tanks)
    # moments per mass in each tank
    x, y, z = np.array([tank.position for tank in tanks]).T
    moments = dict(zip(MOMENTS, (x, y, z), strict=True))
    squares = (y**2 + z**2, x**2 + z**2, x**2 + y**2)
    products = (x * y, x * z, y * z)
    moments |= dict(zip(INERTIAS, (*squares, *products), strict=True))
    tables = {}
    for name, per_mass in moments.items():
        tables[name] = make_term(contents @ per_mass, {"fuel": fuel}, outside="linear")
    return tables


def _fill(tanks: Sequence[Tank]) -> tuple[list[float], np.ndarray]:
    """Return breakpoints of the fuel from empty to full, and contents (breakpoint, tank). [kg]"""
    capacities = np.array([tank.capacity for tank in tanks])
    orders = np.array([tank.order for tank in tanks])
    # the tanks that are emptied last are the first to be filled
    fuel, contents = [0.0], [np.zeros(len(tanks))]
    for order in sorted(set(orders.tolist()), reverse=True):
        filled = np.where(orders == order, capacities, 0.0)
        fuel.append(fuel[-1] + float(filled.sum()))
        contents.append(contents[-1] + filled)
    return fuel, np.array(contents)


_Length = Annotated[float, InUnits("m")]


class TankTable(Strict):
    """A tank of ``[fuel]``."""

    model_config = ConfigDict(protected_namespaces=())

    position: tuple[_Length, _Length, _Length] = Field(
        examples=[[0.1, -2.0, 0.1]],
        description="Of the tank as a mass point, body axes, from the moment reference point.",
    )
    capacity: Annotated[float, InUnits("kg")] = Field(
        examples=["120 kg"], description="Fuel that the tank holds."
    )
    order: int = Field(
        default=1,
        examples=[1],
        description="Tanks of the lowest number are emptied first, those of the same number in "
        "proportion to their capacity.",
    )
    name: str = Field(
        default="",
        examples=["left"],
        description="Name by which engines state what feeds them.",
        json_schema_extra={"pattern": _NAME},
    )
    content: Annotated[float, InUnits("kg")] | None = Field(
        default=None,
        examples=["100 kg"],
        description="Fuel in it at the start, where engines state what feeds them; without it the "
        "mass of the fuel fills the tanks against their order.",
    )

    @field_validator("capacity")
    @classmethod
    def _positive(cls, value: float) -> float:
        if not (np.isfinite(value) and value > 0.0):
            raise ValueError("expected a positive mass")
        return value


class FuelSection(Strict):
    """``[fuel]`` of the aircraft file."""

    model_config = ConfigDict(protected_namespaces=())

    mass: Annotated[float, InUnits("kg")] = Field(
        description="Fuel on board at the start, part of the aircraft's mass."
    )
    position: tuple[_Length, _Length, _Length] | None = Field(
        None,
        description="Where it lies as a mass point, body axes, from the moment reference point.",
    )
    tank: list[TankTable] = Field(
        default_factory=list,
        description="Tanks in place of one position; with a state each if the engines have a feed.",
    )
    transfer: list[TransferTable] = Field(
        default_factory=list,
        description="Pumps from tank to tank, where the engines have a feed.",
    )
    file: str | None = Field(
        default=None,
        examples=["fuel.nc"],
        description="netCDF file with moments over the fuel on board, on top of position; "
        "relative to this file.",
    )

    @model_validator(mode="after")
    def _plausible(self) -> FuelSection:
        if self.tank and (self.position is not None or self.file is not None):
            key = "file" if self.position is None else "position"
            raise ValueError(f"{key} and tank are both given; keep one")
        if self.transfer and not self.tank:
            raise ValueError("transfer needs tanks; add tank, or delete it")
        if not (np.isfinite(self.mass) and self.mass >= 0.0):
            raise ValueError("expected zero or a positive mass")
        capacity = sum(tank.capacity for tank in self.tank)
        # the factor allows for the rounding of units
        if self.tank and self.mass > capacity * (1.0 + 1e-9):
            raise ValueError(f"{self.mass:g} kg of fuel do not go into tanks of {capacity:g} kg")
        return self


def fuel_of(item: FuelSection, folder: Path, problems: list[str], fed: bool = False) -> Fuel | None:
    """Return the fuel of an aircraft file in `folder`, None if it has problems.

    The problems are appended to `problems`. `fed` states whether the engines name the tanks that
    feed them.
    """
    try:
        if item.tank:
            return _tanks_of(item, fed)
        tables = open_tables(folder / item.file) if item.file else {}
        return Fuel(item.mass, item.position or (0.0, 0.0, 0.0), tables=tables)
    except (SchemaError, OSError) as error:
        problems += [f"fuel: {text}" for text in getattr(error, "problems", [str(error)])]
        return None


def _tanks_of(item: FuelSection, fed: bool) -> Fuel:
    """Return the fuel in tanks: with a state each for engines with a feed, else as tables.

    Raises
    ------
    SchemaError
        Contents that are not those of all tanks, or without a feed; a tank of a wrong name.
    """
    given = [tank.content is not None for tank in item.tank]
    if any(given) and not fed:
        raise SchemaError(
            "fuel",
            [
                "tank.content needs engines that state what feeds them; add feed to each "
                "[[engine]], or delete content: mass fills the tanks against their order"
            ],
        )
    if any(given) and not all(given):
        raise SchemaError("fuel", ["tank.content is given of some tanks; give it of all or none"])
    tanks = [Tank(**{**dict(tank), "content": tank.content or 0.0}) for tank in item.tank]
    if not fed:
        if item.transfer:
            raise SchemaError(
                "fuel",
                ["transfer needs engines that state what feeds them; add feed to [[engine]]"],
            )
        return Fuel(item.mass, tables=tank_tables(tanks))
    if not all(given):
        fuel, contents = _fill(tanks)
        for number, tank in enumerate(tanks):
            held = float(np.interp(item.mass, fuel, contents[:, number]))
            tanks[number] = replace(tank, content=held)
    return Fuel(item.mass, tanks=tuple(tanks), transfers=transfers_of(item.transfer, tanks))
