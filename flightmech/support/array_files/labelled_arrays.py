"""Labelled data of arrays in memory, without the checks of the constructors of xarray.

The constructors look for the arrays of dask in each value. Where dask is installed, the first look
imports it, which takes longer than the reading of many files.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    # imported on first use: a command that only reads files does without it
    import xarray as xr


def make_variable(
    dims: str | tuple[Hashable, ...], values: np.ndarray, attrs: Mapping[Any, Any] | None = None
) -> xr.Variable:
    """Return a variable of an array, which is not copied."""
    import xarray as xr

    return xr.Variable(dims, values, attrs, fastpath=True)


def make_dataset(
    variables: Mapping[str, xr.Variable],
    axes: Mapping[str, xr.Variable],
    attrs: Mapping[Any, Any] | None = None,
) -> xr.Dataset:
    """Return a Dataset of variables, with an index for each axis.

    Parameters
    ----------
    variables : mapping of str to Variable
    axes : mapping of str to Variable (axis,)
        Each has the dimension of its name.
    attrs : mapping, optional
    """
    import pandas as pd
    import xarray as xr

    points, indexes = {}, {}
    for name, axis in axes.items():
        index = pd.Index(axis.values)
        indexes[name] = xr.indexes.PandasIndex(index, name)
        points[name] = xr.IndexVariable(name, index, axis.attrs, fastpath=True)
    return xr.Dataset(variables, xr.Coordinates(points, indexes), attrs)
