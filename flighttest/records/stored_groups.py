"""Groups of netCDF-4 files that hold plain numbers, read without what xarray does for all others.

xarray looks up some forty objects of the file for one variable, 4 ms of processor time: of the
states of a short flight, 62 variables, this is four fifths of the time of reading.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from typing import Any

import h5py
import numpy as np
import xarray as xr
from h5py import (
    Dataset,
    check_string_dtype,
    h5,
    h5a,
    h5d,
    h5ds,
    h5g,
    h5o,
    h5p,
    h5s,
    h5t,
    string_dtype,
)

# of HDF5 and of netCDF-4, which say how dimensions are kept
_KEPT = {
    *(
        b"CLASS",
        b"NAME",
        b"DIMENSION_LIST",
        b"REFERENCE_LIST",
        b"_Netcdf4Dimid",
        b"_Netcdf4Coordinates",
        b"_NCProperties",
        b"_FillValue",
    ),
}
_DECODED = {
    b"scale_factor",
    b"add_offset",
    b"missing_value",
    b"coordinates",
    b"dtype",
    b"calendar",
    b"_Unsigned",
    b"_Encoding",
    b"grid_mapping",
}
_TIMES = {"days", "hours", "minutes", "seconds", "milliseconds", "microseconds", "nanoseconds"}
_TEXT = 16  # bytes that one text of any length takes where the attribute is
_NO_VARIABLE = b"This is a netCDF dimension but not a netCDF variable"


def plain_group(group: h5py.Group, described: bool = True) -> xr.Dataset | None:
    """Return the variables of a group in memory, without those of groups inside.

    Parameters
    ----------
    group : h5py.Group
    described : bool
        Variables with their attributes, which take a third of the time of reading.

    Returns
    -------
    Dataset or None
        What ``xarray.load_dataset`` gives, less the encoding; None when the group needs decoding
        (packed numbers, dates, missing values other than NaN), holds other types than numbers and
        text, or names its dimensions elsewhere.
    """

    items = {name: h5o.open(group.id, name.encode()) for name in group}
    items = {name: item for name, item in items.items() if not isinstance(item, h5g.GroupID)}
    if not all(isinstance(item, h5d.DatasetID) for item in items.values()):
        return None
    along = {name for name, item in items.items() if h5ds.is_scale(item)}
    scales = {h5o.get_info(items[name]).addr: name for name in along}
    variables: dict[str, Any] = {}
    coordinates: dict[str, Any] = {}
    for name, item in items.items():
        if name in along and h5ds.get_scale_name(item).startswith(_NO_VARIABLE):
            continue
        given = _names(item)
        attrs, dimensions = (
            _attributes(item, given, described),
            _dimensions(name, item, scales, name in along, given),
        )
        values = _values(item, given) if attrs is not None else None
        if dimensions is None or values is None or attrs is None:
            return None
        (coordinates if dimensions == (name,) else variables)[name] = (dimensions, values, attrs)
    attrs = _attributes(group.id, _names(group.id))
    return None if attrs is None else xr.Dataset(variables, coordinates, attrs)


def _names(item: h5py.h5d.DatasetID | h5py.h5g.GroupID) -> list[bytes]:
    """Return the names of all attributes, in the order of their creation where the file holds it."""

    found: list[bytes] = []
    ordered = item.get_create_plist().get_attr_creation_order() & h5p.CRT_ORDER_TRACKED
    h5a.iterate(
        item,
        lambda name, *_: found.append(name),
        index_type=h5.INDEX_CRT_ORDER if ordered else h5.INDEX_NAME,
    )
    return found


def _dimensions(
    name: str, item: h5py.h5d.DatasetID, scales: Mapping[int, str], scale: bool, given: list[bytes]
) -> tuple[str, ...] | None:
    """Return the names of the dimensions; None when a scale is missing or of another group."""

    if scale:
        return (name,) if item.rank == 1 else None
    found = []
    for axis in range(item.rank):
        places: list[h5py.h5d.DatasetID] = []
        if b"DIMENSION_LIST" in given:
            h5ds.iterate(item, axis, places.append, 0)
        names = [scales.get(h5o.get_info(place).addr) for place in places]
        if len(names) != 1 or names[0] is None:
            return None
        found.append(names[0])
    return tuple(found)


def _values(item: h5py.h5d.DatasetID, given: list[bytes]) -> np.ndarray | None:
    """Return numbers or texts; None of other types, and where a number that is not NaN stands for a
    missing value.
    """

    kind, shape = item.dtype, item.shape
    if check_string_dtype(kind) is not None:
        return Dataset(item).asstr()[()].astype(str) if shape and all(shape) else None
    if kind.kind not in "if" or not kind.isnative:
        return None
    if b"_FillValue" in given and not np.isnan(_numbers(item, b"_FillValue")).all():
        return None
    found = np.empty(shape, kind)
    if found.size:
        item.read(
            h5s.ALL, h5s.ALL, found, h5t.NATIVE_DOUBLE if kind == np.float64 else None
        )  # None: as the file has them
    return found if shape else found[()]


def _attributes(
    item: h5py.h5d.DatasetID | h5py.h5g.GroupID, names: list[bytes], described: bool = True
) -> dict[str, Any] | None:
    """Return the attributes as xarray gives them, none unless wanted; None when one requires
    decoding or is neither text nor number.
    """
    given = {
        name.decode(): _attribute(item, name)
        for name in names
        if name == b"units" or (described and name not in _KEPT)
    }
    found: dict[str, Any] = {}
    units = given.get("units", "")
    if (
        not _DECODED.isdisjoint(names)
        or not isinstance(units, str)
        or " since " in units
        or units in _TIMES
    ):
        return None
    if not described:
        return found
    for name, value in given.items():
        if isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and value.ndim == 1:
            found[name] = value[0] if value.size == 1 else value
        elif isinstance(value, str | np.number):
            found[name] = value
        else:
            return None
    return found


def _attribute(item: h5py.h5d.DatasetID | h5py.h5g.GroupID, name: bytes) -> Any:
    """Return the value of an attribute, as h5py's mapping of attributes gives it."""

    attribute = h5a.open(item, name)
    if (
        attribute.get_storage_size() == _TEXT
    ):  # most are: without a look at shape and type, which takes twice as long as the reading
        one = np.empty((), object)
        with suppress(OSError):  # numbers, which HDF5 does not make text of
            attribute.read(one, _text_type())
            return bytes(one[()]).decode("utf-8", "surrogateescape")
    shape, kind = attribute.shape, attribute.dtype
    if shape is None or kind.subdtype is not None:
        return None
    value = np.empty(shape, kind)
    attribute.read(value)
    text = check_string_dtype(kind)
    if text is not None and text.length is None and not shape:
        return bytes(value[()]).decode("utf-8", "surrogateescape")
    return value if shape else value[()]


def _numbers(item: h5py.h5d.DatasetID, name: bytes) -> np.ndarray:
    """Return the numbers of an attribute as doubles, behind them NaN."""

    attribute = h5a.open(item, name)
    found = np.full(attribute.get_storage_size(), np.nan)  # a byte a number at least
    attribute.read(found, h5t.NATIVE_DOUBLE)
    return found


@cache
def _text_type() -> h5py.h5t.TypeID:
    """Return the type of text of any length in memory."""

    return h5t.py_create(string_dtype())
