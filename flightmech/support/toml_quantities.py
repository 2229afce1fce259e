"""Annotations of quantities in TOML files, for the fields of pydantic models.

A bare number is SI, and a text has its unit.
"""

from __future__ import annotations

from typing import Any

from pydantic_core import PydanticKnownError
from pydantic_core.core_schema import (
    no_info_after_validator_function,
    no_info_before_validator_function,
)

from flightmech.errors import UnitError
from flightmech.quantities import parse_quantity

UNFILLED = "?"
"""Placeholder in a drafted file for a value that the user must give."""
NOT_GIVEN = "not given yet"
"""Beginning of the problem of such a value."""
CONFIRM = "CONFIRM"
"""Word in the comment of a drafted value that the user must confirm."""
UNIT = "x-unit"
"""Key of a JSON schema for the SI unit of a quantity."""


def quantity_schema(units: str) -> dict[str, Any]:
    """Return the JSON schema of a quantity: a number in `units`, or a text with its unit.

    The placeholder `UNFILLED` does not fit the schema.
    """
    return {"type": ["number", "string"], "not": {"const": UNFILLED}, UNIT: units}


class InUnits:
    """Annotation of a number: a bare number is in `units`, a text has its unit (``"40 deg"``).

    Parameters
    ----------
    units : str
        SI unit of the quantity.
    """

    def __init__(self, units: str) -> None:
        self.units = units

    def convert(self, item: Any) -> float:
        """Return a quantity in SI.

        Raises
        ------
        ValueError
            `item` is not a quantity of this kind, or the placeholder `UNFILLED`.
        """
        if item == UNFILLED:
            raise ValueError(
                f"{NOT_GIVEN}; write a number in {self.units}, or a text with its unit"
            )
        try:
            return parse_quantity(item, self.units)
        except (UnitError, TypeError) as error:
            raise ValueError(str(error)) from error

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """Return the schema of pydantic: `convert`, then the schema of a number."""
        return no_info_before_validator_function(self.convert, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        """Return the JSON schema."""
        return quantity_schema(self.units)


class Above:
    """Annotation of a number that is greater than `low`, in SI. It follows `InUnits`."""

    def __init__(self, low: float) -> None:
        self.low = low

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """Return the schema of pydantic."""

        def check(item: float) -> float:
            if not item > self.low:
                raise PydanticKnownError("greater_than", {"gt": self.low})
            return item

        return no_info_after_validator_function(check, handler(source))
