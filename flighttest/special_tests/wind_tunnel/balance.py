"""What a balance measures and how it sits in the model, as a TOML file.

[reference]
S = "0.032 m2"
b = "0.40 m"
c = "0.10 m"

[balance]
rotation = ["0 deg", "180 deg", "0 deg"]     # phi, theta, psi that turn body axes into those of the balance
offset = ["-0.12 m", "0 m", "0.02 m"]        # its centre from the moment reference point, x forward, y right, z down

[columns]
alpha = "alpha [deg]"
V = "speed"
Fx = "fx"

[errors]                                     # common to all points: calibration, not scatter
alpha = "0.1 deg"
V = "0.05 m/s"
Fz = "0.01 N"

[constants]                                  # of all points: what tables of the database depend on
mach = 0.03
delta_f = "0 deg"

[nuisance]                                   # estimated and taken off
CL = ["tare", "strut"]
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, model_validator

from flightmech.errors import AeromatchError
from flightmech.names import lookup
from flightmech.support.input_files import read_toml
from flightmech.support.toml_models import Strict, validate_content
from flightmech.support.toml_quantities import InUnits
from flightmech.units import parse_quantity

FORCES, MOMENTS = ("Fx", "Fy", "Fz"), ("Mx", "My", "Mz")
LOADS = (*FORCES, *MOMENTS)
STATE = {"alpha": "rad", "beta": "rad", "V": "m s-1", "rho": "kg m-3", "qbar": "Pa"}
UNITS = {**STATE, **dict.fromkeys(FORCES, "N"), **dict.fromkeys(MOMENTS, "N m")}
COEFFICIENTS = ("CL", "CD", "CX", "CY", "CZ", "Cl", "Cm", "Cn")


def _errors(item: Any) -> dict[str, float]:
    if not isinstance(item, dict):
        raise ValueError(
            'a table of measurands and their standard errors is needed, such as { Fz = "0.01 N" }'
        )
    unknown = [str(name) for name in item if name not in UNITS]
    if unknown:
        raise ValueError(f"{', '.join(unknown)}: unknown; allowed: {', '.join(UNITS)}")
    try:
        found = {str(name): parse_quantity(value, UNITS[str(name)]) for name, value in item.items()}
    except AeromatchError as error:
        raise ValueError(str(error)) from error
    if any(not value >= 0.0 for value in found.values()):
        raise ValueError("a standard error is negative")
    return found


def _constants(item: Any) -> dict[str, float]:
    if not isinstance(item, dict):
        raise ValueError(
            'a table of quantities is needed, such as { mach = 0.03, delta_f = "0 deg" }'
        )
    try:
        return {
            str(name): parse_quantity(value, lookup(str(name)).units)
            for name, value in item.items()
        }
    except AeromatchError as error:
        raise ValueError(str(error)) from error


class ReferenceLengths(Strict):
    """Reference lengths of the coefficients."""

    S: Annotated[float, InUnits("m2")] = Field(gt=0.0, description="Reference area.")
    b: Annotated[float, InUnits("m")] = Field(
        gt=0.0, description="Span, of rolling and yawing moment."
    )
    c: Annotated[float, InUnits("m")] = Field(gt=0.0, description="Chord, of the pitching moment.")


class Balance(Strict):
    """How the balance sits in the model."""

    rotation: tuple[
        Annotated[float, InUnits("rad")],
        Annotated[float, InUnits("rad")],
        Annotated[float, InUnits("rad")],
    ] = Field(
        default=(0.0, 0.0, 0.0),
        description="phi, theta, psi that turn body axes (x forward, z down) into those of the "
        "balance.",
    )
    offset: tuple[
        Annotated[float, InUnits("m")],
        Annotated[float, InUnits("m")],
        Annotated[float, InUnits("m")],
    ] = Field(
        default=(0.0, 0.0, 0.0),
        description="Centre of the balance from the moment reference point, in body axes.",
    )
    moves: bool = Field(
        default=True,
        description="Whether it turns with the model; false for a balance fixed in the tunnel.",
    )


class BalanceSetup(Strict):
    """What a balance measures and how it sits in the model."""

    reference: ReferenceLengths
    balance: Balance = Balance()
    columns: dict[str, str] = Field(
        default_factory=dict,
        description="Measurand to column of the file, with its unit in brackets.",
    )
    errors: Annotated[dict[str, float], BeforeValidator(_errors)] = Field(
        default_factory=dict, description="Standard errors common to all points."
    )
    constants: Annotated[dict[str, float], BeforeValidator(_constants)] = Field(
        default_factory=dict,
        description="Quantities that all points have in common, such as the Mach number that "
        "tables depend on.",
    )
    nuisance: dict[str, tuple[str, ...]] = Field(
        default_factory=dict,
        description="Terms per coefficient that are estimated and taken off: tare, or products of "
        "columns.",
    )
    rho: Annotated[float, InUnits("kg m-3")] = Field(
        default=1.225, gt=0.0, description="Density, where no column has it."
    )
    wind_off: Annotated[float, InUnits("m s-1")] = Field(
        default=0.5, ge=0.0, description="Airspeed below which a point belongs to the tare."
    )

    @model_validator(mode="after")
    def _known(self) -> BalanceSetup:
        unknown = [name for name in self.nuisance if name not in COEFFICIENTS]
        if unknown:
            raise ValueError(
                f"nuisance: {', '.join(unknown)} unknown; allowed: {', '.join(COEFFICIENTS)}"
            )
        return self


def read_setup(path: str | Path) -> BalanceSetup:
    """Return the setup of a TOML file.

    Raises
    ------
    ParseError
        The text is not TOML.
    SchemaError
        With all faults of the keys.
    """
    return validate_content(BalanceSetup, read_toml(path), str(path))
