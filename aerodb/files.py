"""Databases on disk: netCDF-4 that plain HDF5 readers open, written whole or not at all."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import h5py
import xarray as xr

from flightmech.errors import ParseError

from .schema import require


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
    path = Path(path)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
    os.close(handle)
    try:
        db.to_netcdf(name, engine="h5netcdf", mode="w")
        with os.fdopen(os.open(name, os.O_RDONLY), "rb") as written:
            os.fsync(written.fileno())
        os.chmod(name, 0o666 & ~_umask())
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


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
    require(db)
    return db


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
