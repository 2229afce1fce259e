"""What the tables of an engine depend on, as a TOML file.

height = "h_gps"                       # channel of the height
throttle = [0.0, 0.5, 1.0]             # knots of the schedule; without them, where the lever rested
n2 = [0.6, 0.7, 0.8, 0.9, 1.0]         # knots of time constants and limits
limits = true                          # rate limits for acceleration and deceleration
fan = "lever"                          # n1 follows the lever, not n2
over = { h = ["0 ft", "20000 ft"] }    # with which schedule and dynamics change
thrust_scale = 0.015                   # standard error of the factor of the recorded thrust

[tables.corrected_thrust]              # from whole flights
corrected_n2 = [0.6, 0.8, 1.0, 1.1]
mach = [0.0, 0.3, 0.5]
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema

from flightmech.errors import AeromatchError
from flightmech.names import lookup
from flightmech.support.configuration import Strict, file_schema, validate
from flightmech.support.toml_files.content import load
from flightmech.support.toml_files.quantities import quantity_schema
from flightmech.units import quantity


def _breakpoints(item: Any) -> dict[str, tuple[float, ...]]:
    """Breakpoints in SI units by their axis."""
    if not isinstance(item, dict):
        raise ValueError('a table of axes and their breakpoints is needed, such as { h = ["0 ft", "20000 ft"] }')
    try:
        found = {str(axis): tuple(quantity(point, lookup(str(axis)).units) for point in points) for axis, points in item.items()}
    except (AeromatchError, TypeError) as error:
        raise ValueError(str(error)) from error
    for axis, points in found.items():
        if len(points) < 2 or any(b <= a for a, b in pairwise(points)):
            raise ValueError(f"{axis} = {list(points)}: at least two breakpoints, rising, are needed")
    return found


Breakpoints = Annotated[
    dict[str, tuple[float, ...]],
    BeforeValidator(_breakpoints),
    WithJsonSchema({"type": "object", "additionalProperties": {"type": "array", "minItems": 2, "items": quantity_schema("of the axis")}}),
]


class EngineStructure(Strict):
    """Keywords of `identify_engine`, and the channel of the height.

    Attributes
    ----------
    height : str or None
        As for `engine_channels`.
    throttle, n2, limits, fan, over
        As for `identify_spools`.
    tables, thrust_scale
        As for `identify_engine`.
    """

    height: str | None = Field(default=None, description="Channel of the height; without it the first of h, h_baro and h_gps.")
    throttle: tuple[float, ...] | None = Field(
        default=None, description="Breakpoints of the schedule over the lever; without them where the lever rested."
    )
    n2: tuple[float, ...] | None = Field(
        default=None, description="Breakpoints of time constants and limits over the speed of the gas generator."
    )
    limits: bool = Field(default=False, description="Whether acceleration and deceleration have rate limits.")
    fan: Literal["n2", "lever"] = Field(default="n2", description="What the fan speed follows: n2, or the lever.")
    over: Breakpoints = Field(default_factory=dict, description="Axes with which schedule and dynamics change, and their breakpoints.")
    tables: dict[str, Breakpoints] = Field(
        default_factory=dict,
        examples=[{"corrected_thrust": {"corrected_n2": [0.6, 0.8, 1.0]}}],
        description="Tables that whole flights identify: axes and breakpoints of each.",
    )
    thrust_scale: float = Field(default=0.0, ge=0.0, description="Standard error of the factor of the recorded thrust.")

    def keywords(self) -> dict[str, Any]:
        """Return the keywords of `identify_engine`."""
        return {name: value for name, value in self if name != "height"}


def read_structure(path: str | Path) -> EngineStructure:
    """Return the structure of a TOML file.

    Raises
    ------
    ParseError
        The text is not TOML.
    SchemaError
        With all faults of the keys.
    """
    return validate(EngineStructure, load(path), str(path))


def structure_schema() -> dict[str, Any]:
    """Return the JSON schema of such files."""
    return file_schema(EngineStructure, "What the tables of an engine depend on, for the identification of the engine.")
