"""Changing a database: every edit returns a new tree and writes history."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import xarray as xr

from flightmech.errors import UnknownName

from .schema import database, terms


def replace_terms(db: xr.DataTree, new: Mapping[str, xr.Dataset], note: str = "") -> xr.DataTree:
    """Return a database in which terms are put in the place of others, or beside them.

    Parameters
    ----------
    db : DataTree
        The database; it is left as it is.
    new : mapping of str to Dataset
        Terms by name, ``"CL/gear"``; a name the database does not have is added and leaves its list `absent`.
    note : str, optional
        Why, for the history.

    Raises
    ------
    SchemaError
        A term is faulty or its name is not ``<coefficient>/<contribution>``; all faults.
    """
    leaves = terms(db)
    added = [name for name in new if name not in leaves]
    taken = [name for name in new if name in leaves]
    for name, leaf in new.items():
        line = f"replace_terms: {'replaced' if name in leaves else 'added'}{f' ({note})' if note else ''}"
        leaves[name] = leaf.assign_attrs(history=_append(leaf.attrs.get("history", ""), line))
    said = [f"{verb} {' '.join(names)}" for verb, names in (("replaced", taken), ("added", added)) if names]
    absent = [word for word in _absent(db) if word not in new]
    return _rebuilt(db, leaves, absent, f"replace_terms: {', '.join(said) or 'nothing'}{f' ({note})' if note else ''}")


def delete_terms(db: xr.DataTree, names: Iterable[str], note: str = "") -> xr.DataTree:
    """Return a database without some terms; their names go to its list `absent`.

    Raises
    ------
    UnknownName
        A term that the database does not have.
    """
    leaves, gone = terms(db), list(names)
    for name in gone:
        if leaves.pop(name, None) is None:
            raise UnknownName(name, leaves, "term")
    return _rebuilt(db, leaves, [*_absent(db), *gone], f"delete_terms: {' '.join(gone)}{f' ({note})' if note else ''}")


def _absent(db: xr.DataTree) -> list[str]:
    return str(db.attrs.get("absent", "")).split()


def _rebuilt(db: xr.DataTree, leaves: Mapping[str, xr.Dataset], absent: Iterable[str], line: str) -> xr.DataTree:
    attributes = {
        **{str(key): item for key, item in db.attrs.items()},
        "absent": " ".join(dict.fromkeys(absent)),
        "history": _append(db.attrs.get("history", ""), line),
    }
    return database(leaves, **attributes)


def _append(history: str, line: str) -> str:
    return f"{history}\n{line}" if history else line
