"""Edits of whole terms: replaced or deleted, chosen by name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from fnmatch import fnmatchcase

import xarray as xr

from aerodb.edit.breakpoint_edits import extend as extend  # importable from here as well
from aerodb.edit.breakpoint_edits import regrid as regrid
from aerodb.edit.breakpoint_edits import regrid_error as regrid_error
from aerodb.store.schema import terms
from aerodb.store.undo_history import add_history_line, note_suffix, record_edit, update_absent
from aerodb.update.cautions.notices import with_notices
from flightmech.errors import SchemaError, UnknownName
from flightmech.flown_samples import FLOWN_SAMPLES, with_flown_samples
from flightmech.flown_states import FLOWN_STATES


def replace_terms(db: xr.DataTree, new: Mapping[str, xr.Dataset], note: str = "") -> xr.DataTree:
    """Return a database in which terms are replaced or added.

    Parameters
    ----------
    db : DataTree
        The database; it does not change.
    new : mapping of str to Dataset
        Terms by name, such as ``"CL/gear"``.  A new name is added to the database and removed from
        its list of absent terms.  The ``notices`` of a `Tabulation` become lines of the history
        and the root attribute ``notices``.
    note : str, optional
        Reason for the change; stored in the history.

    Raises
    ------
    SchemaError
        A term is faulty or its name is not ``<coefficient>/<contribution>``; all faults.  Or `new`
        is a database: `aerodb.terms` gives its terms.
    """
    nodes = [new] if isinstance(new, xr.DataTree) else new.values()
    if any(isinstance(item, xr.DataTree) for item in nodes):
        raise SchemaError(
            "replace_terms",
            [
                "a database or a node of it came as the new terms; give data sets by name: "
                "aerodb.terms(other) has all of another database"
            ],
        )
    leaves = terms(db)
    changes: dict[str, list[str]] = {"replaced": [], "added": []}
    for name, leaf in new.items():
        verb = "added"
        if name in leaves:
            verb = "replaced"
        changes[verb].append(name)
        leaves[name] = add_history_line(leaf, f"replace_terms: {verb}{note_suffix(note)}")
    summary = [f"{verb} {' '.join(names)}" for verb, names in changes.items() if names]
    # Only a `Tabulation` has notices.
    notices = list(getattr(new, "notices", ()))
    flown = {
        FLOWN_SAMPLES: getattr(new, "flown_samples", ""),
        FLOWN_STATES: getattr(new, "flown_states", ""),
    }
    attributes = {
        **update_absent(db, without=new),
        **with_notices(db.attrs, notices),
        **with_flown_samples(db.attrs, flown),
    }
    return record_edit(
        db,
        leaves,
        "replace_terms",
        summary=", ".join(summary) or "nothing",
        note=note,
        attributes=attributes,
        lines=notices,
    )


def delete_terms(db: xr.DataTree, names: str | Iterable[str], note: str = "") -> xr.DataTree:
    """Return a database without some terms, whose names go to its list of absent terms.

    Parameters
    ----------
    db : DataTree
        The database; it does not change.
    names : str or iterable of str
        Terms, or patterns such as ``"*/speedbrake"``.
    note : str, optional
        Reason, such as "could not be identified"; stored in the history.

    Raises
    ------
    UnknownName
        A term that the database does not have.
    SchemaError
        No term would be left.
    """
    deleted = match_names(db, names)
    leaves = {name: leaf for name, leaf in terms(db).items() if name not in deleted}
    return record_edit(
        db,
        leaves,
        "delete_terms",
        summary=" ".join(deleted),
        note=note,
        attributes=update_absent(db, more=deleted),
    )


def match_names(db: xr.DataTree, names: str | Iterable[str]) -> list[str]:
    """Return the names of the terms that match names or patterns such as ``"Cm/*"``.

    Raises
    ------
    UnknownName
        A name or pattern does not match any term.
    """
    leaves = list(terms(db))
    if isinstance(names, str):
        names = [names]
    matched: dict[str, None] = {}
    for name in names:
        matches = [leaf for leaf in leaves if fnmatchcase(leaf, name)]
        if not matches:
            raise UnknownName(name, leaves, "term")
        matched |= dict.fromkeys(matches)
    return list(matched)
