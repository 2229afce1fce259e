"""Databases on disk: netCDF-4 that plain HDF5 readers open, written whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

import h5py
import xarray as xr

from flightmech.errors import ParseError, SchemaError
from flightmech.whole import written_whole

from .schema import check, require


def save(db: xr.DataTree, path: str | os.PathLike) -> None:
    """Check a database and write it to a netCDF-4 file.

    Parameters
    ----------
    db : DataTree
        The database.
    path : path
        The file; an older one is replaced in one step once the new one is complete on disk.

    Raises
    ------
    SchemaError
        With all faults; nothing is written then.
    """
    require(db)
    with written_whole(path) as part:
        db.to_netcdf(part, engine="h5netcdf", mode="w")


def open(path: str | os.PathLike) -> xr.DataTree:
    """Read a database from a file, whole into memory, and check it.

    Raises
    ------
    FileNotFoundError
        No such file.
    ParseError
        Not a netCDF-4 file, or a damaged one.
    SchemaError
        A netCDF file that is not a database, or one with faults; all of them.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file; `aeromatch db build` writes a database")
    if not path.is_file() or not h5py.is_hdf5(path):
        raise ParseError(str(path), 0, "no netCDF-4 (HDF5) signature", "a database as aerodb.save writes it; build or copy the file again")
    try:
        with xr.open_datatree(path, engine="h5netcdf", decode_timedelta=False) as tree:
            db = tree.load()
    except Exception as error:  # a damaged file makes HDF5 raise OSError, KeyError, RuntimeError, ValueError ...
        raise ParseError(str(path), 0, f"a damaged file ({type(error).__name__}: {error})", "a database; build or copy it again") from error
    problems = check(db)
    if problems:
        raise SchemaError(str(path), problems)
    return db
