"""Propeller of an engine: coefficients, blades, governor and shaft.

The section ``[engine.propeller]`` of the aircraft file. docs/explanation/simulation/propellers.md
has the equations of the kernel::

    [engine.propeller]
    diameter = "1.905 m"
    inertia = 2.26                      # with all that turns with it [kg m2]
    rpm_high = "2700 rpm"

    [engine.propeller.tables.CT_prop]
    J = [0.0, 0.5, 1.0, 1.2]
    value = [0.073, 0.066, 0.024, -0.006]
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

import numpy as np
import xarray as xr
from pydantic import ConfigDict, Field

from flightmech.aircraft.propulsion.shaft_tables import unknown_tables
from flightmech.errors import SchemaError
from flightmech.short_text import ShortText
from flightmech.support.toml_models import Strict
from flightmech.support.toml_quantities import InUnits
from flightmech.terms import evaluate_term, list_regressors

# Units of the tables of a propeller. Shaft power is that of an engine without a piston engine or a
# motor, such as the gas turbine of a deck.
PROPELLER_TARGETS = {
    "CT_prop": "1",
    "CP_prop": "1",
    "CN_prop": "1",
    "CM_prop": "1",
    "low_stop": "rad",
    "shaft_power": "W",
    "corrected_shaft_power": "W",
    "shaft_bsfc": "kg W-1 s-1",
}
# Largest double, the bound of a limit that does not act.
_MOST = sys.float_info.max


@dataclass(frozen=True)
class Propeller(ShortText):
    """Propeller on its shaft.

    Parameters
    ----------
    tables : mapping of str to Dataset
        A term leaf for each target, a key of `PROPELLER_TARGETS`. ``CT_prop`` and ``CP_prop`` are
        needed, over ``J`` and, where the blades turn, ``blade_angle``. Variables of the engine
        itself have no number.
    diameter : float
        Diameter. [m]
    inertia : float
        Moment of inertia of the propeller and of all that turns with it, at the speed of the
        propeller. [kg m2]
    rpm_high : float
        Speed that the lever commands at 1; rated speed of fixed pitch. [rad s-1]
    rpm_low : float
        Speed that the lever commands at 0. [rad s-1]
    rotation : int
        1 right-handed about the thrust (clockwise seen from behind), -1 left-handed.
    gear_ratio : float
        Speed of the engine over that of the propeller.
    low_pitch, high_pitch : float
        Stops of the governor. Equal ones are fixed pitch. [rad]
    feather_pitch : float
        Blade angle of the feathered propeller. [rad]
    pitch_rate, feather_rate : float
        Largest rates of the blade angle; a feather rate of 0 cannot feather. [rad s-1]
    governor_gain : float
        Rate of the blade angle per error of the speed. [1]
    governor_time : float
        Lag of the governor, 0 without a lag. [s]
    governed : bool
        Whether a governor turns the blades. Without one, the propeller lever sets the blade angle
        between the stops.
    power_limit, torque_limit : float
        Limits of the shaft power of the tables [W], and of its torque at the propeller [N m].
    power_time : float
        Lag of the shaft power of the tables, 0 without a lag. [s]
    """

    tables: Mapping[str, xr.Dataset]
    diameter: float
    inertia: float
    rpm_high: float
    rpm_low: float = 0.0
    rotation: int = 1
    gear_ratio: float = 1.0
    low_pitch: float = 0.0
    high_pitch: float | None = None
    feather_pitch: float = 1.5
    pitch_rate: float = 0.2
    feather_rate: float = 0.0
    governor_gain: float = 0.02
    governor_time: float = 0.0
    governed: bool | None = None
    power_limit: float = _MOST
    torque_limit: float = _MOST
    power_time: float = 0.0

    def __post_init__(self) -> None:
        # stops that are not given are those of fixed pitch
        if self.high_pitch is None:
            object.__setattr__(self, "high_pitch", self.low_pitch)
        if self.governed is None:
            object.__setattr__(self, "governed", self.turns_blades)
        problems = list(_check_propeller(self))
        if problems:
            raise SchemaError("propeller", problems)

    @property
    def turns_blades(self) -> bool:
        """Whether the blade angle can change."""
        return self.highest > self.low_pitch or "low_stop" in self.tables

    @property
    def highest(self) -> float:
        """Upper stop of the governor. [rad]"""
        return self.low_pitch if self.high_pitch is None else self.high_pitch

    @cached_property
    def J_end(self) -> float:
        """Last advance ratio of both tables."""
        ends = [float(self.tables[name]["J"][-1]) for name in ("CT_prop", "CP_prop")]
        return min(ends)


class PropellerTable(Strict):
    """An ``[engine.propeller]`` of the aircraft file."""

    model_config = ConfigDict(protected_namespaces=())

    file: str | None = Field(
        default=None,
        examples=["propeller.nc"],
        description="netCDF file with a group for each table, relative to this file.",
    )
    tables: dict[str, Any] = Field(
        default_factory=dict,
        json_schema_extra={"propertyNames": {"enum": list(PROPELLER_TARGETS)}},
        examples=[{"CT_prop": {"J": [0.0, 1.2], "value": [0.1, -0.01]}}],
        description="Tables here: a number, or axes with value and, as needed, regressors and "
        "outside.",
    )
    diameter: Annotated[float, InUnits("m")] = Field(
        examples=["1.9 m"], description="Diameter of the propeller."
    )
    inertia: Annotated[float, InUnits("kg m2")] = Field(
        examples=[2.3],
        description="Moment of inertia of the propeller and of all that turns with it, at the "
        "speed of the propeller.",
    )
    rpm_high: Annotated[float, InUnits("rad s-1")] = Field(
        examples=["2700 rpm"],
        description="Speed of the propeller with the lever at 1; rated speed of fixed pitch.",
    )
    rpm_low: Annotated[float, InUnits("rad s-1")] | None = Field(
        default=None,
        examples=["1800 rpm"],
        description="Speed of the propeller with the lever at 0; 0 without it.",
    )
    rotation: int | None = Field(
        default=None,
        examples=[1],
        description="1 clockwise seen from behind, -1 the other way; 1 without it.",
    )
    gear_ratio: Annotated[float, InUnits("1")] | None = Field(
        default=None,
        examples=[1.5],
        description="Speed of the engine over that of the propeller; 1 without it.",
    )
    low_pitch: Annotated[float, InUnits("rad")] | None = Field(
        default=None,
        examples=["12 deg"],
        description="Lower stop of the blade angle; 0 without it.",
    )
    high_pitch: Annotated[float, InUnits("rad")] | None = Field(
        default=None,
        examples=["32 deg"],
        description="Upper stop of the blade angle; fixed pitch without it.",
    )
    feather_pitch: Annotated[float, InUnits("rad")] | None = Field(
        default=None,
        examples=["82 deg"],
        description="Blade angle when feathered; 1.5 rad without it.",
    )
    pitch_rate: Annotated[float, InUnits("rad s-1")] | None = Field(
        default=None,
        examples=["10 deg/s"],
        description="Largest rate of the blade angle; 0.2 rad/s without it.",
    )
    feather_rate: Annotated[float, InUnits("rad s-1")] | None = Field(
        default=None,
        examples=["15 deg/s"],
        description="Rate of the blade angle to feather; without it the propeller cannot feather.",
    )
    governor_gain: Annotated[float, InUnits("1")] | None = Field(
        default=None,
        examples=[0.02],
        description="Rate of the blade angle per error of the speed; 0.02 without it.",
    )
    governor_time: Annotated[float, InUnits("s")] | None = Field(
        default=None, examples=["0.1 s"], description="Lag of the governor; none without it."
    )
    governed: bool | None = Field(
        default=None,
        examples=[False],
        description="Whether a governor turns the blades; false: the propeller lever sets the "
        "blade angle.",
    )
    power_limit: Annotated[float, InUnits("W")] | None = Field(
        default=None,
        examples=["410 kW"],
        description="Limit of the shaft power of the tables; none without it.",
    )
    torque_limit: Annotated[float, InUnits("N m")] | None = Field(
        default=None,
        examples=["1970 N m"],
        description="Limit of the torque of the tables at the propeller; none without it.",
    )
    power_time: Annotated[float, InUnits("s")] | None = Field(
        default=None,
        examples=["0.1 s"],
        description="Lag of the shaft power of the tables; none without it.",
    )


def _check_propeller(propeller: Propeller) -> Iterator[str]:
    """Yield the problems of a propeller."""
    yield from unknown_tables(propeller.tables, PROPELLER_TARGETS, "table of a propeller")
    positive = ("diameter", "inertia", "rpm_high", "gear_ratio")
    for name in positive:
        value = getattr(propeller, name)
        if not 0.0 < value < np.inf:
            yield f"{name} is {value:g}; it must be positive"
    if propeller.rotation not in (1, -1):
        yield f"rotation is {propeller.rotation}; 1 (clockwise seen from behind) or -1"
    if propeller.highest < propeller.low_pitch:
        yield "high_pitch is below low_pitch; exchange them"
    if propeller.rpm_low > propeller.rpm_high:
        yield "rpm_low is above rpm_high; exchange them"
    missing = [name for name in ("CT_prop", "CP_prop") if name not in propeller.tables]
    if missing:
        yield f"no table {' and '.join(missing)}; give the coefficients over J"
        return
    for name in ("CT_prop", "CP_prop"):
        yield from _check_coefficient(propeller, name)
    yield from _check_range(propeller)
    yield from _check_efficiency(propeller)
    if propeller.turns_blades:
        yield from _check_blade_angles(propeller)


def _check_coefficient(propeller: Propeller, name: str) -> Iterator[str]:
    """Yield the problems of the axes of a coefficient."""
    leaf = propeller.tables[name]
    if "J" not in leaf["value"].dims:
        yield f"{name} has no axis J; the coefficients are tables over the advance ratio"
    if propeller.turns_blades and "blade_angle" not in leaf["value"].dims:
        yield (
            f"{name} has no axis blade_angle, and the blades turn; add it, or leave out high_pitch"
        )


def _check_range(propeller: Propeller) -> Iterator[str]:
    """Yield the advance ratios that flight reaches and the tables do not have."""
    for name in ("CT_prop", "CP_prop"):
        leaf = propeller.tables[name]
        if "J" not in leaf["value"].dims:
            return
        first = float(leaf["J"][0])
        if first > 0.0:
            yield (
                f"{name} begins at J {first:g}; a standing aircraft has J 0: add the static value "
                f"as the node J = 0"
            )
    at = {"J": propeller.J_end, "blade_angle": propeller.low_pitch}
    thrust = float(_evaluate(propeller.tables["CT_prop"], at))
    if thrust > 0.0:
        yield (
            f"CT_prop is still {thrust:.3g} at J {propeller.J_end:g}, the end of the tables, with "
            f"blades at {np.degrees(propeller.low_pitch):.3g} deg; a dive and a failed engine go "
            f"beyond: continue both tables until the thrust is negative"
        )
    if propeller.feather_rate > 0.0:
        at["blade_angle"] = propeller.feather_pitch
        power = float(_evaluate(propeller.tables["CP_prop"], at))
        if power > 0.0:
            yield (
                f"CP_prop is still {power:.3g} at J {propeller.J_end:g}, the end of the tables, "
                f"with feathered blades at {np.degrees(propeller.feather_pitch):.3g} deg; a "
                f"feathered propeller slows down to any J: continue both tables until the power is "
                f"negative there, or leave out feather_rate"
            )


def _check_efficiency(propeller: Propeller) -> Iterator[str]:
    """Yield the node at which the propeller would give more power than it takes."""
    thrust, power = propeller.tables["CT_prop"], propeller.tables["CP_prop"]
    for leaf in (thrust, power):
        if "J" not in leaf["value"].dims:
            return
    angles = [propeller.low_pitch]
    if propeller.turns_blades and "blade_angle" in power["value"].dims:
        blades = power["blade_angle"].values
        inside = (blades >= propeller.low_pitch) & (blades <= propeller.highest)
        angles = [propeller.low_pitch, *blades[inside], propeller.highest]
    # All nodes in one call (angle, J): a call per node takes a hundred times as long.
    nodes = power["J"].values
    at = {"J": nodes, "blade_angle": np.array(angles)[:, np.newaxis]}
    taken, at_air = np.broadcast_arrays(_evaluate(power, at), nodes * _evaluate(thrust, at))
    # Efficiency J CT / CP: power to the air over power at the shaft.
    faults = np.argwhere((at_air > taken) & (taken > 0.0))
    if faults.size:
        k = tuple(faults[0])
        yield (
            f"J CT/CP is {at_air[k] / taken[k]:.3g} at J {nodes[k[-1]]:g}, above 1: the "
            f"coefficients are not T/(rho n^2 D^4) and P/(rho n^3 D^5) with n in revolutions per "
            f"second; convert both"
        )


def _check_blade_angles(propeller: Propeller) -> Iterator[str]:
    """Yield advance ratios at which a coarser blade takes less torque: no governor works there."""
    leaf = propeller.tables["CP_prop"]
    if "blade_angle" not in leaf["value"].dims or "J" not in leaf["value"].dims:
        return
    nodes = leaf["blade_angle"].values
    inside = (nodes > propeller.low_pitch) & (nodes < propeller.highest)
    angles = np.concatenate([[propeller.low_pitch], nodes[inside], [propeller.highest]])
    powers = _evaluate(leaf, {"J": leaf["J"].values[:, np.newaxis], "blade_angle": angles})
    for J, power in zip(leaf["J"].values, powers, strict=True):
        # a windmilling propeller may lose torque with the blade angle
        falls = np.flatnonzero((np.diff(power) < 0.0) & (power[:-1] > 0.0))
        if falls.size:
            k = int(falls[0])
            low, high = np.degrees(angles[k : k + 2])
            yield (
                f"CP_prop falls from {power[k]:.4g} to {power[k + 1]:.4g} between blade angles of "
                f"{low:.3g} and {high:.3g} deg at J {J:g}; a governor needs a torque that grows "
                f"with the blade angle between low_pitch and high_pitch: correct the table, or "
                f"raise low_pitch or lower high_pitch"
            )
            return


def _evaluate(leaf: xr.Dataset, at: Mapping[str, Any]) -> np.ndarray:
    """Return a coefficient at numbers or arrays; other axes are at their first node, such as the
    Mach number of the tips.
    """
    names: set[str] = set()
    for table in leaf.data_vars.values():
        names.update(map(str, table.dims))
    point: dict[str, Any] = {}
    for name in (*names, *list_regressors(leaf)):
        first = float(leaf[name][0]) if name in leaf.coords else 1.0
        point[name] = at.get(name, first)
    for name in names & set(at):
        nodes = leaf[name].values
        point[name] = np.clip(at[name], nodes[0], nodes[-1])
    return evaluate_term(leaf, point)
