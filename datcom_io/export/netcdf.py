"""Writing a tree to a netCDF file, atomically."""

from __future__ import annotations

import os

import xarray as xr

from flightmech.support.atomic_write import written_atomically


def write_tree(tree: xr.DataTree, path: str | os.PathLike[str]) -> None:
    """Write a DataTree as netCDF-4; a file that stood there stays as it was when writing fails.

    Parameters
    ----------
    tree : DataTree
        As `Case.to_datatree`, `Listing.to_datatree` or `datcom_io.join` return it.
    path : path
        File to write; its folder must exist.
    """
    with written_atomically(path) as part:
        tree.to_netcdf(part, engine="h5netcdf")
