"""Type of the engines of an aircraft: whether one set of tables belongs to all of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields

from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.engine import Engine, list_leaves
from flightmech.errors import IdentificationError


def check_one_type(aircraft: Aircraft) -> None:
    """Check that the tables and constants of all engines are those of the first one.

    Place, direction and rotation may differ.

    Raises
    ------
    IdentificationError
        They differ.
    """
    first = aircraft.engines[0]
    for number, engine in enumerate(aircraft.engines[1:], 2):
        different = sorted(
            {*_differing_tables(first, engine), *_differing_constants(first, engine)}
        )
        if different:
            raise IdentificationError(
                f"engine {number} differs from engine 1 in {', '.join(different)}; the records "
                f"correct one set of tables for all engines, so that their propellers and engines "
                f"must be of one type (only position, direction and rotation may differ)"
            )


def _differing_tables(one: Engine, other: Engine) -> Iterator[str]:
    """Yield the names of tables that two engines do not share."""
    tables, others = list_leaves(one), list_leaves(other)
    yield from set(tables) ^ set(others)
    for name in set(tables) & set(others):
        if not tables[name]["value"].equals(others[name]["value"]):
            yield name


def _differing_constants(one: Engine, other: Engine) -> Iterator[str]:
    """Yield the names of parts and of their constants that two engines do not share."""
    for name in ("propeller", "piston", "deck", "motor"):
        part, like = getattr(one, name), getattr(other, name)
        if (part is None) != (like is None):
            yield name
        elif part is not None:
            for field in fields(part):
                value = getattr(part, field.name)
                if field.name in ("rotation", "tables") or not isinstance(value, (int, float)):
                    continue
                if value != getattr(like, field.name):
                    yield f"{name}.{field.name}"
