"""Undo history: what edits replaced is kept in the file, listed, and restored.

Edit number 7 leaves the group ``/previous/e007`` behind.  It holds every leaf that the edit
replaced or deleted as it was before, the check cases that no longer hold, and in its attributes
what else is needed to undo the edit: the terms that it ``added``, root attributes that it changed
(``was_x_ref``) or that were not there (``unset``), the number of ``lines`` that the history had.
Root attribute ``edits`` counts the edits, also those whose undo entries were dropped.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from aerodb.store.schema import require_valid, terms
from flightmech.errors import OutOfRange, SchemaError, UnknownName
from flightmech.support.netcdf_trees import CHECKS, PREVIOUS

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

COLUMNS = ("edit", "verb", "terms", "note", "text")
_WAS = "was_"
_NAME = re.compile(r"^e\d{3,9}$")


class UndoEntry(NamedTuple):
    """The entry of an edit: its attributes, and the terms that it holds."""

    attrs: Mapping[str, str | int | float]
    terms: list[str]


def record_edit(
    db: xr.DataTree,
    leaves: Mapping[str, xr.Dataset],
    verb: str,
    summary: str,
    note: str = "",
    attributes: Mapping[str, str | float] | None = None,
    lines: Iterable[str] = (),
    **facts: str,
) -> xr.DataTree:
    """Return the database that an edit makes of `db`, with a line of history and an undo entry.

    Parameters
    ----------
    leaves : mapping of str to Dataset
        All terms after the edit.
    verb, summary, note : str
        What was done and why; the line is ``verb: summary (note)``.
    attributes : mapping, optional
        Root attributes that change.
    lines : iterable of str
        Warnings for the history, one line each behind that of the edit: ``warning: ...``.
    **facts : str
        Further attributes of the undo entry.

    Raises
    ------
    SchemaError
        With all faults of the new database.
    """
    import xarray as xr

    before = terms(db)
    replaced = [
        name for name, leaf in leaves.items() if name in before and not leaf.identical(before[name])
    ]
    added = [name for name in leaves if name not in before]
    deleted = [name for name in before if name not in leaves]
    stale = _under(db, CHECKS) if replaced or added or deleted else {}
    number, before_it = _count(db) + 1, _lines(db.attrs)
    warned = [f"warning: {' '.join(line.split())}" for line in lines]
    old = {str(key): item for key, item in db.attrs.items()}
    text = f"{verb}: {summary}{'; check cases set aside' if stale else ''}{note_suffix(note)}"
    new = {
        **old,
        **(attributes or {}),
        "edits": number,
        "history": "\n".join([*before_it, text, *warned]),
    }
    kept: dict[str, str | int | float] = {"verb": verb, "lines": len(before_it)}
    kept |= {
        key: str(item) for key, item in {**facts, "note": " ".join(note.split())}.items() if item
    }
    kept |= {
        key: " ".join(names) for key, names in (("added", added), ("deleted", deleted)) if names
    }
    kept |= {"order": " ".join(before)} if deleted else {}
    kept |= {
        f"{_WAS}{key}": old[key]
        for key in new
        if key in old and key not in ("history", "edits") and old[key] != new[key]
    }
    kept |= {"unset": " ".join(key for key in new if key not in old)} if set(new) - set(old) else {}
    place = f"/{PREVIOUS}/{_group(number)}"
    entry = {
        place: xr.Dataset(attrs=kept),
        **{f"{place}/{name}": before[name] for name in (*replaced, *deleted)},
    }
    entry |= {f"{place}{path}": node for path, node in stale.items()}
    rest = {} if stale else _under(db, CHECKS)
    return _tree(new, leaves, {**rest, **_under(db, PREVIOUS), **entry})


def history(db: xr.DataTree) -> pd.DataFrame:
    """Return the edits of a database, one row per line of its history.

    Returns
    -------
    DataFrame, index ``line``
        ``edit`` (number, for `undo_edits`; None where no undo entry is kept), ``verb``, ``terms``
        (replaced, added or deleted by a kept edit, names separated by blanks), ``note``, ``text``
        (the line).
    """
    import pandas as pd

    entries = {
        name: UndoEntry({str(key): item for key, item in node.attrs.items()}, _held(node))
        for name, node in _entries(db).items()
    }
    rows = edit_rows(db.attrs, entries)
    return pd.DataFrame(
        rows,
        columns=list(COLUMNS),
        index=pd.RangeIndex(1, len(rows) + 1, name="line"),
        dtype=object,
    )


def edit_rows(attributes: Mapping, entries: Mapping[str, UndoEntry]) -> list[tuple]:
    """Return the rows of `history` from root attributes and undo entries by the names of their
    groups, also as they stand in a file.
    """
    kept = {
        int(entry.attrs["lines"]): (number, entry) for number, entry in _numbered(entries).items()
    }
    return [
        _row(text, *kept.get(line, (None, None))) for line, text in enumerate(_lines(attributes))
    ]


def undo_edits(db: xr.DataTree, steps: int = 1, edit: int | None = None) -> xr.DataTree:
    """Return a database as it was before its last edits.

    Parameters
    ----------
    db : DataTree
        The database; it is left as it is.
    steps : int
        Number of edits to undo.
    edit : int, optional
        Undo this edit and all later ones instead; numbers as in `history`.

    Raises
    ------
    UnknownName
        An edit whose undo entry is not kept.
    OutOfRange
        More steps than undo entries are kept, or less than one.
    SchemaError
        A group under ``/previous`` that no edit wrote.
    """
    kept = _kept(db)
    if edit is not None and edit not in kept:
        raise UnknownName(
            str(edit),
            map(str, kept),
            "edit",
            "aerodb.store.history lists the edits that can be undone",
        )
    if edit is None and not 1 <= steps <= len(kept):
        raise OutOfRange(f"{steps} edits cannot be undone; the undo history holds {len(kept)}")
    latest_first = sorted(kept, reverse=True)
    back = (
        latest_first[:steps]
        if edit is None
        else [number for number in latest_first if number >= edit]
    )
    attributes = {str(key): item for key, item in db.attrs.items()}
    leaves, rest = terms(db), _under(db, CHECKS)
    for number in back:
        attributes, leaves, checks = _taken_back(kept[number], attributes, leaves)
        rest = checks or rest
    gone = {_group(number) for number in back}
    remaining = {
        path: node
        for path, node in _under(db, PREVIOUS).items()
        if not gone.intersection(path.split("/")[2:3])
    }
    return _tree(attributes, leaves, {**rest, **(remaining if len(kept) > len(back) else {})})


def drop_undo_history(db: xr.DataTree) -> xr.DataTree:
    """Return a database without its undo history, for a release; the text of its history stays."""
    return _tree({str(key): item for key, item in db.attrs.items()}, terms(db), _under(db, CHECKS))


def last_edit(db: xr.DataTree) -> Mapping[str, str | int | float]:
    """Return what is known of the last edit in the undo history: ``verb``, ``note`` and its facts;
    empty without one.
    """
    kept = _kept(db)
    return {str(key): item for key, item in kept[max(kept)].attrs.items()} if kept else {}


def add_history_line(leaf: xr.Dataset, line: str) -> xr.Dataset:
    """Return a leaf with a further line in its history."""
    known = str(leaf.attrs.get("history", ""))
    return leaf.assign_attrs(history=f"{known}\n{line}" if known else line)


def note_suffix(note: str) -> str:
    """Return the note of a user as the end of a line of history."""
    return f" ({' '.join(note.split())})" if note.split() else ""


def update_absent(
    db: xr.DataTree, without: Iterable[str] = (), more: Iterable[str] = ()
) -> dict[str, str]:
    """Return the root attribute ``absent`` after names left it and others came; empty when it is as
    before.
    """
    old = str(db.attrs.get("absent", ""))
    gone = set(without)
    new = " ".join(dict.fromkeys([*(name for name in old.split() if name not in gone), *more]))
    return {"absent": new} if new != old else {}


def _taken_back(
    group: xr.DataTree, attributes: dict, leaves: dict[str, xr.Dataset]
) -> tuple[dict, dict, dict]:
    """Return root attributes, terms and check cases before an edit; no check cases where it set
    none aside.
    """
    facts = group.attrs
    unset, added = (str(facts.get(key, "")).split() for key in ("unset", "added"))
    old = {key: item for key, item in attributes.items() if key not in unset}
    if "edits" in old:
        old["edits"] = int(old["edits"]) - 1
    old |= {
        str(key).removeprefix(_WAS): item
        for key, item in facts.items()
        if str(key).startswith(_WAS)
    }
    if "history" in old:
        old["history"] = "\n".join(str(old["history"]).split("\n")[: int(facts["lines"])])
    found = _under(group, "")
    checks = {path: node for path, node in found.items() if path.split("/")[1] == CHECKS}
    back = {
        path.strip("/"): node
        for path, node in found.items()
        if path not in checks and node.data_vars
    }
    restored = {name: leaf for name, leaf in {**leaves, **back}.items() if name not in added}
    order = str(facts.get("order", "")).split() or list(restored)
    return old, {name: restored[name] for name in order}, checks


def _row(text: str, number: int | None, entry: UndoEntry | None) -> tuple:
    if entry is None:
        verb, sign, _ = text.partition(":")
        return None, verb if sign and verb.isidentifier() else "", "", "", text
    names = [*entry.terms, *str(entry.attrs.get("added", "")).split()]
    return number, entry.attrs["verb"], " ".join(names), entry.attrs.get("note", ""), text


def _held(group: xr.DataTree) -> list[str]:
    """Return the terms that an undo entry holds."""
    return [
        path.strip("/")
        for path, node in _under(group, "").items()
        if node.data_vars and path.split("/")[1] != CHECKS
    ]


def _kept(db: xr.DataTree) -> dict[int, xr.DataTree]:
    """Return the undo entries by number of their edit."""
    return _numbered(_entries(db))


def _entries(db: xr.DataTree) -> dict[str, xr.DataTree]:
    return (
        {str(name): node for name, node in db[PREVIOUS].children.items()}
        if PREVIOUS in db.children
        else {}
    )


def _numbered(entries: Mapping[str, Any]) -> dict[int, Any]:
    """Return undo entries by number of their edit; a group that no edit wrote is an error."""
    foreign = [
        name
        for name, entry in entries.items()
        if not (_NAME.match(name) and {"verb", "lines"} <= set(entry.attrs))
    ]
    if foreign:
        raise SchemaError(
            PREVIOUS,
            [
                f"/{PREVIOUS}/{name} is not the undo entry of an edit; aerodb.store.forget "
                f"drops all of them"
                for name in foreign
            ],
        )
    return {int(name[1:]): entry for name, entry in entries.items()}


def _group(number: int) -> str:
    return f"e{number:03d}"


def _count(db: xr.DataTree) -> int:
    return max([int(db.attrs.get("edits", 0)), *_kept(db)])


def _lines(attributes: Mapping) -> list[str]:
    return str(attributes["history"]).split("\n") if attributes.get("history") else []


def _under(db: xr.DataTree, child: str) -> dict[str, xr.Dataset]:
    """Return the nodes of a group by path from `db`, ``/checks/...``; all below `db` for an empty
    name.
    """
    if child and child not in db.children:
        return {}
    top = db[child] if child else db
    nodes = {f"/{node.relative_to(db)}": node.to_dataset(inherit=False) for node in top.subtree}
    return {path: node for path, node in nodes.items() if path != "/."}


def _tree(
    attributes: Mapping, leaves: Mapping[str, xr.Dataset], rest: Mapping[str, xr.Dataset]
) -> xr.DataTree:
    import xarray as xr

    nodes = {
        "/": xr.Dataset(attrs=dict(attributes)),
        **{f"/{name}": leaf for name, leaf in leaves.items()},
        **rest,
    }
    tree = xr.DataTree.from_dict(nodes)
    require_valid(tree)
    return tree
