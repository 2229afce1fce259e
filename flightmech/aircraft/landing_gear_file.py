"""Section ``[gear]`` of the aircraft file.

For example::

    [gear]
    mu_dry = 0.8
    tyre_pressure = "100 psi"            # for the wet runway
    antiskid = 0.8
    [gear.steering]
    limit = "40 deg"
    stiffness = 2000.0
    [[gear.contact]]
    name = "left"
    position = [-0.17, -0.805, 0.759]    # lowest point of the unloaded tyre, strut extended
    radius = 0.25
    stiffness = "100e3 N/m"
    damping = 8000.0
    side_stiffness = "150e3 N/m"
    cornering_stiffness = "40e3 N"
    cornering_load = "12e3 N"
    brake = "6e3 N"
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import ConfigDict, Field, field_validator, model_validator

from flightmech.aircraft.landing_gear import (
    CONDITIONS,
    Contact,
    LandingGear,
    Steering,
    wet_friction,
)
from flightmech.errors import SchemaError, UnitError
from flightmech.quantities import parse_quantity
from flightmech.support.toml_models import Strict
from flightmech.support.toml_quantities import InUnits
from flightmech.terms import make_term
from flightmech.units import to_si

if TYPE_CHECKING:
    import xarray as xr

# order of the steering by its name in the file
ORDERS = {"quasi-static": 0, "second": 2, "fourth": 4}

_Length = Annotated[float, InUnits("m")]
_PerMetre = Annotated[float, InUnits("N m-1")]
_PerRate = Annotated[float, InUnits("N s m-1")]
_PerSquare = Annotated[float, InUnits("N s2 m-2")]
_Force = Annotated[float, InUnits("N")]
_Ratio = Annotated[float, InUnits("1")]
_Moment = Annotated[float, InUnits("N m")]
_Inertia = Annotated[float, InUnits("kg m2")]


class _GearTable(Strict):
    model_config = ConfigDict(protected_namespaces=())

    # nan and inf are numbers of TOML
    @field_validator("*")
    @classmethod
    def _finite(cls, value: Any) -> Any:
        if isinstance(value, float) and not np.isfinite(value):
            raise ValueError("expected a finite number")
        return value


def _demand_not_negative(table: _GearTable, names: tuple[str, ...]) -> None:
    negative = [name for name in names if getattr(table, name) < 0.0]
    if negative:
        raise ValueError(f"{', '.join(negative)} must be zero or positive")


# properties of a contact that must not be negative
_NOT_NEGATIVE = (
    "radius",
    "stiffness",
    "preload",
    "damping",
    "orifice",
    "tyre_stiffness",
    "cornering_stiffness",
    "loss",
    "rolling",
    "brake",
    "brake_friction",
    "friction",
)


class ContactTable(_GearTable):
    """A ``[[gear.contact]]`` of the aircraft file."""

    name: str = Field(
        description="Name of the leg: nose, left, right, tail ...; its outputs are gear.NAME.Fz "
        "and so on."
    )
    position: tuple[_Length, _Length, _Length] = Field(
        description="Lowest point with the aircraft level and the leg unloaded, body axes, from "
        "the moment reference point."
    )
    radius: _Length = Field(
        default=0.0, examples=["0.25 m"], description="Radius of the unloaded tyre."
    )
    stiffness: _PerMetre = Field(default=0.0, description="Strut force per compression.")
    preload: _Force = Field(
        default=0.0,
        examples=["800 N"],
        description="Strut force at no compression; needs tyre_stiffness.",
    )
    strut: dict[str, Any] | None = Field(
        default=None,
        json_schema_extra={"propertyNames": {"enum": ["compression", "value"]}},
        examples=[{"compression": [0.0, 0.2], "value": ["0 N", "9000 N"]}],
        description="More strut force [N] as a table over compression [m].",
    )
    stroke: _Length = Field(
        default=10.0,
        examples=["0.25 m"],
        description="Compression at which the strut is solid and the tyre alone gives way.",
    )
    damping: _PerRate = Field(
        default=0.0, description="Strut force per rate of compression, inwards."
    )
    damping_ext: _PerRate | None = Field(
        default=None, examples=[8000.0], description="The same outwards; damping without it."
    )
    orifice: _PerSquare = Field(
        default=0.0,
        examples=[20000.0],
        description="Strut force per square of the rate of compression, inwards.",
    )
    orifice_ext: _PerSquare | None = Field(
        default=None, examples=[40000.0], description="The same outwards; orifice without it."
    )
    tyre_stiffness: _PerMetre = Field(
        default=0.0,
        examples=["250e3 N/m"],
        description="Vertical stiffness of the tyre, in series with the strut; 0: the leg is one "
        "spring.",
    )
    side_stiffness: _PerMetre = Field(description="Stiffness of the tyre or skid along the ground.")
    cornering_stiffness: _Force = Field(
        default=0.0, description="Greatest side force per slip angle [N/rad]; 0 for a skid."
    )
    cornering_load: _Force = Field(
        default=1.0e4, description="Load at which the greatest cornering stiffness is reached."
    )
    loss: Annotated[float, InUnits("s")] = Field(
        default=0.02,
        examples=[0.02],
        description="Damping of the carcass along the ground over its stiffness, at most 0.04 s.",
    )
    rolling: _Ratio = Field(default=0.0, description="Rolling resistance over load.")
    brake: _Force = Field(default=0.0, description="Brake force at the ground with a full pedal.")
    brake_friction: _Ratio = Field(
        default=0.0, description="Brake force over load with a full pedal, added to brake."
    )
    steering: _Ratio = Field(
        default=0.0, description="Angle of the wheel per angle of the steering; 0: not steered."
    )
    friction: _Ratio = Field(
        default=0.0,
        description="Friction of a skid over load; 0: a wheel, for which the runway defines it.",
    )
    retracts: bool = Field(
        default=True,
        description="Whether it carries in proportion to the input gear, and nothing when that is "
        "0.",
    )

    @field_validator("name")
    @classmethod
    def _identifier(cls, name: str) -> str:
        # the name is part of the names of outputs, gear.NAME.Fz
        if not (name.isascii() and name.isidentifier() and name.islower()):
            raise ValueError("expected a name of small letters, digits and _, e.g. nose")
        return name

    @model_validator(mode="after")
    def _physical(self) -> ContactTable:
        _demand_not_negative(self, _NOT_NEGATIVE)
        for name in ("side_stiffness", "cornering_load", "stroke"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} must be positive")
        if not (self.stiffness > 0.0 or self.strut is not None):
            raise ValueError("the leg has no spring; give stiffness or strut")
        # the force of a spring without the tyre in series would jump at the first contact
        if self.preload > 0.0 and self.tyre_stiffness == 0.0:
            raise ValueError(
                "preload needs a tyre_stiffness, or the ground would push at a touch with "
                "the whole preload"
            )
        # a skid has friction and no cornering stiffness, a wheel the reverse
        if (self.friction > 0.0) == (self.cornering_stiffness > 0.0):
            raise ValueError(
                "give cornering_stiffness for a wheel or friction for a skid, one of them"
            )
        if self.loss > 0.04:
            raise ValueError("loss must be at most 0.04 s")
        return self


class SteeringTable(_GearTable):
    """``[gear.steering]`` of the aircraft file."""

    order: Literal["quasi-static", "second", "fourth"] = Field(
        default="quasi-static",
        examples=["second"],
        description="Wheel follows at once; one mass (wheel); two masses (arm and wheel).",
    )
    limit: _Ratio = Field(default=np.pi / 4.0, description="Greatest angle to either side [rad].")
    stiffness: _Moment = Field(
        default=0.0,
        description="Moment on the wheel per angle behind the command or the arm [N m/rad]; 0 and "
        "quasi-static: a castor.",
    )
    trail: _Length = Field(
        default=0.1,
        description="Trail of the side force behind the pivot, mechanical and pneumatic.",
    )
    scrub: _Length = Field(
        default=0.0,
        description="Arm of the friction of a turning wheel at rest: moment over friction force.",
    )
    rudder: _Ratio = Field(
        default=0.0,
        examples=[1.0],
        description="Angle commanded by the pedals, to the right per rudder deflection to the "
        "right.",
    )
    damping: Annotated[float, InUnits("N m s")] = Field(
        default=0.0, examples=[20.0], description="Damping of the wheel about its pivot."
    )
    inertia: _Inertia = Field(
        default=0.0, examples=[0.3], description="Moment of inertia of the wheel about its pivot."
    )
    arm_stiffness: _Moment = Field(
        default=0.0,
        examples=[3000.0],
        description="Stiffness of the arm between command and wheel [N m/rad], order fourth.",
    )
    arm_damping: Annotated[float, InUnits("N m s")] = Field(
        default=0.0, examples=[10.0], description="Damping of that arm."
    )
    arm_inertia: _Inertia = Field(
        default=0.0, examples=[0.1], description="Moment of inertia of that arm."
    )

    @model_validator(mode="after")
    def _physical(self) -> SteeringTable:
        names = ("limit", "stiffness", "scrub", "damping", "inertia")
        arm = ("arm_stiffness", "arm_damping", "arm_inertia")
        _demand_not_negative(self, (*names, *arm))
        # a mass of zero has no equation of motion
        if self.order != "quasi-static" and not self.inertia > 0.0:
            raise ValueError(f"order {self.order} needs an inertia")
        if self.order == "fourth" and not self.arm_inertia > 0.0:
            raise ValueError("order fourth needs an arm_inertia")
        return self


class GearTable(_GearTable):
    """``[gear]`` of the aircraft file."""

    contact: list[ContactTable] = Field(min_length=1, description="Wheels and skids.")
    steering: SteeringTable = Field(default=SteeringTable(), description="Nose-wheel steering.")
    condition: Literal["dry", "wet", "icy"] = Field(
        default="dry", examples=["wet"], description="Of the runway at the start."
    )
    mu_dry: _Ratio = Field(
        default=0.8, description="Greatest friction of a tyre over load on a dry runway."
    )
    mu_icy: _Ratio = Field(default=0.05, description="The same on ice (AMC 25.1591).")
    tyre_pressure: Annotated[float, InUnits("Pa")] = Field(
        default=to_si(100.0, "psi"),
        description="Inflation pressure over ambient; gives the friction on a wet runway (14 CFR "
        "25.109(c)(1)).",
    )
    mu_wet: tuple[float, float, float, float] | None = Field(
        default=None,
        examples=[[0.8, -0.0157, 0.00012, -3.2e-07]],
        description="The same on a wet runway: coefficients of 1, V, V^2, V^3 of the ground "
        "speed; replaces tyre_pressure.",
    )
    skid_ratio: _Ratio = Field(
        default=0.7, description="Friction of a locked wheel over the greatest friction."
    )
    antiskid: _Ratio = Field(
        default=0.0,
        examples=[0.8],
        description="Part of the greatest friction that the anti-skid system leaves to the "
        "brakes; 0: none.",
    )

    @field_validator("contact")
    @classmethod
    def _once(cls, contacts: list[ContactTable]) -> list[ContactTable]:
        names = [contact.name for contact in contacts]
        repeated = sorted({name for name in names if names.count(name) > 1})
        if repeated:
            raise ValueError(
                f"contact {', '.join(repeated)} is given more than once; every contact has a "
                f"name of its own"
            )
        return contacts

    @model_validator(mode="after")
    def _physical(self) -> GearTable:
        _demand_not_negative(self, ("mu_dry", "mu_icy", "tyre_pressure", "skid_ratio", "antiskid"))
        if self.skid_ratio > 1.0 or self.antiskid > 1.0:
            raise ValueError("skid_ratio and antiskid must be between 0 and 1")
        return self


def gear_of(table: GearTable, problems: list[str]) -> LandingGear:
    """Return the landing gear of a file. Problems of its tables are appended to `problems`."""
    steering = {**dict(table.steering), "order": ORDERS[table.steering.order]}
    mu_wet = table.mu_wet
    if mu_wet is None:
        mu_wet = wet_friction(table.tyre_pressure)
    return LandingGear(
        contacts=tuple(_make_contact(item, problems) for item in table.contact),
        steering=Steering(**steering),
        condition=CONDITIONS.index(table.condition),
        mu_dry=table.mu_dry,
        mu_wet=mu_wet,
        mu_icy=table.mu_icy,
        skid_ratio=table.skid_ratio,
        antiskid=table.antiskid,
    )


def _make_contact(item: ContactTable, problems: list[str]) -> Contact:
    values = dict(item)
    # the default of an outward property is the inward property
    if item.damping_ext is None:
        values["damping_ext"] = item.damping
    if item.orifice_ext is None:
        values["orifice_ext"] = item.orifice
    values["strut"] = None
    if item.strut is not None:
        try:
            values["strut"] = _strut_table(item.strut)
        except (SchemaError, UnitError, ValueError, TypeError) as error:
            texts = error.problems if isinstance(error, SchemaError) else [str(error)]
            problems += [f"gear.contact.{item.name}.strut: {text}" for text in texts]
    return Contact(**values)


def _strut_table(table: Mapping[str, Any]) -> xr.Dataset:
    if set(table) != {"compression", "value"}:
        raise ValueError(
            f"expected compression and value, the strut force over it; found "
            f"{', '.join(sorted(table)) or 'nothing'}"
        )
    compression = [parse_quantity(point, "m") for point in table["compression"]]
    force = [parse_quantity(value, "N") for value in table["value"]]
    # beyond the last point the force continues with the last slope
    return make_term(force, {"compression": compression}, outside="linear")
