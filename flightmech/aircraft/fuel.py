"""Fuel on board: what is burnt changes mass, centre of gravity and inertia.

``[fuel]`` in the aircraft file; ``mass``, ``cg`` and the inertias of the aircraft are those with this fuel on board::

    [fuel]
    mass = "380 kg"
    position = [0.0, 0.0, 0.2]

or tanks, emptied in the order in which they are written, those with the same ``order`` together in proportion::

    [fuel]
    mass = "380 kg"
    tank = [
        { position = [0.1, -2.0, 0.1], capacity = "120 kg", order = 1 },
        { position = [0.1, 2.0, 0.1], capacity = "120 kg", order = 1 },
        { position = [-0.2, 0.0, 0.2], capacity = "200 kg", order = 2 },
    ]

or ``file``, a netCDF with a leaf per moment over ``fuel``, on top of ``position``.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import ConfigDict, Field, field_validator, model_validator

from flightmech.aircraft.engine_deck import open_tables
from flightmech.errors import SchemaError
from flightmech.support.toml_models import Strict
from flightmech.support.toml_quantities import InUnits
from flightmech.terms import make_term

if TYPE_CHECKING:
    import xarray as xr

Vector = tuple[float, float, float]
MOST = sys.float_info.max
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
        [kg]
    order : int
        Tanks of the lowest number are emptied first, those of the same number in proportion to
        their capacity.
    """

    position: Vector
    capacity: float
    order: int = 1


@dataclass(frozen=True)
class Fuel:
    """Fuel on board.

    Parameters
    ----------
    mass : float
        On board at the start; part of the aircraft's mass. [kg]
    position : tuple of float (3,)
        Where it lies as a mass point, body axes, from the moment reference point. [m]
    tables : mapping of str to Dataset
        What `position` does not give, as term tables over ``fuel``: first moments `MOMENTS` [kg m]
        and second moments `INERTIAS` [kg m2] about the moment reference point, products as the
        integrals of xy dm and so on.
    """

    mass: float
    position: Vector = (0.0, 0.0, 0.0)
    tables: Mapping[str, xr.Dataset] = field(default_factory=dict)

    def __post_init__(self) -> None:
        problems = [
            f"{name} is no table of the fuel; allowed: {', '.join((*MOMENTS, *INERTIAS))}"
            for name in self.tables
            if name not in (*MOMENTS, *INERTIAS)
        ]
        if problems:
            raise SchemaError("fuel", problems)


def tank_tables(tanks: Sequence[Tank]) -> dict[str, xr.Dataset]:
    """Return the moments of fuel in tanks that are mass points, over the fuel on board.

    Parameters
    ----------
    tanks : sequence of Tank
        Emptied by their `order`.

    Returns
    -------
    dict of str to Dataset
        `MOMENTS` and `INERTIAS`; exact, because the content of each tank is piecewise linear in the
        fuel on board.
    """

    orders = sorted(
        {tank.order for tank in tanks}, reverse=True
    )  # what is emptied last is filled first
    level, content = [0.0], [np.zeros(len(tanks))]
    for order in orders:
        part = np.array([tank.capacity if tank.order == order else 0.0 for tank in tanks])
        level.append(level[-1] + float(part.sum()))
        content.append(content[-1] + part)
    r = np.array([tank.position for tank in tanks])
    x, y, z = r.T
    density = {
        **dict(zip(MOMENTS, (x, y, z), strict=True)),
        **dict(
            zip(INERTIAS, (y**2 + z**2, x**2 + z**2, x**2 + y**2, x * y, x * z, y * z), strict=True)
        ),
    }
    return {
        name: make_term(np.array(content) @ each, {"fuel": level}, outside="linear")
        for name, each in density.items()
    }


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
            raise ValueError(
                f"{'position' if self.position is not None else 'file'} and tank are both "
                f"given; keep one"
            )
        if not (np.isfinite(self.mass) and self.mass >= 0.0):
            raise ValueError("expected zero or a positive mass")
        room = sum(tank.capacity for tank in self.tank)
        if self.tank and self.mass > room * (1.0 + 1e-9):
            raise ValueError(f"{self.mass:g} kg of fuel do not go into tanks of {room:g} kg")
        return self


def fuel_of(item: FuelSection, folder: Path, problems: list[str]) -> Fuel | None:
    """Return the fuel of an aircraft file in `folder`; what is wrong with its tables goes to
    `problems`.
    """
    if item.tank:
        return Fuel(item.mass, tables=tank_tables([Tank(**dict(tank)) for tank in item.tank]))
    try:
        return Fuel(
            item.mass,
            item.position or (0.0, 0.0, 0.0),
            open_tables(folder / item.file) if item.file else {},
        )
    except (SchemaError, OSError) as error:
        problems += [f"fuel: {text}" for text in getattr(error, "problems", [str(error)])]
        return None
