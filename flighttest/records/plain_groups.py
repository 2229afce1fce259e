"""Groups of netCDF-4 files that hold plain numbers, read without what xarray does for all others.

xarray looks up some forty objects of the file for one variable, 4 ms of processor time: of the states of a short flight, 62 variables,
this is four fifths of the time of reading.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

if TYPE_CHECKING:
    import h5py

# of HDF5 and of netCDF-4, which say how dimensions are kept
_KEPT = {"CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST", "_Netcdf4Dimid", "_Netcdf4Coordinates", "_NCProperties", "_FillValue"}
_DECODED = {"scale_factor", "add_offset", "missing_value", "coordinates", "dtype", "calendar", "_Unsigned", "_Encoding", "grid_mapping"}
_TIMES = {"days", "hours", "minutes", "seconds", "milliseconds", "microseconds", "nanoseconds"}
_NO_VARIABLE = b"This is a netCDF dimension but not a netCDF variable"


def plain_group(group: h5py.Group) -> xr.Dataset | None:
    """Return the variables of a group in memory, without those of groups inside.

    Parameters
    ----------
    group : h5py.Group

    Returns
    -------
    Dataset or None
        What ``xarray.load_dataset`` gives, less the encoding; None when the group needs decoding (packed numbers, dates,
        missing values other than NaN), holds other types than numbers and text, or names its dimensions elsewhere.
    """
    import h5py

    variables: dict[str, Any] = {}
    coordinates: dict[str, Any] = {}
    for name, item in group.items():
        if isinstance(item, h5py.Group):
            continue
        if not isinstance(item, h5py.Dataset):
            return None
        if item.is_scale and bytes(item.attrs.get("NAME", b"")).startswith(_NO_VARIABLE):
            continue
        dimensions = _dimensions(name, item, group)
        values, attrs = _values(item), _attributes(item)
        if dimensions is None or values is None or attrs is None:
            return None
        (coordinates if dimensions == (name,) else variables)[name] = (dimensions, values, attrs)
    attrs = _attributes(group)
    return None if attrs is None else xr.Dataset(variables, coordinates, attrs)


def _dimensions(name: str, item: h5py.Dataset, group: h5py.Group) -> tuple[str, ...] | None:
    """Return the names of the dimensions; None when a scale is missing or of another group."""
    if item.is_scale:
        return (name,) if item.ndim == 1 else None
    found = []
    for axis in item.dims:
        places = [scale.name.rpartition("/") for scale in axis.values()]
        if len(places) != 1 or (places[0][0] or "/") != group.name:
            return None
        found.append(places[0][2])
    return tuple(found)


def _values(item: h5py.Dataset) -> np.ndarray | None:
    import h5py

    if h5py.check_string_dtype(item.dtype) is not None:
        return item.asstr()[()].astype(str) if item.ndim and item.size else None
    if item.dtype.kind not in "if" or not item.dtype.isnative:
        return None
    missing = item.attrs.get("_FillValue")
    return item[()] if missing is None or np.isnan(missing).all() else None


def _attributes(item: h5py.Dataset | h5py.Group) -> dict[str, Any] | None:
    """Return the attributes as xarray gives them; None when one requires decoding or is neither text nor number."""
    given = {name: item.attrs[name] for name in item.attrs if name not in _KEPT}
    found: dict[str, Any] = {}
    units = given.get("units", "")
    if _DECODED & given.keys() or not isinstance(units, str) or " since " in units or units in _TIMES:
        return None
    for name, value in given.items():
        if isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and value.ndim == 1:
            found[name] = value[0] if value.size == 1 else value
        elif isinstance(value, str | np.number):
            found[name] = value
        else:
            return None
    return found
