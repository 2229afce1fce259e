"""The seal of a database file, checked before anything reads it; see
`flightmech.support.hdf5_seal`.
"""

from __future__ import annotations

from pathlib import Path

from flightmech.errors import ParseError
from flightmech.support import hdf5_seal as seal
from flightmech.support.hdf5_seal import SIGNATURE, Unbroken
from flightmech.support.input_files import file_kind


def read_database_seal(path: Path) -> Unbroken:
    """Return what a database file has behind its HDF5 content, which must be sealed, or nothing: a
    file of another program.

    Raises
    ------
    FileNotFoundError
        No such file.
    ParseError
        It is no HDF5 file, or its bytes are not those that were sealed.
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
    with path.open("rb") as file:
        if file.read(len(SIGNATURE)) == SIGNATURE:
            return True
    import h5py  # HDF5 looks for its signature further on too

    return bool(h5py.is_hdf5(path))
