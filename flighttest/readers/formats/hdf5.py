"""HDF5 files: netCDF-4, MATLAB v7.3 and plain HDF5; every group with a clock is a table, and only the columns requested are read."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from flightmech.errors import ParseError
from flightmech.support.input_files.self_contained import demand_self_contained

from ..name_map import NameMap
from ..recording import Recording, guarded
from .nested import Array, Group, tables

_SINCE = re.compile(r"^(seconds|second|sec|secs|s|milliseconds|ms|minutes|min|hours|h) since (.+)$")
_DEPTH = 20


def read(path: Path, names: NameMap) -> Recording:
    """Return the groups of an HDF5 file as tables.

    Raises
    ------
    ParseError
        The file is damaged, or holds no numbers over a clock.
    """
    import h5py

    demand_self_contained(path)
    with guarded(path, "a whole HDF5, netCDF-4 or MATLAB v7.3 file"):
        file = h5py.File(path, "r")
        facts = {str(key): _plain(value) for key, value in file.attrs.items() if not key.startswith("_")}
        root = _group(file, file, str(path), facts, 0)
        found = tables(root, names)
    if not found:
        raise ParseError(str(path), 0, "no array of numbers", "a recording: arrays next to their stamps")
    with path.open("rb") as file:
        matlab = file.read(16).startswith(b"MATLAB")
    facts = {key: value for key, value in facts.items() if isinstance(value, str | int | float)}
    return Recording("matlab73" if matlab else "hdf5", found, facts)


def _group(group, file, path: str, facts: dict[str, Any], depth: int) -> Group:
    import h5py

    text = _plain(group.attrs.get("flags", group.attrs.get("marks", "")))  # marks: former name of the attribute
    found = Group(flags=text if isinstance(text, str) else "")
    if depth > _DEPTH:
        raise ParseError(path, 0, f"groups inside each other more than {_DEPTH} deep", "a recording")
    for name in group:
        if name.startswith("#"):
            continue  # what MATLAB refers to from elsewhere
        item = group.get(name)
        if isinstance(item, h5py.Group):
            inner = _group(item, file, path, facts, depth + 1)
            array = as_one_array(inner, _texts(item))
            if array is not None:
                found.arrays[name] = array
            else:
                found.groups[name] = inner
        elif isinstance(item, h5py.Dataset):
            array = _array(item, path, facts)
            if array is not None:
                found.arrays[name] = array
    return found


def _array(item, path: str, facts: dict[str, Any]) -> Array | None:
    if item.dtype.kind not in "fiu" and item.dtype.kind != "b":
        return None
    kind = _plain(item.attrs.get("MATLAB_class", ""))
    if kind in ("char", "cell", "struct", "function_handle") or item.attrs.get("MATLAB_empty", 0) or item.shape is None:
        return None
    if str(_plain(item.attrs.get("NAME", ""))).startswith("This is a netCDF dimension but not a netCDF variable"):
        return None
    unit = _plain(item.attrs.get("units", item.attrs.get("unit", "")))
    unit = unit if isinstance(unit, str) and unit else None
    since = _SINCE.match(unit) if unit else None
    if since:
        facts.setdefault("start", since.group(2).strip().replace(" ", "T", 1))
        unit = {"m": "min", "h": "h"}.get(since.group(1)[0], "s") if not since.group(1).startswith(("ms", "milli")) else "ms"
    shape = tuple(item.shape)
    error = np.asarray(item.attrs.get("stderr", np.nan))
    known = error.size == 1 and error.dtype.kind == "f" and bool(np.isfinite(error).all())
    return Array(shape, lambda: _values(item, path), unit, float(error.ravel()[0]) if known else None)


def _values(item, path: str) -> np.ndarray:
    """Return the values of a dataset with the packing of the CF conventions undone."""
    with guarded(path, "a whole HDF5, netCDF-4 or MATLAB v7.3 file"):
        raw = item[()]
        scale, offset = (float(np.ravel(item.attrs.get(key, default))[0]) for key, default in (("scale_factor", 1.0), ("add_offset", 0.0)))
        values = np.asarray(raw, float)
        if scale != 1.0 or offset != 0.0:
            values = values * scale + offset
        for key in ("_FillValue", "missing_value"):
            empty = np.ravel(item.attrs.get(key, np.nan))[0]
            if empty == empty:
                values = np.where(raw == empty, np.nan, values)
        return values


def _texts(group) -> dict[str, str]:
    """Return the text members of a MATLAB structure."""
    found = {}
    for name in ("units", "unit", "description"):
        item = group.get(name)
        if item is not None and hasattr(item, "dtype") and _plain(item.attrs.get("MATLAB_class", "")) == "char":
            found[name] = "" if item.attrs.get("MATLAB_empty", 0) else "".join(map(chr, np.ravel(item[()], order="F")))
    return found


def as_one_array(group: Group, texts: dict[str, str]) -> Array | None:
    """Return the array of a structure that is one channel: ``data`` next to ``units`` or ``description``."""
    if "data" not in group.arrays or not texts:
        return None
    data = group.arrays["data"]
    unit = texts.get("units", texts.get("unit", data.unit))
    return Array(data.shape, data.load, unit or None)


def _plain(value: Any) -> Any:
    """Return an attribute as a Python text or number where it is one."""
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    if isinstance(value, np.ndarray) and value.size == 1:
        return _plain(value.ravel()[0])
    return value.item() if isinstance(value, np.generic) else value
