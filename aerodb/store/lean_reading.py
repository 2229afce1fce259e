"""Fast reader of a few variables of each term of a database file.

It reads only the requested objects, with the low-level interface of HDF5: the classes of h5py are
slower.  It supports the layout of `flightmech.support.netcdf_trees.encode_tree` only.  A file with
another layout is read by `read_netcdf_tree` of the same module, which reports its faults.
"""

from __future__ import annotations

import io
import math
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from h5py import h5a, h5d, h5ds, h5g, h5o, h5s, h5t

from aerodb.store.undo_history import UndoEntry
from flightmech.support.hdf5_seal import find_false_scale
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
_TABLES = ("value", "K1", "K2")  # variables of a term with their own axes


def read_leaves(
    source: Path | io.BytesIO,
    variables: Collection[str],
    attributes: Collection[str] | None,
    without: Collection[str],
    names: Collection[str] | None = None,
) -> dict[str, StoredGroup] | None:
    """Return the terms of a file by name, and its root by the name ``""``.

    The result is None if the file has another layout.

    Parameters
    ----------
    source : path or file in memory
        HDF5 file.
    variables : collection of str
        Variables of a term to read, if it has them, with the breakpoints of their axes.
    attributes : collection of str or None
        Attributes of a term to read, if it has them; None for all.  All attributes of the root are
        read.
    without : collection of str
        Groups at the root that are not read.
    names : collection of str, optional
        Terms to read, such as ``"CL/basic"``; the default is all.
    """
    with h5py.File(source, "r") as file:
        try:
            root = h5o.open(file.id, b"/")
            leaves = {"": StoredGroup({}, _read_attributes(root, None))}
            for name, term in _iterate_terms(root, without):
                if names is None or name in names:
                    tables = _read_variables(term, variables)
                    if tables:
                        leaves[name] = StoredGroup(tables, _read_attributes(term, attributes))
        except _ERRORS:
            return None
    return leaves


def read_edits(source: Path) -> tuple[dict[str, Any], dict[str, UndoEntry]] | None:
    """Return the root attributes of a file and its undo entries by the names of their groups.

    The result is None if the file has another layout.
    """
    with h5py.File(source, "r") as file:
        try:
            root = h5o.open(file.id, b"/")
            entries = {}
            if PREVIOUS in _list_members(root):
                previous = _open_group(root, PREVIOUS)
                for name in _list_members(previous):
                    group = _open_group(previous, name)
                    entries[name] = UndoEntry(_read_attributes(group, None), _list_terms(group))
            return _read_attributes(root, None), entries
        except _ERRORS:
            return None


def _iterate_terms(
    above: h5g.GroupID, without: Collection[str]
) -> Iterator[tuple[str, h5g.GroupID]]:
    """Yield name and group of every term in the groups of coefficients."""
    for coefficient in _list_members(above):
        if coefficient in without:
            continue
        group = _open_group(above, coefficient)
        for contribution in _list_members(group):
            yield f"{coefficient}/{contribution}", _open_group(group, contribution)


def _list_terms(entry: h5g.GroupID) -> list[str]:
    """Return the names of the terms in an undo entry."""
    names = []
    for name, term in _iterate_terms(entry, (CHECKS,)):
        if "value" in _list_members(term):
            names.append(name)
    return names


class _OtherLayout(Exception):
    """A layout that `encode_tree` does not write."""


_ERRORS = (_OtherLayout, RuntimeError, OSError, KeyError, TypeError, ValueError)


def _list_members(group: h5g.GroupID) -> list[str]:
    """Return the names in a group in the order in which they were written."""
    # The order of creation is the order of the terms in the database.
    links: list[tuple[bytes, int]] = []
    group.links.iterate(
        lambda name, link: links.append((name, link.type)),
        idx_type=h5py.h5.INDEX_CRT_ORDER,
        info=True,
    )
    names = []
    for name, kind in links:
        if kind != h5py.h5l.TYPE_HARD:
            raise _OtherLayout
        names.append(name.decode())
    return names


def _open_group(above: h5g.GroupID, name: str) -> h5g.GroupID:
    """Return a group below another one; raise if the name is not a group."""
    item = h5o.open(above, name.encode())
    if not isinstance(item, h5g.GroupID):
        raise _OtherLayout
    return item


def _read_variables(term: h5g.GroupID, requested: Collection[str]) -> dict[str, StoredVariable]:
    """Return variables of a term with the breakpoints of their axes.

    A standard error and a source have the axes of the value.
    """
    variables: dict[str, StoredVariable] = {}
    present = set(_list_members(term)) & set(requested)
    # Tables with their own axes come first; the others need the axes of the value.
    for name in sorted(present, key=_TABLES.__contains__, reverse=True):
        table = h5o.open(term, name.encode())
        numbers = _read_numbers(table)
        if name in _TABLES:
            axes = _read_axes(table, numbers.ndim, variables)
        elif "value" not in variables or numbers.shape != variables["value"].values.shape:
            raise _OtherLayout
        else:
            axes = variables["value"].dims
        variables[name] = StoredVariable(axes, numbers, {})
    return variables


def _read_axes(
    table: h5d.DatasetID, count: int, variables: dict[str, StoredVariable]
) -> tuple[str, ...]:
    """Return the names of the axes of a table, and add their breakpoints to the variables."""
    axes = []
    if find_false_scale(table):
        raise _OtherLayout
    for number in range(count):
        axis = h5ds.iterate(table, number, lambda scale: _read_axis(scale, variables))
        axes.append(axis or "")
    return tuple(axes)


def _read_axis(scale: h5d.DatasetID, variables: dict[str, StoredVariable]) -> str:
    """Return the axis of a dimension scale, and add its breakpoints to the variables."""
    if find_false_scale(scale):
        raise _OtherLayout
    name = h5ds.get_scale_name(scale).decode()
    if name not in variables:
        variables[name] = StoredVariable((name,), _read_numbers(scale), {})
    return name


def _read_numbers(table: h5d.DatasetID) -> np.ndarray:
    """Return the numbers of a dataset, converted to float by HDF5.

    Numbers outside the file, packed numbers and very large tables are another layout.
    """
    shape = table.get_space().get_simple_extent_dims()
    if table.get_offset() is None or 8 * math.prod(shape) > LARGEST:
        raise _OtherLayout
    if any(h5a.exists(table, key) for key in _PACKED):
        raise _OtherLayout
    # HDF5 converts integers and single precision while it reads.
    numbers = np.empty(shape)
    table.read(h5s.ALL, h5s.ALL, numbers, h5t.NATIVE_DOUBLE)
    return numbers


def _read_attributes(
    owner: h5g.GroupID, requested: Collection[str] | None
) -> dict[str, str | int | float]:
    """Return the attributes of a group in the order of the file; None requests all."""
    names: list[bytes] = []
    h5a.iterate(owner, names.append, index_type=h5py.h5.INDEX_CRT_ORDER)
    attributes = {}
    for name in map(bytes.decode, names):
        if name not in LAYOUT and (requested is None or name in requested):
            attributes[name] = _read_attribute(owner, name)
    return attributes


def _read_attribute(owner: h5g.GroupID, name: str) -> Any:
    """Return an attribute as text or number; raise `ValueError` if it has several items."""
    # The attribute is read with its type in the file: text is bytes of fixed length.
    attribute = h5a.open(owner, name.encode())
    array = np.empty(attribute.shape, attribute.dtype)
    attribute.read(array)
    item = array.item()
    if isinstance(item, bytes):
        return item.decode()
    return item
