"""Engines: static thrust with a first-order lag."""

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
from ..units import quantity

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
        Of the rotors, along `direction`, right-handed. [kg m2 s-1]
    """

    position: Vector
    direction: Vector = (1.0, 0.0, 0.0)
    thrust: xr.Dataset | None = None
    time_constant: float = 0.0
    angular_momentum: float = 0.0


class EngineTable(Strict):
    """An ``[[engine]]`` of the aircraft file."""

    model_config = ConfigDict(protected_namespaces=())

    position: _Vector
    direction: tuple[float, float, float] = (1.0, 0.0, 0.0)
    time_constant: si("s") = 0.0  # type: ignore[valid-type]
    angular_momentum: si("kg m2 s-1") = 0.0  # type: ignore[valid-type]
    thrust: dict[str, Any] | None = None
    thrust_file: str | None = None

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
        if self.thrust is not None and self.thrust_file is not None:
            raise ValueError("thrust and thrust_file are both given; keep one")
        return self


def items(aircraft: Aircraft) -> dict[str, tuple[str, ...]]:
    """Return the items of the groups: engines are numbered from 1."""
    return {"engine": tuple(str(number) for number in range(1, len(aircraft.engines) + 1)), "spool": ()}


def row(kind: int, group: str, item: str, name: str, aircraft: Aircraft) -> Entry:
    """Return the catalogue row of a name of an engine."""
    quantity_ = name.rsplit(".", 1)[-1]
    engine = aircraft.engines[int(item) - 1]
    if kind == INPUT and quantity_ == "throttle":
        return _like(name, "throttle", *aircraft.limits.get("throttle", (0.0, 1.0)))
    if kind == INPUT:
        return _like(name, "thrust")._replace(description="net thrust that drives when mode.engine is 2")
    if kind in (OUTPUT, STATE, VARIABLE):
        return _like(name, quantity_)
    place = dict(zip("xyz", engine.position, strict=True))
    if quantity_ in place:
        text = f"place of the thrust from the moment reference point, body {quantity_}"
        return Entry(name, "m", "m", text, place[quantity_], -MOST, MOST, 0)
    direction = dict(zip(("direction_x", "direction_y", "direction_z"), engine.direction, strict=True))
    if quantity_ in direction:
        return Entry(name, "1", "1", f"direction of the thrust, body {quantity_[-1]}", direction[quantity_], -1.0, 1.0, 0)
    if quantity_ == "time_constant":
        return Entry(name, "s", "s", "first-order lag of the thrust", engine.time_constant, 0.0, MOST, 0)
    return Entry(name, "kg m2 s-1", "kg m2 s-1", "angular momentum of the rotors along the thrust", engine.angular_momentum, -MOST, MOST, 0)


def terms(aircraft: Aircraft) -> Iterator[tuple[str, str, xr.Dataset]]:
    """Return the thrust tables."""
    for number, engine in enumerate(aircraft.engines, 1):
        if engine.thrust is not None:
            yield f"engine{number}.thrust", f"engine{number}/thrust", _renamed(engine.thrust, {"throttle": f"engine{number}.throttle"})


def _like(name: str, quantity_: str, low: float = -MOST, high: float = MOST) -> Entry:
    found = lookup(quantity_)
    sign = f", positive {found.sign}" if found.sign else ""
    return Entry(name, found.units, found.display_units, found.long_name + sign, 0.0, low, high, 0)


def _renamed(leaf: xr.Dataset, own: Mapping[str, str]) -> xr.Dataset:
    renamed = leaf.rename({name: new for name, new in own.items() if name in leaf.dims})
    return renamed.assign_attrs(regressors=" ".join(own.get(word, word) for word in regressors(leaf)))


def engine_of(item: EngineTable, number: int, folder: Path, problems: list[str]) -> Engine:
    """Return engine `number` of a file in `folder`; what is wrong with its table goes to `problems`."""
    thrust = None
    try:
        if item.thrust is not None:
            thrust = _thrust_table(item.thrust)
        elif item.thrust_file is not None:
            thrust = _thrust_file(folder / item.thrust_file)
    except (SchemaError, UnitError, ValueError, OSError) as error:
        found = error.problems if isinstance(error, SchemaError) else [str(error)]
        problems += [f"engine.{number}.thrust: {text}" for text in found]
    return Engine(item.position, item.direction, thrust, item.time_constant, item.angular_momentum)


def _thrust_table(table: Mapping[str, Any]) -> xr.Dataset:
    from ..terms import make

    unknown = sorted(set(table) - {*THRUST_AXES, "value"})
    if unknown:
        raise ValueError(f"unknown key {', '.join(unknown)}; allowed: {', '.join(THRUST_AXES)}, value")
    if "value" not in table:
        raise ValueError("missing value, the thrust in N over the axes in the order they are written")
    axes = {name: [quantity(point, lookup(name).units) for point in points] for name, points in table.items() if name != "value"}
    value = np.vectorize(lambda item: quantity(item, "N"), otypes=[float])(np.array(table["value"], object))
    shape = tuple(len(points) for points in axes.values())
    if value.shape != shape:
        raise ValueError(f"value has the shape {value.shape}, the axes {' '.join(axes)} have {shape}")
    return make(value, axes)


def _thrust_file(path: Path) -> xr.Dataset:
    import xarray as xr

    from ..terms import check

    with xr.open_dataset(path, engine="h5netcdf") as dataset:
        leaf = dataset.load()
    problems = check(leaf)
    if problems:
        raise SchemaError(path.name, problems)
    return leaf
