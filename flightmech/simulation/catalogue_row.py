"""Rows of the catalogue of a model, with defaults for what most rows have in common."""

from __future__ import annotations

import sys

from flightmech.names import lookup
from flightmech.simulation.kernel import CatalogueEntry

MOST = sys.float_info.max  # limit of a quantity without a limit


def make_row(
    name: str,
    units: str,
    description: str,
    *,
    display_units: str = "",
    value: float = 0.0,
    low: float = -MOST,
    high: float = MOST,
    flags: float = 0,
) -> CatalogueEntry:
    """Return a row of the catalogue; `display_units` are the units by default.

    `value` is the start value [units]. `flags` combines FIXED, INTEGER and LINEAR of the kernel.
    """
    return CatalogueEntry(
        name=name,
        units=units,
        display_units=display_units or units,
        description=description,
        value=value,
        low=low,
        high=high,
        flags=int(flags),
    )


def make_vocabulary_row(
    name: str, quantity: str, description: str = "", **numbers: float
) -> CatalogueEntry:
    """Return the row of a quantity of the vocabulary; `numbers` as in `make_row`."""
    entry = lookup(quantity)
    if not description:
        description = entry.long_name
        if entry.sign:
            description += f", positive {entry.sign}"
    return make_row(name, entry.units, description, display_units=entry.display_units, **numbers)
