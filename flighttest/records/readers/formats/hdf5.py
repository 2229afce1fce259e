"""HDF5 files (netCDF-4, MATLAB v7.3 and plain HDF5) as one table per group with a clock.

Only the requested columns are read.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from h5py import AttributeManager, Dataset, h5a, h5d, h5g, h5o, h5s, h5t

from flightmech.errors import ParseError
from flightmech.support.hdf5_seal import LinkedItems, demand_no_fault, find_unreadable
from flighttest.records.readers.formats.nested import Array, Group, as_one_array, nested_tables
from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.recording import Recording, decoding_errors

# Unit of a clock by the CF conventions.
_SINCE = re.compile(r"^(seconds|second|sec|secs|s|milliseconds|ms|minutes|min|hours|h) since (.+)$")
_EXPECTED = "a whole HDF5, netCDF-4 or MATLAB v7.3 file"
# Largest depth of groups inside each other.
_DEPTH = 20
# MATLAB_class of datasets that are not numbers -> description.
_MATLAB_CLASSES = {
    "char": "text",
    "cell": "a cell array",
    "struct": "an empty structure",
    "function_handle": "a function",
}
# NAME of the datasets in which netCDF-4 stores a dimension without values.
_NETCDF_DIMENSION = "This is a netCDF dimension but not a netCDF variable"


def read(path: Path, names: NameMap) -> Recording:
    """Return the groups of an HDF5 file as tables.

    Raises
    ------
    ParseError
        The file is damaged, has numbers in other files, or has no numbers over a clock.
    """
    demand_no_fault(path, find_unreadable(path))
    facts: dict[str, Any] = {}
    with decoding_errors(path, _EXPECTED):
        # Each dataset is read whole and once, so that a cache of its chunks costs time only.
        file = h5py.File(path, "r", rdcc_nbytes=0)
        for key, value in file.attrs.items():
            if not key.startswith("_"):
                facts[str(key)] = _to_plain_value(value)
        root = _GroupReader(path, file.id, facts).read(file.id, "", depth=0)
        tables, left_out = nested_tables(root, names)
    if not tables:
        raise ParseError(
            str(path),
            0,
            found="no array of numbers",
            expected="a recording: arrays next to their stamps",
        )
    with path.open("rb") as stream:
        is_matlab = stream.read(16).startswith(b"MATLAB")
    facts = {key: value for key, value in facts.items() if isinstance(value, str | int | float)}
    kind = "matlab73" if is_matlab else "hdf5"
    return Recording(kind, tables, facts, left_out=tuple(left_out))


# The functions below open the low-level objects of HDF5, because the objects of h5py take several
# times as long for the many short datasets of a record.


class _GroupReader:
    """Reader of the groups of a file.

    Parameters
    ----------
    path : Path
    root : GroupID
    facts : dict of str to object
        Gets the start of a clock since a date.
    """

    def __init__(self, path: Path, root: h5g.GroupID, facts: dict[str, Any]) -> None:
        self._path, self._facts = str(path), facts
        self._items = LinkedItems(root)

    def read(self, group: h5g.GroupID, place: str, depth: int) -> Group:
        """Return the arrays of a group and its inner groups; `place` is its path in the file."""
        if depth > _DEPTH:
            raise ParseError(
                self._path,
                0,
                found=f"groups inside each other more than {_DEPTH} deep",
                expected="a recording",
            )
        # "marks" is the former name of the attribute "flags".
        attributes = _Attributes(group)
        flags = attributes.plain("flags", attributes.plain("marks", ""))
        content = Group(flags=flags if isinstance(flags, str) else "")
        for name, item, fault in self._items.of(group, place):
            # No function of dimension scales is called here, so that they are not checked.
            demand_no_fault(self._path, fault)
            # MATLAB stores the targets of its references in such groups.
            if name.startswith("#"):
                continue
            if isinstance(item, h5g.GroupID):
                inner = self.read(item, f"{place}/{name}", depth + 1)
                array = as_one_array(inner, _structure_texts(item))
                if array is not None:
                    content.arrays[name] = array
                else:
                    content.groups[name] = inner
            elif isinstance(item, h5d.DatasetID):
                _add_dataset(content, name, item, path=self._path, facts=self._facts)
        return content


# h5py makes the type again at each reading if it is not given.
@cache
def _memory_type(kind: np.dtype[Any]) -> h5t.TypeID:
    """Return the type of HDF5 of the numbers of an array."""
    return h5t.py_create(kind)


class _Attributes:
    """Attributes of a dataset or group. Their names are listed once, values read on request."""

    def __init__(self, item: h5d.DatasetID | h5g.GroupID) -> None:
        self._item = item
        names: list[bytes] = []
        # The list takes as long as three questions for one name, and a dataset gets nine.
        h5a.iterate(item, names.append)
        self._names = frozenset(names)

    def plain(self, name: str, default: Any = None) -> Any:
        """Return an attribute as a Python text or number if it is one."""
        return _to_plain_value(self.stored(name, default))

    def stored(self, name: str, default: Any) -> Any:
        """Return an attribute as h5py returns it."""
        key = name.encode()
        if key not in self._names:
            return default
        attribute = h5a.open(self._item, key)
        kind, shape = attribute.dtype, attribute.shape
        if kind.kind in "fiu" and shape is not None:
            value = np.empty(shape, kind)
            attribute.read(value, _memory_type(kind))
            return value
        text = h5py.check_string_dtype(kind)
        if text is None or shape != ():
            is_dataset = isinstance(self._item, h5d.DatasetID)
            owner: Any = Dataset(self._item) if is_dataset else h5py.Group(self._item)
            return AttributeManager(owner)[name]
        # Numbers and single texts are read without the attribute manager, in half the time.
        single = np.empty(shape, kind)
        attribute.read(single)
        if text.length is not None:
            return single[()]
        return bytes(single[()]).decode("utf-8", "surrogateescape")


def _add_dataset(
    group: Group, name: str, item: h5d.DatasetID, path: str, facts: dict[str, Any]
) -> None:
    """Add a dataset to the arrays of a group, or the reason to omit it."""
    attributes = _Attributes(item)
    # Each question for type or shape makes an object of HDF5.
    kind, shape = item.dtype, item.shape
    reason = _reason_to_omit(kind, shape, attributes)
    if reason is None:
        load = partial(_read_values, item, kind, attributes, path)
        group.arrays[name] = _dataset_array(shape, load, attributes, facts=facts)
    elif reason:
        group.left_out[name] = reason


def _reason_to_omit(
    kind: np.dtype[Any], shape: tuple[int, ...] | None, attributes: _Attributes
) -> str | None:
    """Return why a dataset is not an array of numbers, None if it is one.

    The reason is empty for datasets that are not content: references and bare dimensions.
    """
    matlab_class = attributes.plain("MATLAB_class", "")
    if isinstance(matlab_class, str) and matlab_class in _MATLAB_CLASSES:
        return _MATLAB_CLASSES[matlab_class]
    if kind.kind not in "fiub":
        return _describe_other_values(kind)
    if attributes.plain("MATLAB_empty", 0) or shape is None:
        return "an empty array"
    if str(attributes.plain("NAME", "")).startswith(_NETCDF_DIMENSION):
        return ""
    return None


def _describe_other_values(kind: np.dtype[Any]) -> str:
    """Return a description of values that are not numbers, empty for a reference."""
    if h5py.check_string_dtype(kind) is not None or kind.kind in "SU":
        return "text"
    if h5py.check_ref_dtype(kind) is not None:
        return ""
    if kind.kind == "c":
        return "complex numbers; write the real and the imaginary part as an array each"
    if kind.names:
        return f"rows of several fields ({', '.join(kind.names[:6])}); write each field as an array"
    return "values that are not numbers"


def _dataset_array(
    shape: tuple[int, ...],
    load: Callable[[], np.ndarray],
    attributes: _Attributes,
    facts: dict[str, Any],
) -> Array:
    """Return a dataset of numbers as an array; a clock since a date adds the fact ``start``."""
    unit = attributes.plain("units", attributes.plain("unit", ""))
    if not isinstance(unit, str) or not unit:
        unit = None
    since = _SINCE.match(unit) if unit else None
    if since:
        facts.setdefault("start", since.group(2).strip().replace(" ", "T", 1))
        unit = _clock_unit(since.group(1))
    error = attributes.plain("stderr")
    if not isinstance(error, float) or not math.isfinite(error):
        error = None
    return Array(tuple(shape), load, unit, error)


def _clock_unit(word: str) -> str:
    """Return the unit of a clock from its word in the CF conventions."""
    if word.startswith(("ms", "milli")):
        return "ms"
    return {"m": "min", "h": "h"}.get(word[0], "s")


def _read_values(
    item: h5d.DatasetID, kind: np.dtype[Any], attributes: _Attributes, path: str
) -> np.ndarray:
    """Return the values of a dataset without the packing of the CF conventions."""
    with decoding_errors(path, _EXPECTED):
        stored = _read_stored(item, kind)
        scale = float(np.ravel(attributes.stored("scale_factor", 1.0))[0])
        offset = float(np.ravel(attributes.stored("add_offset", 0.0))[0])
        values = np.asarray(stored, float)
        if scale != 1.0 or offset != 0.0:
            values = values * scale + offset
        for key in ("_FillValue", "missing_value"):
            empty = np.ravel(attributes.stored(key, np.nan))[0]
            # NaN, which differs from itself, is a missing value already.
            if empty == empty:
                values = np.where(stored == empty, np.nan, values)
        return values


def _read_stored(item: h5d.DatasetID, kind: np.dtype[Any]) -> np.ndarray:
    """Return the numbers of a dataset as they are stored."""
    shape = item.shape
    # Booleans and empty datasets need the conversion of h5py.
    if kind.kind == "b" or not all(shape):
        return Dataset(item)[()]
    values = np.empty(shape, kind)
    item.read(h5s.ALL, h5s.ALL, values, _memory_type(kind))
    return values


def _structure_texts(group: h5g.GroupID) -> dict[str, str]:
    """Return the text members of a MATLAB structure."""
    texts = {}
    for name in ("units", "unit", "description"):
        if name.encode() not in group:
            continue
        item = h5o.open(group, name.encode())
        if not isinstance(item, h5d.DatasetID):
            continue
        attributes = _Attributes(item)
        if attributes.plain("MATLAB_class", "") != "char":
            continue
        texts[name] = ""
        if not attributes.plain("MATLAB_empty", 0):
            # MATLAB stores a text as a matrix of character codes in column order.
            texts[name] = "".join(map(chr, np.ravel(Dataset(item)[()], order="F")))
    return texts


def _to_plain_value(value: Any) -> Any:
    """Return an attribute as a Python text or number if it is one."""
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    if isinstance(value, np.ndarray) and value.size == 1:
        return _to_plain_value(value.ravel()[0])
    if isinstance(value, np.generic):
        return value.item()
    return value
