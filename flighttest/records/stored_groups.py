"""Groups of netCDF-4 files with plain numbers, read without xarray.

xarray reads some forty objects of the file for one variable.  For the states of a short flight,
with 62 variables, that costs more than the numbers themselves.
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

# Attributes by which HDF5 and netCDF-4 store dimensions.
_INTERNAL = {
    *(b"CLASS", b"NAME", b"DIMENSION_LIST", b"REFERENCE_LIST", b"_FillValue"),
    *(b"_Netcdf4Dimid", b"_Netcdf4Coordinates", b"_NCProperties"),
}
# Attributes of variables that xarray decodes.
_DECODED = {
    *(b"scale_factor", b"add_offset", b"missing_value", b"coordinates", b"dtype", b"calendar"),
    *(b"_Unsigned", b"_Encoding", b"grid_mapping"),
}
_TIMES = {"days", "hours", "minutes", "seconds", "milliseconds", "microseconds", "nanoseconds"}
# Bytes of the descriptor of a text of variable length.
_TEXT = 16
_NO_VARIABLE = b"This is a netCDF dimension but not a netCDF variable"


def plain_group(group: h5py.Group, described: bool = True) -> xr.Dataset | None:
    """Return the variables of a group in memory, without those of groups inside.

    Parameters
    ----------
    group : h5py.Group
    described : bool
        Whether the attributes of the variables are read.  A reader of numbers needs none.

    Returns
    -------
    Dataset or None
        The result of ``xarray.load_dataset`` without the encoding.  None if the group needs
        decoding (packed numbers, dates, missing values other than NaN), has other types than
        numbers and text, or has its dimensions in another group.
    """
    items: dict[str, h5d.DatasetID] = {}
    for name in group:
        item = h5o.open(group.id, name.encode())
        if isinstance(item, h5g.GroupID):
            continue
        if not isinstance(item, h5d.DatasetID):
            return None
        items[name] = item
    # A scale of HDF5 is a dimension of netCDF. Datasets refer to it by its address.
    names_of_scales = {name for name, item in items.items() if h5ds.is_scale(item)}
    scales = {h5o.get_info(items[name]).addr: name for name in names_of_scales}
    variables: dict[str, Any] = {}
    coordinates: dict[str, Any] = {}
    for name, item in items.items():
        is_scale = name in names_of_scales
        if is_scale and h5ds.get_scale_name(item).startswith(_NO_VARIABLE):
            continue
        variable = _read_variable(name, item, scales, is_scale=is_scale, described=described)
        if variable is None:
            return None
        if variable[0] == (name,):
            coordinates[name] = variable
        else:
            variables[name] = variable
    attrs = _read_attributes(group.id, _attribute_names(group.id))
    if attrs is None:
        return None
    return xr.Dataset(variables, coordinates, attrs)


def _read_variable(
    name: str, item: h5d.DatasetID, scales: Mapping[int, str], is_scale: bool, described: bool
) -> tuple[tuple[str, ...], np.ndarray, dict[str, Any]] | None:
    """Return dimensions, values and attributes; None if they need xarray."""
    names = _attribute_names(item)
    attrs = _read_attributes(item, names, described)
    dimensions = _dimensions(name, item, scales, is_scale=is_scale, names=names)
    if attrs is None or dimensions is None:
        return None
    values = _read_values(item, names)
    if values is None:
        return None
    return dimensions, values, attrs


def _attribute_names(item: h5d.DatasetID | h5g.GroupID) -> list[bytes]:
    """Return the names of all attributes, in the order of their creation if it is stored."""
    names: list[bytes] = []
    is_ordered = item.get_create_plist().get_attr_creation_order() & h5p.CRT_ORDER_TRACKED
    h5a.iterate(
        item,
        lambda name, *_: names.append(name),
        index_type=h5.INDEX_CRT_ORDER if is_ordered else h5.INDEX_NAME,
    )
    return names


def _dimensions(
    name: str, item: h5d.DatasetID, scales: Mapping[int, str], is_scale: bool, names: list[bytes]
) -> tuple[str, ...] | None:
    """Return the names of the dimensions; None if a scale is missing or in another group."""
    if is_scale:
        return (name,) if item.rank == 1 else None
    dimensions = []
    for axis in range(item.rank):
        axis_scales: list[h5d.DatasetID] = []
        if b"DIMENSION_LIST" in names:
            h5ds.iterate(item, axis, axis_scales.append, 0)
        if len(axis_scales) != 1:
            return None
        dimension = scales.get(h5o.get_info(axis_scales[0]).addr)
        if dimension is None:
            return None
        dimensions.append(dimension)
    return tuple(dimensions)


def _read_values(item: h5d.DatasetID, names: list[bytes]) -> np.ndarray | None:
    """Return numbers or texts.

    The result is None for other types, and if a number other than NaN means a missing value.
    """
    kind, shape = item.dtype, item.shape
    if check_string_dtype(kind) is not None:
        if not shape or not all(shape):
            return None
        return Dataset(item).asstr()[()].astype(str)
    if kind.kind not in "if" or not kind.isnative:
        return None
    if b"_FillValue" in names and not np.isnan(_read_numbers(item, b"_FillValue")).all():
        return None
    values = np.empty(shape, kind)
    if values.size:
        # The type of the file is requested by None.
        memory_type = h5t.NATIVE_DOUBLE if kind == np.float64 else None
        item.read(h5s.ALL, h5s.ALL, values, memory_type)
    return values if shape else values[()]


def _read_attributes(
    item: h5d.DatasetID | h5g.GroupID, names: list[bytes], described: bool = True
) -> dict[str, Any] | None:
    """Return the attributes as xarray gives them, none if not `described`.

    The result is None if an attribute requires decoding, or is neither text nor number.
    """
    if not _DECODED.isdisjoint(names):
        return None
    # The units decide whether xarray would decode times.
    if b"units" in names:
        units = _read_attribute(item, b"units")
        if not isinstance(units, str) or " since " in units or units in _TIMES:
            return None
    attrs: dict[str, Any] = {}
    if not described:
        return attrs
    for name in names:
        if name in _INTERNAL:
            continue
        value = _read_attribute(item, name)
        if isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and value.ndim == 1:
            attrs[name.decode()] = value[0] if value.size == 1 else value
        elif isinstance(value, str | np.number):
            attrs[name.decode()] = value
        else:
            return None
    return attrs


def _read_attribute(item: h5d.DatasetID | h5g.GroupID, name: bytes) -> Any:
    """Return the value of an attribute, as h5py's mapping of attributes gives it."""
    attribute = h5a.open(item, name)
    # Most attributes are texts. They are read without their shape and type, which would take twice
    # as long. HDF5 raises an error for numbers of the same size.
    if attribute.get_storage_size() == _TEXT:
        text = np.empty((), object)
        with suppress(OSError):
            attribute.read(text, _text_type())
            return bytes(text[()]).decode("utf-8", "surrogateescape")
    shape, kind = attribute.shape, attribute.dtype
    if shape is None or kind.subdtype is not None:
        return None
    value = np.empty(shape, kind)
    attribute.read(value)
    string_type = check_string_dtype(kind)
    if string_type is not None and string_type.length is None and not shape:
        return bytes(value[()]).decode("utf-8", "surrogateescape")
    return value if shape else value[()]


def _read_numbers(item: h5d.DatasetID, name: bytes) -> np.ndarray:
    """Return the numbers of an attribute as doubles, followed by NaN."""
    attribute = h5a.open(item, name)
    # Each number has at least one byte.
    numbers = np.full(attribute.get_storage_size(), np.nan)
    attribute.read(numbers, h5t.NATIVE_DOUBLE)
    return numbers


@cache
def _text_type() -> h5t.TypeID:
    """Return the type of text of variable length in memory."""
    return h5t.py_create(string_dtype())
