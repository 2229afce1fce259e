"""A simulation model from its two files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import ParseError, SchemaError
from ..support.file_kinds import file_kind
from ..support.input_files.seal import unbroken_if_sealed
from ..support.input_files.self_contained import demand_self_contained

if TYPE_CHECKING:
    import xarray as xr

    from .compiler import SimModel


def compile_files(aircraft: str, database: str) -> SimModel:
    """Return the model of an aircraft file (TOML) and a database file (netCDF)."""
    from ..aircraft.aircraft import read_aircraft
    from .compiler import compile as compile_model

    return compile_model(read_aircraft(aircraft), _open(database))


def _open(database: str) -> xr.DataTree:
    """Return the tree of a database file; `aerodb`, which writes it, stands to the right of this package."""
    from ..support.input_files.tree_files import read

    demand_self_contained(database)
    unbroken_if_sealed(Path(database), "a database; build or copy it again")
    try:
        tree, problems = read(Path(database))
    except SchemaError as error:
        raise SchemaError(database, error.problems) from None
    except Exception as error:  # a damaged file makes HDF5 raise OSError, KeyError, RuntimeError, ValueError ...
        raise ParseError(database, 0, file_kind(database), "an aero database, netCDF-4 as `aeromatch db build` writes it") from error
    if problems:
        raise SchemaError(database, problems)
    return tree
