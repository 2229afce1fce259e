"""Piston engine that turns a propeller: manifold, air, fuel and power.

The section ``[engine.piston]`` of the aircraft file. docs/explanation/simulation/propellers.md has
the equations of the kernel. The power is that of a chart over manifold pressure and speed, or that
of the fuel::

    [engine.piston]
    intake_impedance = "0.0002 s"
    throttle_impedance = "0.02 s"
    fire_rpm = "400 rpm"

    [engine.piston.tables.corrected_power]
    manifold_pressure = ["15 inHg", "28 inHg"]
    engine_rpm = ["2000 rpm", "2700 rpm"]
    value = [["40 kW", "52 kW"], ["98 kW", "134 kW"]]
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import xarray as xr
from pydantic import ConfigDict, Field

from flightmech.aircraft.propulsion.shaft_tables import list_constants, unknown_tables
from flightmech.errors import SchemaError
from flightmech.short_text import ShortText
from flightmech.support.toml_models import Strict
from flightmech.support.toml_quantities import InUnits

# Units of the tables of a piston engine. A `corrected_` power is that of the standard temperature
# at the ambient pressure.
PISTON_TARGETS = {
    "map_ratio": "1",
    "power": "W",
    "corrected_power": "W",
    "fuel_work": "m2 s-2",
    "fuel_flow": "kg s-1",
    "bsfc": "kg W-1 s-1",
    "friction_pressure": "Pa",
    "friction_power": "W",
    "motoring_power": "W",
}
_POWERS = ("power", "corrected_power", "fuel_work")
_MOST = sys.float_info.max


@dataclass(frozen=True)
class PistonEngine(ShortText):
    """Tables and constants of a piston engine with four strokes.

    Parameters
    ----------
    tables : mapping of str to Dataset
        A term leaf for each target, a key of `PISTON_TARGETS`. Variables of the engine itself have
        no number.
    displacement : float
        Swept volume of all cylinders; 0 without a model of the air, for power from a chart. [m3]
    volumetric_efficiency : float
        Volume of the air at manifold conditions over the swept volume, at equal pressure of
        manifold and exhaust. [1]
    compression_ratio : float
        Compression ratio. [1]
    pumping : float
        Part of the swept volume that works between manifold pressure and ambient pressure. [1]
    ram_recovery : float
        Part of the impact pressure that reaches the intake. [1]
    intake_impedance, throttle_impedance : float
        Manifold pressure is 1 / (1 + w (z_i + z_t (1 - throttle)^2)) of that at the intake, at the
        speed w of the crankshaft. Not used with a table ``map_ratio``. [s]
    map_time : float
        Lag of the manifold pressure. [s]
    boost_ratio : float
        Pressure ratio of the compressor, 1 without one. [1]
    boost_rpm : float
        Speed of the crankshaft at which a geared compressor has this ratio; 0 for a turbocharger,
        which has it at any speed. [rad s-1]
    boost_limit : float
        Manifold pressure that the wastegate holds. It is reached up to the critical altitude. [Pa]
    full_rich : float
        Mass of fuel over mass of air with the mixture lever at 1, at sea level. [1]
    enrichment : float
        The ratio grows as pressure ratio^-enrichment: 0 for compensated injection, 1 for a flow of
        fuel that the lever alone meters by the intake volume. [1]
    crank_torque, crank_rpm : float
        Torque of the starter at rest [N m], and the speed at which it has none [rad s-1].
    fire_rpm : float
        Speed of the crankshaft above which the engine fires. [rad s-1]
    flame_time : float
        Time constant of firing. [s]
    """

    tables: Mapping[str, xr.Dataset]
    displacement: float = 0.0
    volumetric_efficiency: float = 0.85
    compression_ratio: float = 8.5
    pumping: float = 0.0
    ram_recovery: float = 0.0
    intake_impedance: float = 0.0
    throttle_impedance: float = 0.0
    map_time: float = 0.3
    boost_ratio: float = 1.0
    boost_rpm: float = 0.0
    boost_limit: float = _MOST
    full_rich: float = 0.0884
    enrichment: float = 0.0
    crank_torque: float = 60.0
    crank_rpm: float = 60.0
    fire_rpm: float = 40.0
    flame_time: float = 0.1

    def __post_init__(self) -> None:
        problems = list(_check_piston(self))
        if problems:
            raise SchemaError("piston engine", problems)


class PistonTable(Strict):
    """An ``[engine.piston]`` of the aircraft file."""

    model_config = ConfigDict(protected_namespaces=())

    file: str | None = Field(
        default=None,
        examples=["piston.nc"],
        description="netCDF file with a group for each table, relative to this file.",
    )
    tables: dict[str, Any] = Field(
        default_factory=dict,
        json_schema_extra={"propertyNames": {"enum": list(PISTON_TARGETS)}},
        examples=[{"friction_power": "1.1 kW"}],
        description="Tables here: a number, or axes with value and, as needed, regressors and "
        "outside.",
    )
    displacement: Annotated[float, InUnits("m3")] | None = Field(
        default=None,
        examples=["360 in3"],
        description="Swept volume of all cylinders; without it no model of the air.",
    )
    volumetric_efficiency: Annotated[float, InUnits("1")] | None = Field(
        default=None,
        examples=[0.85],
        description="Volume of air in the manifold over the swept volume; 0.85 without it.",
    )
    compression_ratio: Annotated[float, InUnits("1")] | None = Field(
        default=None, examples=[8.5], description="Compression ratio; 8.5 without it."
    )
    pumping: Annotated[float, InUnits("1")] | None = Field(
        default=None,
        examples=[0.85],
        description="Part of the swept volume that works between manifold and ambient pressure; 0 "
        "without it.",
    )
    ram_recovery: Annotated[float, InUnits("1")] | None = Field(
        default=None,
        examples=[0.8],
        description="Part of the impact pressure at the intake; 0 without it.",
    )
    intake_impedance: Annotated[float, InUnits("s")] | None = Field(
        default=None,
        examples=["0.0002 s"],
        description="Fall of the manifold pressure with the speed at full throttle; 0 without it.",
    )
    throttle_impedance: Annotated[float, InUnits("s")] | None = Field(
        default=None,
        examples=["0.02 s"],
        description="The same of the closed throttle; 0 without it.",
    )
    map_time: Annotated[float, InUnits("s")] | None = Field(
        default=None,
        examples=["0.3 s"],
        description="Lag of the manifold pressure; 0.3 s without it.",
    )
    boost_ratio: Annotated[float, InUnits("1")] | None = Field(
        default=None, examples=[1.8], description="Pressure ratio of the compressor; 1 without it."
    )
    boost_rpm: Annotated[float, InUnits("rad s-1")] | None = Field(
        default=None,
        examples=["2700 rpm"],
        description="Speed of the crankshaft at which a geared compressor has its ratio; without "
        "it a turbocharger.",
    )
    boost_limit: Annotated[float, InUnits("Pa")] | None = Field(
        default=None,
        examples=["36 inHg"],
        description="Manifold pressure that the wastegate holds; none without it.",
    )
    full_rich: Annotated[float, InUnits("1")] | None = Field(
        default=None,
        examples=[0.0884],
        description="Fuel over air with the mixture lever at 1 at sea level; 0.0884 without it.",
    )
    enrichment: Annotated[float, InUnits("1")] | None = Field(
        default=None,
        examples=[0.5],
        description="Growth of that ratio with height, as a power of the pressure ratio; 0 without "
        "it.",
    )
    crank_torque: Annotated[float, InUnits("N m")] | None = Field(
        default=None, examples=["60 N m"], description="Starter torque at rest; 60 N m without it."
    )
    crank_rpm: Annotated[float, InUnits("rad s-1")] | None = Field(
        default=None,
        examples=["600 rpm"],
        description="Speed at which the starter has no torque; 60 rad/s without it.",
    )
    fire_rpm: Annotated[float, InUnits("rad s-1")] | None = Field(
        default=None,
        examples=["400 rpm"],
        description="Speed above which the engine fires; 40 rad/s without it.",
    )
    flame_time: Annotated[float, InUnits("s")] | None = Field(
        default=None, examples=["0.1 s"], description="Time constant of firing; 0.1 s without it."
    )


def _check_piston(piston: PistonEngine) -> Iterator[str]:
    """Yield the problems of a piston engine."""
    yield from unknown_tables(piston.tables, PISTON_TARGETS, "table of a piston engine")
    if not set(_POWERS) & set(piston.tables):
        yield (
            "no table of the power; give corrected_power or power over manifold_pressure and "
            "engine_rpm, or fuel_work and the displacement"
        )
    if "fuel_work" in piston.tables and not piston.displacement > 0.0:
        yield "fuel_work needs the air of the engine; give its displacement"
    for name in list_constants(PistonEngine):
        value = getattr(piston, name)
        if not value >= 0.0:
            yield f"{name} is {value:g}; it must be zero or positive"
