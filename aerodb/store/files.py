"""Database files: netCDF-4, written atomically and sealed against damage.

Plain HDF5 readers can open them.  A file is written completely or not at all.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from aerodb.store.overview import OVERVIEW, describe_database
from aerodb.store.schema import check, find_leaf, terms
from aerodb.store.seal import read_database_seal
from flightmech.errors import ParseError, SchemaError
from flightmech.names import COEFFICIENTS
from flightmech.support.array_files.netcdf_trees import (
    CHECKS,
    encode_tree,
    find_unstorable,
    read_netcdf_tree,
)
from flightmech.support.atomic_write import written_atomically
from flightmech.support.file_kinds import file_kind
from flightmech.support.hdf5_seal import add_seal

if TYPE_CHECKING:
    import xarray as xr


def save(db: xr.DataTree, path: str | os.PathLike[str]) -> None:
    """Check a database, run its check cases, and write it to a netCDF-4 file.

    Parameters
    ----------
    db : DataTree
        The database.
    path : path
        The file.  An older file is replaced in one step when the new one is complete on disk.

    Raises
    ------
    SchemaError
        The database has faults (all of them), or another program saved the file after this process
        read or wrote it.  Nothing is written.
    OSError
        An error of the operating system, such as a full disk; the older file does not change.
    """
    problems = check(db) + find_unstorable(db)
    if not problems:
        problems = _failing_checks(db)
    if problems:
        raise SchemaError(f"database {db.attrs.get('title', '')!r}", list(dict.fromkeys(problems)))
    # The overview is stored behind the seal, so that listing the terms does not read the tables.
    content = add_seal(encode_tree(db), OVERVIEW, _make_overview(db))
    with written_atomically(path, _demand_as_read) as part:
        part.write_bytes(content)
    _digests[_file_key(path)] = _digest_of(content)


def open(path: str | os.PathLike[str]) -> xr.DataTree:
    """Read a database from a file into memory, check it, and run its check cases.

    Raises
    ------
    FileNotFoundError
        The file does not exist.
    ParseError
        The file is not a netCDF-4 file, or it is damaged.
    SchemaError
        A netCDF file that is not a database, or a database with faults; all of them.
    """
    path = Path(path)
    digest = read_database_seal(path).digest
    _demand_database(path)
    # Faults of the layout and of the content are reported together.
    try:
        db, problems = read_netcdf_tree(path)
    except SchemaError as error:
        raise SchemaError(str(path), error.problems) from None
    except Exception as error:
        # A damaged file makes HDF5 raise OSError, KeyError, RuntimeError, ValueError and others.
        raise ParseError(
            str(path),
            0,
            f"a damaged file ({type(error).__name__}: {error})",
            "a database; build or copy it again",
        ) from error
    problems += check(db)
    if not problems:
        problems = _failing_checks(db)
    if problems:
        raise SchemaError(str(path), list(dict.fromkeys(problems)))
    _digests[_file_key(path)] = digest
    return db


def open_term(path: str | os.PathLike[str], name: str) -> xr.Dataset:
    """Read one term of a database, such as ``"CL/basic"``.

    The seal replaces the checks: the file passed them when it was saved. Of a sealed file only the
    term is read. A file without a seal is opened with `open`.

    Raises
    ------
    FileNotFoundError, ParseError, SchemaError
        As in `open`.
    UnknownName
        The database does not have the term.
    """
    path = Path(path)
    if read_database_seal(path).sealed:
        db, problems = read_netcdf_tree(path, only=name)
        leaves = terms(db)
        if name in leaves and not problems:
            return leaves[name]
    return find_leaf(open(path), name)


def _make_overview(db: xr.DataTree) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return root attributes and the rows of `describe_database` in types of JSON."""
    attributes = {}
    for key, item in db.attrs.items():
        attributes[str(key)] = item.item() if isinstance(item, np.generic) else item
    return attributes, describe_database(db)


# Digest of the content that this process read or wrote last, by file.
_digests: dict[str, bytes] = {}


def _file_key(path: str | os.PathLike[str]) -> str:
    return os.path.realpath(path)


def _digest_of(content: bytes) -> bytes:
    return hashlib.sha256(content).digest()


def _demand_as_read(path: Path) -> None:
    """Raise if another program changed the file after this process read it.

    Its changes would be lost.
    """
    digest = _digests.get(_file_key(path))
    if digest is None or not path.exists():
        return
    if _digest_of(path.read_bytes()) != digest:
        text = (
            "was saved by another program after it was read here; open it again and repeat "
            "the edit, or save under another name"
        )
        raise SchemaError(str(path), [text])


def _demand_database(path: Path) -> None:
    """Raise `SchemaError` if the file is of another kind of this product.

    The list of all missing parts of a database would hide the kind of the file.
    """
    try:
        with h5py.File(path) as file:
            groups, attributes = set(file), set(file.attrs)
    except Exception:
        return  # a damaged file: `read_netcdf_tree` states the damage
    # A database, perhaps with faults: the general check reports them.
    if attributes & {"force_axes", "cbar"} or groups & set(COEFFICIENTS):
        return
    kind = file_kind(path)
    if kind.startswith(("a reconstructed", "a flight record")):
        raise SchemaError(str(path), [f"{kind}, no aero database"])


def _failing_checks(db: xr.DataTree) -> list[str]:
    """Return the failing check cases of a database; most databases have none."""
    if CHECKS not in db.children:
        return []
    # Deferred: databases without check cases do not need the evaluation.
    from aerodb.store.evaluation import failing_checks

    return failing_checks(db)
