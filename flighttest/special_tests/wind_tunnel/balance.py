"""Setup of a wind-tunnel balance, as a TOML file: reference, position, columns and errors.

[reference]
S = "0.032 m2"
b = "0.40 m"
c = "0.10 m"

[balance]
# phi, theta, psi from body axes to axes of the balance
rotation = ["0 deg", "180 deg", "0 deg"]
# centre from the moment reference point, x forward, y right, z down
offset = ["-0.12 m", "0 m", "0.02 m"]

[columns]
alpha = "alpha [deg]"
V = "speed"
Fx = "fx"

[errors]                                     # common to all points: calibration, not scatter
alpha = "0.1 deg"
V = "0.05 m/s"
Fz = "0.01 N"

[constants]                                  # of all points, for tables of the database
mach = 0.03
delta_f = "0 deg"

[nuisance]                                   # estimated and subtracted
CL = ["tare", "strut"]
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, model_validator

from flightmech.errors import AeromatchError
from flightmech.names import lookup
from flightmech.quantities import parse_quantity
from flightmech.support.toml_files import read_toml
from flightmech.support.toml_models import Strict, validate_content
from flightmech.support.toml_quantities import InUnits

# Forces and moments of the balance, states, and coefficients
FORCES, MOMENTS = ("Fx", "Fy", "Fz"), ("Mx", "My", "Mz")
LOADS = (*FORCES, *MOMENTS)
STATE = {"alpha": "rad", "beta": "rad", "V": "m s-1", "rho": "kg m-3", "qbar": "Pa"}
UNITS = {**STATE, **dict.fromkeys(FORCES, "N"), **dict.fromkeys(MOMENTS, "N m")}
COEFFICIENTS = ("CL", "CD", "CX", "CY", "CZ", "Cl", "Cm", "Cn")


def _errors_in_si(item: Any) -> dict[str, float]:
    if not isinstance(item, dict):
        raise ValueError(
            'a table of measurands and their standard errors is needed, such as { Fz = "0.01 N" }'
        )
    unknown = [str(name) for name in item if name not in UNITS]
    if unknown:
        raise ValueError(f"{', '.join(unknown)}: unknown; allowed: {', '.join(UNITS)}")
    try:
        errors = {str(name): parse_quantity(value, UNITS[name]) for name, value in item.items()}
    except AeromatchError as error:
        raise ValueError(str(error)) from error
    # NaN fails this comparison too
    if any(not value >= 0.0 for value in errors.values()):
        raise ValueError("a standard error is negative")
    return errors


def _constants_in_si(item: Any) -> dict[str, float]:
    if not isinstance(item, dict):
        raise ValueError(
            'a table of quantities is needed, such as { mach = 0.03, delta_f = "0 deg" }'
        )
    constants = {}
    try:
        for name, value in item.items():
            constants[str(name)] = parse_quantity(value, lookup(str(name)).units)
    except AeromatchError as error:
        raise ValueError(str(error)) from error
    return constants


class ReferenceLengths(Strict):
    """Reference lengths of the coefficients."""

    S: Annotated[float, InUnits("m2")] = Field(gt=0.0, description="Reference area.")
    b: Annotated[float, InUnits("m")] = Field(
        gt=0.0, description="Span, of rolling and yawing moment."
    )
    c: Annotated[float, InUnits("m")] = Field(gt=0.0, description="Chord, of the pitching moment.")


class Balance(Strict):
    """Position and axes of the balance in the model."""

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
        description="Whether the balance turns with the model; false for one fixed in the tunnel.",
    )


class BalanceSetup(Strict):
    """Reference, position, columns, errors and nuisance terms of a balance."""

    reference: ReferenceLengths
    balance: Balance = Balance()
    columns: dict[str, str] = Field(
        default_factory=dict,
        description="Measurand to column of the file, with its unit in brackets.",
    )
    errors: Annotated[dict[str, float], BeforeValidator(_errors_in_si)] = Field(
        default_factory=dict, description="Standard errors common to all points."
    )
    constants: Annotated[dict[str, float], BeforeValidator(_constants_in_si)] = Field(
        default_factory=dict,
        description="Quantities that all points have in common, such as the Mach number that "
        "tables depend on.",
    )
    nuisance: dict[str, tuple[str, ...]] = Field(
        default_factory=dict,
        description="Terms per coefficient that are estimated and subtracted: tare, or products of "
        "columns.",
    )
    rho: Annotated[float, InUnits("kg m-3")] = Field(
        default=1.225, gt=0.0, description="Density, if no column has it."
    )
    wind_off: Annotated[float, InUnits("m s-1")] = Field(
        default=0.5, ge=0.0, description="Airspeed below which a point belongs to the tare."
    )

    @model_validator(mode="after")
    def _check_nuisance(self) -> BalanceSetup:
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
        The file is not TOML.
    SchemaError
        All faults of the keys.
    """
    return validate_content(BalanceSetup, read_toml(path), str(path))
