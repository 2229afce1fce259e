"""A simulation model from its two files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..errors import ParseError
from ..support.file_kinds import file_kind
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
    import xarray as xr

    demand_self_contained(database)
    try:
        with xr.open_datatree(database, engine="h5netcdf") as tree:
            return tree.load()
    except (OSError, ValueError) as error:
        raise ParseError(database, 0, file_kind(database), "an aero database, netCDF-4 as `aeromatch db build` writes it") from error
