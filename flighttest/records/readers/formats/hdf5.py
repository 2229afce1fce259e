"""HDF5 files: netCDF-4, MATLAB v7.3 and plain HDF5; every group with a clock is a table, and only
the columns requested are read.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from h5py import AttributeManager, Dataset, h5a, h5d, h5g, h5o, h5s

from flightmech.errors import ParseError
from flightmech.support.hdf5_seal import demand_self_contained
from flighttest.records.readers.formats.nested import Array, Group, as_one_array, nested_tables
from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.recording import Recording, decoding_errors

_SINCE = re.compile(r"^(seconds|second|sec|secs|s|milliseconds|ms|minutes|min|hours|h) since (.+)$")
_DEPTH = 20


def read(path: Path, names: NameMap) -> Recording:
    """Return the groups of an HDF5 file as tables.

    Raises
    ------
    ParseError
        The file is damaged, or holds no numbers over a clock.
    """
    demand_self_contained(path)
    with decoding_errors(path, "a whole HDF5, netCDF-4 or MATLAB v7.3 file"):
        file = h5py.File(path, "r")
        facts = {
            str(key): _plain(value) for key, value in file.attrs.items() if not key.startswith("_")
        }
        root = _group(file.id, str(path), facts, 0)
        found, left_out = nested_tables(root, names)
    if not found:
        raise ParseError(
            str(path), 0, "no array of numbers", "a recording: arrays next to their stamps"
        )
    with path.open("rb") as stream:
        matlab = stream.read(16).startswith(b"MATLAB")
    facts = {key: value for key, value in facts.items() if isinstance(value, str | int | float)}
    return Recording("matlab73" if matlab else "hdf5", found, facts, left_out=tuple(left_out))


def _group(place: h5py.h5g.GroupID, path: str, facts: dict[str, Any], depth: int) -> Group:
    """Return the arrays of a group; the objects of HDF5 itself are opened, for those of h5py take
    six times as long.
    """
    text = _stated(
        place, "flags", _stated(place, "marks", "")
    )  # marks: former name of the attribute
    found = Group(flags=text if isinstance(text, str) else "")
    if depth > _DEPTH:
        raise ParseError(
            path, 0, f"groups inside each other more than {_DEPTH} deep", "a recording"
        )
    for key in place:
        name = key.decode("utf-8", "surrogateescape")
        if name.startswith("#"):
            continue  # what MATLAB refers to from elsewhere
        item = h5o.open(place, key)
        if isinstance(item, h5g.GroupID):
            inner = _group(item, path, facts, depth + 1)
            array = as_one_array(inner, _texts(item))
            if array is not None:
                found.arrays[name] = array
            else:
                found.groups[name] = inner
        elif isinstance(item, h5d.DatasetID):
            content = _array(item, path, facts)
            if isinstance(content, Array):
                found.arrays[name] = content
            elif content:
                found.left_out[name] = content
    return found


def _stated(item: h5py.h5d.DatasetID | h5py.h5g.GroupID, name: str, default: Any = None) -> Any:
    """Return an attribute as a Python text or number where it is one."""
    return _plain(_attribute(item, name, default))


def _attribute(item: h5py.h5d.DatasetID | h5py.h5g.GroupID, name: str, default: Any) -> Any:
    """Return an attribute as h5py gives it; one that is a number, an array of them or a text is
    read in half the time.
    """
    key = name.encode()
    if not h5a.exists(item, key):
        return default
    attribute = h5a.open(item, key)
    kind, shape = attribute.dtype, attribute.shape
    text = h5py.check_string_dtype(kind)
    if (
        shape is None
        or kind.subdtype is not None
        or (kind.kind not in "fiu" and (text is None or text.length is not None or shape))
    ):
        owner: Any = Dataset(item) if isinstance(item, h5d.DatasetID) else h5py.Group(item)
        return AttributeManager(owner)[name]
    found = np.empty(shape, kind)
    attribute.read(found)
    return found if text is None else bytes(found[()]).decode("utf-8", "surrogateescape")


def _array(item: h5py.h5d.DatasetID, path: str, facts: dict[str, Any]) -> Array | str | None:
    """Return a dataset as an array; what it is where it is none, and None for what holds no values."""
    kind = _stated(item, "MATLAB_class", "")
    if kind in ("char", "cell", "struct", "function_handle"):
        return {"char": "text", "cell": "a cell array", "struct": "an empty structure"}.get(
            kind, "a function"
        )
    if item.dtype.kind not in "fiub":
        return _no_numbers(item)
    if _stated(item, "MATLAB_empty", 0) or item.shape is None:
        return "an empty array"
    if str(_stated(item, "NAME", "")).startswith(
        "This is a netCDF dimension but not a netCDF variable"
    ):
        return None
    unit = _stated(item, "units", _stated(item, "unit", ""))
    unit = unit if isinstance(unit, str) and unit else None
    since = _SINCE.match(unit) if unit else None
    if since:
        facts.setdefault("start", since.group(2).strip().replace(" ", "T", 1))
        unit = (
            {"m": "min", "h": "h"}.get(since.group(1)[0], "s")
            if not since.group(1).startswith(("ms", "milli"))
            else "ms"
        )
    error = _stated(item, "stderr")
    known = isinstance(error, float) and math.isfinite(error)
    return Array(tuple(item.shape), lambda: _values(item, path), unit, error if known else None)


def _no_numbers(item: h5py.h5d.DatasetID) -> str | None:
    """Return what the values of a dataset are that are no numbers; None for a reference of HDF5
    itself.
    """
    if h5py.check_string_dtype(item.dtype) is not None or item.dtype.kind in "SU":
        return "text"
    if h5py.check_ref_dtype(item.dtype) is not None:
        return None
    if item.dtype.names:
        return (
            f"rows of several fields ({', '.join(item.dtype.names[:6])}); write each field as "
            f"an array"
        )
    return "values that are no numbers"


def _values(item: h5py.h5d.DatasetID, path: str) -> np.ndarray:
    """Return the values of a dataset with the packing of the CF conventions undone."""
    with decoding_errors(path, "a whole HDF5, netCDF-4 or MATLAB v7.3 file"):
        raw = _read(item)
        scale, offset = (
            float(np.ravel(_attribute(item, key, default))[0])
            for key, default in (("scale_factor", 1.0), ("add_offset", 0.0))
        )
        values = np.asarray(raw, float)
        if scale != 1.0 or offset != 0.0:
            values = values * scale + offset
        for key in ("_FillValue", "missing_value"):
            empty = np.ravel(_attribute(item, key, np.nan))[0]
            if empty == empty:
                values = np.where(raw == empty, np.nan, values)
        return values


def _read(item: h5py.h5d.DatasetID) -> np.ndarray:
    """Return the numbers of a dataset as they are stored; the object of h5py takes three times as
    long to read a short one.
    """
    if item.dtype.kind == "b" or not all(item.shape):
        return Dataset(item)[()]
    found = np.empty(item.shape, item.dtype)
    item.read(h5s.ALL, h5s.ALL, found)
    return found


def _texts(group: h5py.h5g.GroupID) -> dict[str, str]:
    """Return the text members of a MATLAB structure."""
    found = {}
    for name in ("units", "unit", "description"):
        item = h5o.open(group, name.encode()) if name.encode() in group else None
        if isinstance(item, h5d.DatasetID) and _stated(item, "MATLAB_class", "") == "char":
            found[name] = (
                ""
                if _stated(item, "MATLAB_empty", 0)
                else "".join(map(chr, np.ravel(Dataset(item)[()], order="F")))
            )
    return found


def _plain(value: Any) -> Any:
    """Return an attribute as a Python text or number where it is one."""
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    if isinstance(value, np.ndarray) and value.size == 1:
        return _plain(value.ravel()[0])
    return value.item() if isinstance(value, np.generic) else value
