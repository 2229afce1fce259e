"""Databases on disk: netCDF-4 that plain HDF5 readers open, written atomically (completely or not
at all), sealed against damage.
"""

from __future__ import annotations

import hashlib
import io
import os
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py

from aerodb.store.lean_reading import read_edits, read_leaves
from aerodb.store.overview import OVERVIEW, SHOWN, STATED, describe_terms
from aerodb.store.schema import check, terms
from aerodb.store.seal import read_database_seal
from aerodb.store.undo_history import edit_rows, history
from flightmech.errors import ParseError, SchemaError
from flightmech.names import COEFFICIENTS
from flightmech.support.atomic_write import written_atomically
from flightmech.support.hdf5_seal import Unbroken, add_seal
from flightmech.support.input_files import file_kind
from flightmech.support.netcdf_trees import (
    CHECKS,
    GROUPS,
    StoredGroup,
    encode_tree,
    find_unstorable,
    read_netcdf_tree,
)

if TYPE_CHECKING:
    import xarray as xr


def save(db: xr.DataTree, path: str | os.PathLike) -> None:
    """Check a database, run the check cases it carries, and write it to a netCDF-4 file.

    Parameters
    ----------
    db : DataTree
        The database.
    path : path
        The file; an older one is replaced in one step once the new one is complete on disk.

    Raises
    ------
    SchemaError
        With all faults, or the file is another one than this process read or wrote last: somebody
        else saved it meanwhile.  Nothing is written then.
    OSError
        The disk is full, say; the older file stays as it was.
    """

    problems = check(db) + find_unstorable(db)
    problems += [] if problems else _failing_checks(db)
    if problems:
        raise SchemaError(f"database {db.attrs.get('title', '')!r}", list(dict.fromkeys(problems)))
    content = encode_tree(db)
    content = add_seal(content, OVERVIEW, _overview(content))
    with written_atomically(path, _demand_as_read) as part:
        part.write_bytes(content)
    _known[_key(path)] = _digest(content)


def open(path: str | os.PathLike) -> xr.DataTree:
    """Read a database from a file, whole into memory, check it, and run the check cases it carries.

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
    digest = read_database_seal(path).digest
    _demand_database(path)
    try:
        db, problems = read_netcdf_tree(path)
    except SchemaError as error:
        raise SchemaError(str(path), error.problems) from None
    except (
        Exception
    ) as error:  # a damaged file makes HDF5 raise OSError, KeyError, RuntimeError, ValueError ...
        raise ParseError(
            str(path),
            0,
            f"a damaged file ({type(error).__name__}: {error})",
            "a database; build or copy it again",
        ) from error
    problems += check(db)
    problems += [] if problems else _failing_checks(db)
    if problems:
        raise SchemaError(str(path), list(dict.fromkeys(problems)))
    _known[_key(path)] = digest
    return db


def read_overview(
    path: str | os.PathLike,
    variables: Collection[str],
    attributes: Collection[str] | None = None,
    whole: Unbroken | None = None,
    names: Collection[str] | None = None,
) -> tuple[Mapping, Mapping[str, xr.Dataset | StoredGroup]]:
    """Return the root attributes and the terms of a database for a look at it, errors as `open`.

    The seal stands for the checks that the file passed when it was saved: of a sealed file the
    given variables and attributes of each term are read, with the breakpoints of their axes, and no
    Dataset is made.  A file of another program, or one with faults, is opened. `whole` is what
    `unbroken` found where the seal has been checked already.  Of `names`, where they are given, the
    other terms of a sealed file are left out.
    """
    path = Path(path)
    leaves = (
        read_leaves(path, variables, attributes, GROUPS, names)
        if (whole or read_database_seal(path)).sealed
        else None
    )
    if leaves is None:
        db = open(path)
        return db.attrs, terms(db)
    return leaves.pop("").attrs, leaves


def list_terms(
    path: str | os.PathLike, whole: Unbroken
) -> tuple[Mapping[str, Any], list[dict[str, Any]]]:
    """Return the root attributes of a database and a row per term, as
    `aerodb.store.overview.describe_database` gives them; errors as `open`.
    """
    attributes, leaves = read_overview(path, SHOWN, STATED, whole)
    return attributes, describe_terms(leaves)


def list_edits(path: str | os.PathLike) -> list[tuple]:
    """Return the rows of `aerodb.store.undo_history.history`, of a sealed file without reading its
    tables; errors as `open`.
    """

    path = Path(path)
    found = read_edits(path) if read_database_seal(path).sealed else None
    return (
        edit_rows(*found) if found else list(history(open(path)).itertuples(index=False, name=None))
    )


def _overview(content: bytes) -> tuple[Mapping[str, Any], list[dict[str, Any]]] | None:
    """Return what `list_terms` makes of the content of a file."""
    leaves = read_leaves(io.BytesIO(content), SHOWN, STATED, GROUPS)
    return None if leaves is None else (leaves.pop("").attrs, describe_terms(leaves))


_known: dict[str, bytes] = {}  # file -> digest of what this process read or wrote there last


def _key(path: str | os.PathLike) -> str:
    return os.path.realpath(path)


def _digest(content: bytes) -> bytes:
    return hashlib.sha256(content).digest()


def _demand_as_read(path: Path) -> None:
    """Raise when a file that is about to be replaced is not the one that was read: another editor's
    work would be lost.
    """
    known = _known.get(_key(path))
    if known is not None and path.exists() and _digest(path.read_bytes()) != known:
        text = (
            "was saved by another program after it was read here; open it again and repeat "
            "the edit, or save under another name"
        )
        raise SchemaError(str(path), [text])


def _demand_database(path: Path) -> None:
    """Raise one sentence on a file of ours of another kind, where a list of all that it lacks would
    hide what it is.
    """
    try:
        with h5py.File(path) as file:
            groups, about = set(file), set(file.attrs)
    except OSError:
        return  # damaged: `read_netcdf_tree` states how
    if about & {"force_axes", "cbar"} or groups & set(COEFFICIENTS):
        return
    kind = file_kind(path)
    if kind.startswith(("a reconstructed", "a flight record")):
        raise SchemaError(str(path), [f"{kind}, no aero database"])


def _failing_checks(db: xr.DataTree) -> list[str]:
    """Return which of the check cases that travel with a database fail; most carry none."""
    if CHECKS not in db.children:
        return []
    from aerodb.store.evaluation import failing_checks

    return failing_checks(db)
