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
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import ConfigDict, Field, field_validator, model_validator

from flightmech.aircraft.propulsion.engine_deck import open_tables
from flightmech.errors import SchemaError
from flightmech.short_text import ShortText
from flightmech.support.toml_models import Strict
from flightmech.support.toml_quantities import InUnits
from flightmech.terms import make_term

if TYPE_CHECKING:
    import xarray as xr

Vector = tuple[float, float, float]
MOST = sys.float_info.max
# first and second moments about the moment reference point
MOMENTS = ("moment_x", "moment_y", "moment_z")
INERTIAS = ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")


@dataclass(frozen=True)
class Tank:
    """A tank as a mass point.

    Parameters
    ----------
    position : tuple of float (3,)
        Body axes, from the moment reference point. [m]
    capacity : float
        Greatest mass of fuel. [kg]
    order : int
        Tanks with the lowest number are emptied first. Tanks with the same number are emptied in
        proportion to their capacity.
    """

    position: Vector
    capacity: float
    order: int = 1


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
    """

    mass: float
    position: Vector = (0.0, 0.0, 0.0)
    tables: Mapping[str, xr.Dataset] = field(default_factory=dict)

    def __post_init__(self) -> None:
        allowed = (*MOMENTS, *INERTIAS)
        problems = []
        for name in self.tables:
            if name not in allowed:
                problems.append(f"{name} is not a table of the fuel; allowed: {', '.join(allowed)}")
        if problems:
            raise SchemaError("fuel", problems)


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
    capacities = np.array([tank.capacity for tank in tanks])
    orders = np.array([tank.order for tank in tanks])
    # Breakpoints from empty to full: the tanks that are emptied last are the first to be filled.
    fuel, contents = [0.0], [np.zeros(len(tanks))]
    for order in sorted(set(orders.tolist()), reverse=True):
        filled = np.where(orders == order, capacities, 0.0)
        fuel.append(fuel[-1] + float(filled.sum()))
        contents.append(contents[-1] + filled)
    # moments per mass in each tank
    x, y, z = np.array([tank.position for tank in tanks]).T
    moments = dict(zip(MOMENTS, (x, y, z), strict=True))
    squares = (y**2 + z**2, x**2 + z**2, x**2 + y**2)
    products = (x * y, x * z, y * z)
    moments |= dict(zip(INERTIAS, (*squares, *products), strict=True))
    tables = {}
    for name, per_mass in moments.items():
        tables[name] = make_term(np.array(contents) @ per_mass, {"fuel": fuel}, outside="linear")
    return tables


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
        default_factory=list, description="Tanks in place of one position."
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
        if not (np.isfinite(self.mass) and self.mass >= 0.0):
            raise ValueError("expected zero or a positive mass")
        capacity = sum(tank.capacity for tank in self.tank)
        # the factor allows for the rounding of units
        if self.tank and self.mass > capacity * (1.0 + 1e-9):
            raise ValueError(f"{self.mass:g} kg of fuel do not go into tanks of {capacity:g} kg")
        return self


def fuel_of(item: FuelSection, folder: Path, problems: list[str]) -> Fuel | None:
    """Return the fuel of an aircraft file in `folder`, None if its tables have problems.

    The problems are appended to `problems`.
    """
    if item.tank:
        return Fuel(item.mass, tables=tank_tables([Tank(**dict(tank)) for tank in item.tank]))
    try:
        tables = open_tables(folder / item.file) if item.file else {}
        return Fuel(item.mass, item.position or (0.0, 0.0, 0.0), tables=tables)
    except (SchemaError, OSError) as error:
        problems += [f"fuel: {text}" for text in getattr(error, "problems", [str(error)])]
        return None
