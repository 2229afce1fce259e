"""Writing a tree to a netCDF file, whole or not at all."""

from __future__ import annotations

import os
import tempfile

import xarray as xr


def write_tree(tree: xr.DataTree, path: str | os.PathLike[str]) -> None:
    """Write a DataTree as netCDF-4; a file that stood there stays as it was when writing fails.

    Parameters
    ----------
    tree : DataTree
        As `Case.to_datatree`, `Listing.to_datatree` or `datcom_io.join` return it.
    path : path
        File to write; its folder must exist.
    """
    folder = os.path.dirname(os.path.abspath(path))
    handle, temporary = tempfile.mkstemp(suffix=".nc", dir=folder)
    os.close(handle)
    try:
        tree.to_netcdf(temporary, engine="h5netcdf")
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise
