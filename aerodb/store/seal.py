"""Seal of a database file, which is checked before the file is read.

The seal is that of `flightmech.support.hdf5_seal`.
"""

from __future__ import annotations

from pathlib import Path

import h5py

from flightmech.errors import ParseError
from flightmech.support import hdf5_seal as seal
from flightmech.support.file_kinds import file_kind
from flightmech.support.hdf5_seal import SIGNATURE, Unbroken


def read_database_seal(path: Path) -> Unbroken:
    """Return the seal behind the HDF5 content of a database file.

    A file of another program has no seal.

    Raises
    ------
    FileNotFoundError
        The file does not exist.
    ParseError
        The file is not an HDF5 file, or its bytes differ from the sealed ones.
    """
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file; `aeromatch db build` writes a database")
    if not path.is_file() or not _is_hdf5(path):
        raise ParseError(
            str(path),
            0,
            f"no netCDF-4 (HDF5) signature: {file_kind(path)}",
            "a database, as `aeromatch db build` writes it",
        )
    return seal.read_sealed_tail(path, "a database; build or copy it again")


def _is_hdf5(path: Path) -> bool:
    """Return whether a file has the signature of HDF5."""
    with path.open("rb") as file:
        if file.read(len(SIGNATURE)) == SIGNATURE:
            return True
    # The signature may also be further inside the file; h5py searches for it.
    return bool(h5py.is_hdf5(path))
