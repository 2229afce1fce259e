"""Fuel."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr

    from ..aircraft import Aircraft
    from ..library import Entry


def items(aircraft: Aircraft) -> dict[str, tuple[str, ...]]:
    """Return the items of the groups."""
    return {"fuel": ()}


def row(kind: int, group: str, item: str, name: str, aircraft: Aircraft) -> Entry:
    """Return the catalogue row of a name."""
    raise KeyError(name)


def terms(aircraft: Aircraft) -> Iterator[tuple[str, str, xr.Dataset]]:
    """Return the tables."""
    return iter(())
