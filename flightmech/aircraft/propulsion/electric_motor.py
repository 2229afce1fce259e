"""Direct-current motor with controller and battery that turns a propeller.

The section ``[engine.motor]`` of the aircraft file::

    [engine.motor]
    speed_constant = "800 rpm/V"
    motor_resistance = "0.03 ohm"
    idle_current = "1.5 A"
    battery_resistance = "0.02 ohm"
    capacity = "5 Ah"
    tables.open_voltage = { charge = [0.0, 0.2, 1.0], value = [18.0, 21.6, 25.2] }
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import xarray as xr
from pydantic import ConfigDict, Field

from flightmech.aircraft.propulsion.shaft_tables import unknown_tables
from flightmech.errors import SchemaError
from flightmech.short_text import ShortText
from flightmech.support.toml_models import Strict
from flightmech.support.toml_quantities import InUnits

# Units of the tables of a motor.
MOTOR_TARGETS = {"open_voltage": "V"}


@dataclass(frozen=True)
class ElectricMotor(ShortText):
    """Motor, controller and battery.

    Parameters
    ----------
    tables : mapping of str to Dataset
        ``open_voltage``, the voltage of the battery without a load, over ``charge``. [V]
    speed_constant : float
        Speed of the unloaded motor over its voltage. [rad s-1 V-1]
    motor_resistance, battery_resistance : float
        Resistances. [V A-1]
    idle_current : float
        Current of the motor without a load. [A]
    capacity : float
        Charge of the full battery. [A s]
    charge_start : float
        Charge at the start, a fraction. [1]
    """

    tables: Mapping[str, xr.Dataset]
    speed_constant: float
    motor_resistance: float
    capacity: float
    idle_current: float = 0.0
    battery_resistance: float = 0.0
    charge_start: float = 1.0

    def __post_init__(self) -> None:
        problems = list(_check_motor(self))
        if problems:
            raise SchemaError("electric motor", problems)


class MotorTable(Strict):
    """An ``[engine.motor]`` of the aircraft file."""

    model_config = ConfigDict(protected_namespaces=())

    file: str | None = Field(
        default=None,
        examples=["motor.nc"],
        description="netCDF file with a group for each table, relative to this file.",
    )
    tables: dict[str, Any] = Field(
        default_factory=dict,
        json_schema_extra={"propertyNames": {"enum": list(MOTOR_TARGETS)}},
        examples=[{"open_voltage": {"charge": [0.0, 1.0], "value": [18.0, 25.2]}}],
        description="The voltage of the battery without a load over its charge.",
    )
    speed_constant: Annotated[float, InUnits("rad s-1 V-1")] = Field(
        examples=["800 rpm/V"], description="Speed of the unloaded motor over its voltage."
    )
    motor_resistance: Annotated[float, InUnits("V A-1")] = Field(
        examples=["0.03 ohm"], description="Resistance of the motor."
    )
    capacity: Annotated[float, InUnits("A s")] = Field(
        examples=["5 Ah"], description="Charge of the full battery."
    )
    idle_current: Annotated[float, InUnits("A")] | None = Field(
        default=None,
        examples=["1.5 A"],
        description="Current of the motor without a load; 0 without it.",
    )
    battery_resistance: Annotated[float, InUnits("V A-1")] | None = Field(
        default=None,
        examples=["0.02 ohm"],
        description="Resistance of the battery; 0 without it.",
    )
    charge_start: float | None = Field(
        default=None, examples=[0.95], description="Charge at the start, a fraction; 1 without it."
    )


def _check_motor(motor: ElectricMotor) -> Iterator[str]:
    """Yield the problems of a motor."""
    yield from unknown_tables(motor.tables, MOTOR_TARGETS, "table of a motor")
    if "open_voltage" not in motor.tables:
        yield "no table open_voltage; give the voltage of the battery without a load over charge"
    for name in ("speed_constant", "motor_resistance", "capacity"):
        value = getattr(motor, name)
        if not value > 0.0:
            yield f"{name} is {value:g}; it must be positive"
    for name in ("idle_current", "battery_resistance"):
        value = getattr(motor, name)
        if not value >= 0.0:
            yield f"{name} is {value:g}; it must be zero or positive"
    if not 0.0 <= motor.charge_start <= 1.0:
        yield f"charge_start is {motor.charge_start:g}; it must be between 0 and 1"
