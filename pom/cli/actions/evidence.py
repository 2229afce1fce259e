"""The database of the option ``--evidence``: identified from flight, or refused."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

import aerodb
from flightmech.errors import SchemaError
from pom.judging.beyond_the_bands import nodes_from_flight


def open_evidence(file: str | Path) -> xr.DataTree:
    """Return the database of an option ``--evidence``.

    Raises
    ------
    SchemaError
        No node of the database is from flight, so that it is not evidence.
    """
    database = aerodb.open(file)
    if not any(nodes_from_flight(leaf).any() for leaf in aerodb.terms(database).values()):
        text = (
            f"{Path(file).name}: no node of its tables is from flight, so it is not evidence; give "
            f"the database that a match identified, such as final.nc of aeromatch match"
        )
        raise SchemaError("--evidence", [text])
    return database
