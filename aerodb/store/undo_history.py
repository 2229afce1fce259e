"""Undo history of a database: replaced terms stay in the file, are listed and can be restored.

Edit number 7 writes the group ``/previous/e007``.  It holds every leaf that the edit replaced or
deleted, as it was before, and the check cases that are no longer valid.  Its attributes hold the
other facts that undo needs: the terms that the edit ``added``, root attributes that it changed
(``was_x_ref``) or that did not exist (``unset``), and the number of ``lines`` that the history had.
Root attribute ``edits`` counts the edits, also those whose undo entries were dropped.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from aerodb.store.schema import require_valid, terms
from flightmech.errors import OutOfRange, SchemaError, UnknownName
from flightmech.support.array_files.netcdf_trees import CHECKS, PREVIOUS

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

COLUMNS = ("edit", "verb", "terms", "note", "text")
_WAS = "was_"
_NAME = re.compile(r"^e\d{3,9}$")


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
    """Return the database after an edit, with a line of history and an undo entry.

    Parameters
    ----------
    db : DataTree
        The database before the edit.
    leaves : mapping of str to Dataset
        All terms after the edit.
    verb, summary, note : str
        The change and its reason; the line of history is ``verb: summary (note)``.
    attributes : mapping, optional
        Root attributes that change.
    lines : iterable of str
        Warnings for the history, one line each after that of the edit: ``warning: ...``.
    **facts : str
        Further attributes of the undo entry.

    Raises
    ------
    SchemaError
        The new database is not valid; all faults.
    """
    import xarray as xr

    before = terms(db)
    changes = _compare_terms(before, leaves)
    # Check cases hold for the terms before the edit only.
    stale = {}
    if changes.replaced or changes.added or changes.deleted:
        stale = _nodes_under(db, CHECKS)
    # The text of the history: one line of the edit, one of each warning.
    number, old_lines = _count_edits(db) + 1, _history_lines(db.attrs)
    suffix = note_suffix(note)
    if stale:
        suffix = f"; check cases set aside{suffix}"
    new_lines = [f"{verb}: {summary}{suffix}"]
    new_lines += [f"warning: {' '.join(line.split())}" for line in lines]
    old = _root_attributes(db)
    new = {
        **old,
        **(attributes or {}),
        "edits": number,
        "history": "\n".join([*old_lines, *new_lines]),
    }
    facts = {**facts, "note": " ".join(note.split())}
    undo = _undo_attributes(verb, len(old_lines), facts=facts, changes=changes, order=before)
    undo |= _earlier_attributes(old, new)
    root = f"/{PREVIOUS}/{_group_name(number)}"
    # Groups of the new file behind the terms: valid check cases, older entries, the new entry.
    other_nodes = _nodes_under(db, PREVIOUS)
    if not stale:
        other_nodes = {**_nodes_under(db, CHECKS), **other_nodes}
    other_nodes[root] = xr.Dataset(attrs=undo)
    for name in (*changes.replaced, *changes.deleted):
        other_nodes[f"{root}/{name}"] = before[name]
    for path, node in stale.items():
        other_nodes[f"{root}{path}"] = node
    return _make_tree(new, leaves, other_nodes)


def _undo_attributes(
    verb: str,
    lines: int,
    *,
    facts: Mapping[str, str],
    changes: _TermChanges,
    order: Iterable[str],
) -> dict[str, str | int | float]:
    """Return the attributes of an undo entry without those of the root of the database."""
    undo: dict[str, str | int | float] = {"verb": verb, "lines": lines}
    for key, item in facts.items():
        if item:
            undo[key] = str(item)
    if changes.added:
        undo["added"] = " ".join(changes.added)
    if changes.deleted:
        undo["deleted"] = " ".join(changes.deleted)
        # Undo restores the order of the terms, which a deleted term has lost.
        undo["order"] = " ".join(order)
    return undo


class _TermChanges(NamedTuple):
    """Names of the terms that an edit replaces, adds and deletes."""

    replaced: list[str]
    added: list[str]
    deleted: list[str]


def _compare_terms(
    before: Mapping[str, xr.Dataset], after: Mapping[str, xr.Dataset]
) -> _TermChanges:
    """Return the names of the terms that differ between two databases."""
    replaced, added = [], []
    for name, leaf in after.items():
        if name not in before:
            added.append(name)
        elif not leaf.identical(before[name]):
            replaced.append(name)
    return _TermChanges(replaced, added, [name for name in before if name not in after])


def _earlier_attributes(
    old: Mapping[str, Any], new: Mapping[str, Any]
) -> dict[str, str | int | float]:
    """Return the root attributes before an edit, as attributes of its undo entry."""
    undo: dict[str, str | int | float] = {}
    unset = []
    for key, item in new.items():
        if key not in old:
            unset.append(key)
        elif key not in ("history", "edits") and old[key] != item:
            undo[f"{_WAS}{key}"] = old[key]
    if unset:
        undo["unset"] = " ".join(unset)
    return undo


def history(db: xr.DataTree) -> pd.DataFrame:
    """Return the edits of a database, one row per line of its history.

    Returns
    -------
    DataFrame, index ``line``
        ``edit`` (number, for `undo_edits`; None without an undo entry), ``verb``, ``terms``
        (replaced, added or deleted by an edit with an undo entry, names separated by blanks),
        ``note``, ``text`` (the line).
    """
    import pandas as pd

    rows = edit_rows(db)
    index = pd.RangeIndex(1, len(rows) + 1, name="line")
    return pd.DataFrame(rows, columns=list(COLUMNS), index=index, dtype=object)


def edit_rows(db: xr.DataTree) -> list[tuple[Any, ...]]:
    """Return the rows of `history` as tuples of `COLUMNS`."""
    # The attribute ``lines`` of an entry is the index of the line of its edit.
    by_line = {}
    for number, entry in _by_number(_undo_groups(db)).items():
        by_line[int(entry.attrs["lines"])] = number, entry
    rows = []
    for line, text in enumerate(_history_lines(db.attrs)):
        if line in by_line:
            rows.append(_entry_row(text, *by_line[line]))
        else:
            rows.append(_text_row(text))
    return rows


def undo_edits(db: xr.DataTree, steps: int = 1, edit: int | None = None) -> xr.DataTree:
    """Return a database as it was before its last edits.

    Parameters
    ----------
    db : DataTree
        The database; it does not change.
    steps : int
        Number of edits to undo.
    edit : int, optional
        Undo this edit and all later ones, in place of `steps`; numbers as in `history`.

    Raises
    ------
    UnknownName
        An edit without an undo entry.
    OutOfRange
        More steps than undo entries, or less than one.
    SchemaError
        A group under ``/previous`` that no edit wrote.
    """
    entries = _by_number(_undo_groups(db))
    if edit is not None and edit not in entries:
        hint = "aerodb.store.history lists the edits that can be undone"
        raise UnknownName(str(edit), map(str, entries), "edit", hint)
    if edit is None and not 1 <= steps <= len(entries):
        raise OutOfRange(f"{steps} edits cannot be undone; the undo history holds {len(entries)}")
    latest_first = sorted(entries, reverse=True)
    if edit is None:
        undone = latest_first[:steps]
    else:
        undone = [number for number in latest_first if number >= edit]
    # Step by step backwards, because each entry holds only the changes of its own edit.
    attributes, leaves = _root_attributes(db), terms(db)
    checks = _nodes_under(db, CHECKS)
    for number in undone:
        attributes, leaves, earlier_checks = _undo_edit(entries[number], attributes, leaves)
        checks = earlier_checks or checks
    other_nodes = dict(checks)
    # Without remaining entries the group /previous itself is left out as well.
    if len(entries) > len(undone):
        groups = {_group_name(number) for number in undone}
        for path, node in _nodes_under(db, PREVIOUS).items():
            if not groups.intersection(path.split("/")[2:3]):
                other_nodes[path] = node
    return _make_tree(attributes, leaves, other_nodes)


def drop_undo_history(db: xr.DataTree) -> xr.DataTree:
    """Return a database without its undo history, for a release; the history lines remain."""
    return _make_tree(_root_attributes(db), terms(db), _nodes_under(db, CHECKS))


def last_edit(db: xr.DataTree) -> Mapping[str, str | int | float]:
    """Return the attributes of the last undo entry: ``verb``, ``note`` and its facts.

    The mapping is empty without an entry.
    """
    entries = _by_number(_undo_groups(db))
    if not entries:
        return {}
    return _root_attributes(entries[max(entries)])


def add_history_line(leaf: xr.Dataset, line: str) -> xr.Dataset:
    """Return a leaf with a further line in its history."""
    old = str(leaf.attrs.get("history", ""))
    if old:
        line = f"{old}\n{line}"
    return leaf.assign_attrs(history=line)


def note_suffix(note: str) -> str:
    """Return the note of a user as the end of a line of history, such as `` (note)``."""
    text = " ".join(note.split())
    if not text:
        return ""
    return f" ({text})"


def update_absent(
    db: xr.DataTree, without: Iterable[str] = (), more: Iterable[str] = ()
) -> dict[str, str]:
    """Return the root attribute ``absent`` without some names and with further ones.

    The result is empty if the attribute does not change.
    """
    old = str(db.attrs.get("absent", ""))
    removed = set(without)
    remaining = [name for name in old.split() if name not in removed]
    new = " ".join(dict.fromkeys([*remaining, *more]))
    if new == old:
        return {}
    return {"absent": new}


def _undo_edit(
    entry: xr.DataTree, attributes: Mapping[str, Any], leaves: Mapping[str, xr.Dataset]
) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """Return root attributes, terms and check cases before an edit.

    The check cases are empty if the edit did not set any aside.
    """
    facts = entry.attrs
    unset, added = str(facts.get("unset", "")).split(), str(facts.get("added", "")).split()
    old = {key: item for key, item in attributes.items() if key not in unset}
    if "edits" in old:
        old["edits"] = int(old["edits"]) - 1
    for key, item in facts.items():
        if str(key).startswith(_WAS):
            old[str(key).removeprefix(_WAS)] = item
    # The lines of the edit are the last ones of its history.
    if "history" in old:
        old["history"] = "\n".join(str(old["history"]).split("\n")[: int(facts["lines"])])
    restored, checks = dict(leaves), {}
    for path, node in _nodes_under(entry, "").items():
        if path.split("/")[1] == CHECKS:
            checks[path] = node
        elif node.data_vars:
            restored[path.strip("/")] = node
    # Terms that the edit added are not in the order and disappear.  A deleted term returns to its
    # position in the order of the tree.
    order = str(facts.get("order", "")).split()
    if not order:
        order = [name for name in restored if name not in added]
    return old, {name: restored[name] for name in order}, checks


def _entry_row(text: str, number: int, entry: xr.DataTree) -> tuple[Any, ...]:
    """Return the row of `history` of an edit with an undo entry."""
    names = [*_stored_terms(entry), *str(entry.attrs.get("added", "")).split()]
    return number, entry.attrs["verb"], " ".join(names), entry.attrs.get("note", ""), text


def _text_row(text: str) -> tuple[Any, ...]:
    """Return the row of `history` of a line without an undo entry; its verb is before the colon."""
    verb, colon, _ = text.partition(":")
    if not colon or not verb.isidentifier():
        verb = ""
    return None, verb, "", "", text


def _stored_terms(entry: xr.DataTree) -> list[str]:
    """Return the names of the terms in an undo entry."""
    names = []
    for path, node in _nodes_under(entry, "").items():
        if node.data_vars and path.split("/")[1] != CHECKS:
            names.append(path.strip("/"))
    return names


def _undo_groups(db: xr.DataTree) -> dict[str, xr.DataTree]:
    """Return the groups of the undo entries by name."""
    if PREVIOUS not in db.children:
        return {}
    return {str(name): node for name, node in db[PREVIOUS].children.items()}


def _by_number(entries: Mapping[str, Any]) -> dict[int, Any]:
    """Return undo entries by the number of their edit; raise for groups that no edit wrote."""
    numbered, problems = {}, []
    for name, entry in entries.items():
        if _NAME.match(name) and {"verb", "lines"} <= set(entry.attrs):
            numbered[int(name[1:])] = entry
        else:
            problems.append(
                f"/{PREVIOUS}/{name} is not the undo entry of an edit; aerodb.store.forget "
                f"drops all of them"
            )
    if problems:
        raise SchemaError(PREVIOUS, problems)
    return numbered


def _group_name(number: int) -> str:
    """Return the name of the group of an edit, such as ``e007``."""
    return f"e{number:03d}"


def _count_edits(db: xr.DataTree) -> int:
    """Return the number of the last edit, 0 without one."""
    # The attribute also counts edits without an entry; older files may lack it.
    return max([int(db.attrs.get("edits", 0)), *_by_number(_undo_groups(db))])


def _history_lines(attributes: Mapping[Any, Any]) -> list[str]:
    """Return the lines of the history of a database."""
    text = attributes.get("history")
    if not text:
        return []
    return str(text).split("\n")


def _root_attributes(db: xr.DataTree) -> dict[str, Any]:
    """Return the attributes of a node by name."""
    return {str(key): item for key, item in db.attrs.items()}


def _nodes_under(db: xr.DataTree, child: str) -> dict[str, xr.Dataset]:
    """Return the nodes of a child group by path from `db`, such as ``/checks/...``.

    An empty name returns all nodes below `db`.
    """
    if child and child not in db.children:
        return {}
    top = db
    if child:
        top = db.children[child]
    nodes = {}
    for node in top.subtree:
        path = f"/{node.relative_to(db)}"
        if path != "/.":
            nodes[path] = node.to_dataset(inherit=False)
    return nodes


def _make_tree(
    attributes: Mapping[str, Any],
    leaves: Mapping[str, xr.Dataset],
    other_nodes: Mapping[str, xr.Dataset],
) -> xr.DataTree:
    """Return a checked database of root attributes, terms and other groups by path."""
    import xarray as xr

    nodes = {"/": xr.Dataset(attrs=dict(attributes))}
    for name, leaf in leaves.items():
        nodes[f"/{name}"] = leaf
    nodes.update(other_nodes)
    tree = xr.DataTree.from_dict(nodes)
    require_valid(tree)
    return tree
