"""Column map of tables of coefficients: what each column of a text file is."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field, field_validator, model_validator

from aerodb.estimators.coefficient_set import FORCES, MOMENTS, EstimateReference
from flightmech.errors import UnitError, near_names
from flightmech.names import lookup
from flightmech.support.toml_files import read_toml
from flightmech.support.toml_models import Strict, validate_content
from flightmech.support.toml_quantities import InUnits
from flightmech.units import to_si

_AXES = ("mach", "alpha", "beta")
_QUANTITY = re.compile(r"([A-Za-z_]\w*)(?:\s*\[([^\]]*)\])?$")
COEFFICIENTS = tuple(dict.fromkeys((*FORCES["stability"], *FORCES["body"], *MOMENTS)))


class MappedQuantity(NamedTuple):
    """Meaning of a column: a variable with its unit, or a coefficient."""

    name: str
    unit: str

    def in_si(self, number: float) -> float:
        """Return a number of the column in SI."""
        return float(to_si(number, self.unit)) if self.unit else number


class ReferenceTable(Strict):
    """Reference quantities of the coefficients."""

    S: Annotated[float, InUnits("m2")] = Field(description="Wing area.")
    cbar: Annotated[float, InUnits("m")] = Field(description="Mean chord.")
    b: Annotated[float, InUnits("m")] = Field(description="Span.")
    x: Annotated[float, InUnits("m")] = Field(description="Moment centre, aft of the origin.")
    z: Annotated[float, InUnits("m")] = Field(default=0.0, description="Moment centre, up.")

    def to_reference(self) -> EstimateReference:
        """Return the reference quantities."""
        return EstimateReference(self.S, self.cbar, self.b, x=self.x, y=0.0, z=self.z)


class ColumnMap(Strict):
    """Columns, layout, axes and reference quantities of tables of coefficients."""

    layout: Literal["runs", "long", "matrix"] = Field(
        description="runs: a column for each coefficient; long: a column with the name of the "
        "coefficient; matrix: one coefficient over rows and columns."
    )
    force_axes: Literal["stability", "body"] = Field(
        description="stability: CL, CD, CY; body: CX forward, CY right, CZ down."
    )
    moment_axes: Literal["stability", "body"] = Field(description="Axes of Cl, Cm, Cn.")
    program: str = Field(default="table", description="Origin of the numbers.")
    reference: ReferenceTable = Field(description="Reference quantities of the coefficients.")
    mach: float | None = Field(default=None, description="Mach number of tables without one.")
    columns: dict[str, str] = Field(
        default={},
        description='Column of the file to its quantity: "alpha [deg]", a coefficient, the name of '
        'a control with its unit, "coefficient" or "value" of the layout long.',
    )
    rows: str | None = Field(default=None, description="Quantity of the first column of a matrix.")
    across: str | None = Field(default=None, description="Quantity of the heading of a matrix.")
    coefficient: str | None = Field(default=None, description="Coefficient of a matrix.")

    @field_validator("columns")
    @classmethod
    def _check_columns(cls, columns: dict[str, str]) -> dict[str, str]:
        for column, text in columns.items():
            try:
                parse_quantity_of_column(text)
            except ValueError as error:
                raise ValueError(f"column {column!r}: {error}") from error
        return columns

    @model_validator(mode="after")
    def _check_layout(self) -> ColumnMap:
        meanings = [parse_quantity_of_column(text).name for text in self.columns.values()]
        if self.layout == "matrix":
            if not (self.rows and self.across and self.coefficient):
                raise ValueError("a matrix needs rows, across and coefficient")
            for text in (self.rows, self.across):
                parse_quantity_of_column(text)
            if self.coefficient not in COEFFICIENTS:
                raise ValueError(_describe_coefficients(self.coefficient))
        elif self.layout == "long" and not {"coefficient", "value"} <= set(meanings):
            raise ValueError('the layout long needs a column "coefficient" and a column "value"')
        elif self.layout == "runs" and not set(meanings) & set(COEFFICIENTS):
            raise ValueError(f"the layout runs needs a column of {', '.join(COEFFICIENTS)}")
        used = set(meanings) | {self.coefficient}
        other = {"stability": {"CX", "CZ"}, "body": {"CL", "CD"}}[self.force_axes] & used
        if other:
            raise ValueError(f"force_axes {self.force_axes!r} with {', '.join(sorted(other))}")
        twice = sorted({name for name in meanings if meanings.count(name) > 1})
        if twice:
            raise ValueError(f"two columns for {', '.join(twice)}")
        return self


def parse_quantity_of_column(text: str) -> MappedQuantity:
    """Return the meaning of a column from a text such as ``alpha [deg]``.

    Raises
    ------
    ValueError
        The text has another form, or an angle has no unit or one that is not of an angle.
    """
    match = _QUANTITY.match(text.strip())
    if not match:
        raise ValueError(f"found {text!r}; expected a name with its unit such as 'alpha [deg]'")
    name, unit = match[1], (match[2] or "").strip()
    if name in (*COEFFICIENTS, "coefficient", "value", "mach"):
        if unit not in ("", "1", "-"):
            raise ValueError(f"{name} has no unit; found {unit!r}")
        return MappedQuantity(name, "")
    if name[0] == "C" and name not in _AXES:
        raise ValueError(_describe_coefficients(name))
    if not unit:
        raise ValueError(f"{name} is an angle or the deflection of a control; give its unit [deg]")
    try:
        to_si(1.0, unit, lookup("alpha").units)
    except UnitError as error:
        raise ValueError(f"{name}: {error}") from error
    return MappedQuantity(name, unit)


def read_column_map(path: str | Path) -> ColumnMap:
    """Return the column map in a TOML file.

    Raises
    ------
    ParseError, SchemaError
        The file is not TOML, or a key or value is not allowed; with all problems.
    """
    content: dict[str, Any] = read_toml(path)
    return validate_content(ColumnMap, content, str(path))


def _describe_coefficients(name: str | None) -> str:
    near = near_names(str(name), COEFFICIENTS, 2)
    hint = f"; near it: {', '.join(near)}" if near else ""
    return f"{name!r} is not a coefficient; allowed: {', '.join(COEFFICIENTS)}{hint}"
