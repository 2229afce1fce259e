"""Terms put in, taken out and chosen by name: every edit returns a new tree, writes history and keeps what it replaced."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from fnmatch import fnmatchcase

import xarray as xr

from flightmech.errors import UnknownName

from ..store.schema import terms
from ..store.undo_history import absent, noted, recorded, remark
from ..update.cautions.notices import with_notices


def replace_terms(db: xr.DataTree, new: Mapping[str, xr.Dataset], note: str = "") -> xr.DataTree:
    """Return a database in which terms are replaced or added.

    Parameters
    ----------
    db : DataTree
        The database; it is left as it is.
    new : mapping of str to Dataset
        Terms by name, ``"CL/gear"``; a name the database does not have is added and leaves its list `absent`.  The ``notices`` of a
        `Tabulation` become lines of the history and the root attribute ``notices``.
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
    lines = {name: f"replace_terms: {'replaced' if name in leaves else 'added'}{remark(note)}" for name in new}
    summary = [f"{verb} {' '.join(names)}" for verb, names in (("replaced", taken), ("added", added)) if names]
    leaves |= {name: noted(leaf, lines[name]) for name, leaf in new.items()}
    notices = list(getattr(new, "notices", ()))
    attributes = {**absent(db, without=new), **with_notices(db.attrs, notices)}
    return recorded(db, leaves, "replace_terms", ", ".join(summary) or "nothing", note, attributes, lines=notices)


def delete_terms(db: xr.DataTree, names: str | Iterable[str], note: str = "") -> xr.DataTree:
    """Return a database without some terms; their names go to its list `absent`.

    Parameters
    ----------
    db : DataTree
        The database; it is left as it is.
    names : str or iterable of str
        Terms, or patterns such as ``"*/speedbrake"``.
    note : str, optional
        Why, such as "could not be identified".

    Raises
    ------
    UnknownName
        A term that the database does not have.
    SchemaError
        No term would be left.
    """
    gone = matching(db, names)
    leaves = {name: leaf for name, leaf in terms(db).items() if name not in gone}
    return recorded(db, leaves, "delete_terms", " ".join(gone), note, absent(db, more=gone))


def matching(db: xr.DataTree, names: str | Iterable[str]) -> list[str]:
    """Return the names of the terms that a name, a pattern such as ``"Cm/*"``, or several of them mean.

    Raises
    ------
    UnknownName
        One of them means no term.
    """
    leaves = list(terms(db))
    found: dict[str, None] = {}
    for name in [names] if isinstance(names, str) else names:
        meant = [leaf for leaf in leaves if fnmatchcase(leaf, name)]
        if not meant:
            raise UnknownName(name, leaves, "term")
        found |= dict.fromkeys(meant)
    return list(found)
