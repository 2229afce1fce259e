"""A look at a database file: a few variables of each term, as they stand in the file.

The objects of HDF5 itself are read, and only those that are wanted: the classes of h5py above them
take three times as long, which was a third of ``aeromatch db show``.  Whatever is laid out
otherwise than `flightmech.support.netcdf_trees.encode_tree` does is left to `read` there, which states
what is wrong with it.
"""

from __future__ import annotations

import io
import math
from collections.abc import Collection
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from h5py import h5a, h5d, h5ds, h5g, h5o, h5s, h5t

from aerodb.store.undo_history import UndoEntry
from flightmech.support.netcdf_trees import (
    CHECKS,
    LARGEST,
    LAYOUT,
    PACKED,
    PREVIOUS,
    StoredGroup,
    StoredVariable,
)

_PACKED = [name.encode() for name in PACKED]
_TABLES = ("value", "K1", "K2")  # of a term, each over axes of its own


def read_leaves(
    source: Path | io.BytesIO,
    variables: Collection[str],
    attributes: Collection[str] | None,
    without: Collection[str],
    names: Collection[str] | None = None,
) -> dict[str, StoredGroup] | None:
    """Return the terms of a file by name, ``"CL/basic"``, and its root by the name ``""``; None
    when it is laid out otherwise.

    Parameters
    ----------
    source : path or file in memory
        Of HDF5.
    variables : collection of str
        Variables of a term to read, where it has them; the breakpoints of their axes come with
        them.
    attributes : collection of str or None
        Attributes of a term to read, where it has them; all for None.  Those of the root are all
        read.
    without : collection of str
        Groups at the root that are left out.
    names : collection of str, optional
        Terms to read; all unless given.
    """
    with h5py.File(source, "r") as file:
        try:
            root = h5o.open(file.id, b"/")
            found = {"": StoredGroup({}, _attributes(root, None))}
            for coefficient in _members(root):
                if coefficient not in without:
                    group = _group(root, coefficient)
                    for contribution in _members(group):
                        name = f"{coefficient}/{contribution}"
                        if names is None or name in names:
                            term = _group(group, contribution)
                            if tables := _variables(term, variables):
                                found[name] = StoredGroup(tables, _attributes(term, attributes))
        except _ERRORS:
            return None
    return found


def read_edits(source: Path) -> tuple[dict[str, Any], dict[str, UndoEntry]] | None:
    """Return the root attributes of a file and the undo entries by the names of their groups; None
    when it is laid out otherwise.
    """
    with h5py.File(source, "r") as file:
        try:
            root = h5o.open(file.id, b"/")
            top = _group(root, PREVIOUS) if PREVIOUS in _members(root) else None
            groups = {name: _group(top, name) for name in _members(top)} if top is not None else {}
            return _attributes(root, None), {
                name: UndoEntry(_attributes(group, None), _terms(group))
                for name, group in groups.items()
            }
        except _ERRORS:
            return None


def _terms(entry: h5g.GroupID) -> list[str]:
    """Return the names of the terms that an undo entry holds."""
    found = []
    for coefficient in _members(entry):
        if coefficient != CHECKS:
            group = _group(entry, coefficient)
            found += [
                f"{coefficient}/{contribution}"
                for contribution in _members(group)
                if "value" in _members(_group(group, contribution))
            ]
    return found


class _OtherLayout(Exception):
    """Something that `image` does not write."""


_ERRORS = (_OtherLayout, RuntimeError, OSError, KeyError, TypeError, ValueError)


def _members(group: h5g.GroupID) -> list[str]:
    """Return the names in a group in the order in which they were written."""
    links: list[tuple[bytes, int]] = []
    group.links.iterate(
        lambda name, link: links.append((name, link.type)),
        idx_type=h5py.h5.INDEX_CRT_ORDER,
        info=True,
    )
    if any(kind != h5py.h5l.TYPE_HARD for _, kind in links):
        raise _OtherLayout
    return [name.decode() for name, _ in links]


def _group(above: h5g.GroupID, name: str) -> h5g.GroupID:
    item = h5o.open(above, name.encode())
    if not isinstance(item, h5g.GroupID):
        raise _OtherLayout
    return item


def _variables(term: h5g.GroupID, wanted: Collection[str]) -> dict[str, StoredVariable]:
    """Return variables with the breakpoints of their axes; a standard error and a source stand over
    the axes of the value.
    """
    found: dict[str, StoredVariable] = {}
    for name in sorted(set(_members(term)) & set(wanted), key=_TABLES.__contains__, reverse=True):
        table = h5o.open(term, name.encode())
        numbers = _numbers(table)
        if name in _TABLES:
            axes = tuple(
                h5ds.iterate(table, number, lambda scale: _axis(scale, found)) or ""
                for number in range(numbers.ndim)
            )
        elif "value" not in found or numbers.shape != found["value"].values.shape:
            raise _OtherLayout
        else:
            axes = found["value"].dims
        found[name] = StoredVariable(axes, numbers, {})
    return found


def _axis(scale: h5d.DatasetID, found: dict[str, StoredVariable]) -> str:
    """Return the name of the axis that a dimension scale holds, and keep its breakpoints."""
    name = h5ds.get_scale_name(scale).decode()
    if name not in found:
        found[name] = StoredVariable((name,), _numbers(scale), {})
    return name


def _numbers(table: h5d.DatasetID) -> np.ndarray:
    """Return the numbers of a dataset, which HDF5 converts, if they are any; those that stand
    elsewhere have no place in the file.
    """
    shape = table.get_space().get_simple_extent_dims()
    if (
        table.get_offset() is None
        or 8 * math.prod(shape) > LARGEST
        or any(h5a.exists(table, key) for key in _PACKED)
    ):
        raise _OtherLayout
    numbers = np.empty(shape)
    table.read(h5s.ALL, h5s.ALL, numbers, h5t.NATIVE_DOUBLE)
    return numbers


def _attributes(owner: h5g.GroupID, wanted: Collection[str] | None) -> dict[str, str | int | float]:
    names: list[bytes] = []
    h5a.iterate(owner, names.append, index_type=h5py.h5.INDEX_CRT_ORDER)
    texts = [name.decode() for name in names]
    return {
        name: _attribute(owner, name)
        for name in texts
        if name not in LAYOUT and (wanted is None or name in wanted)
    }


def _attribute(owner: h5g.GroupID, name: str) -> Any:
    attribute = h5a.open(owner, name.encode())
    item = np.empty(attribute.shape, attribute.dtype)
    attribute.read(item)
    plain = item.item()  # of one item, else ValueError
    return plain.decode() if isinstance(plain, bytes) else plain
