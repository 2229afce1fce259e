"""Writing of HDF5 and netCDF-4 files, such that no failed write of the disk is lost.

HDF5 writes parts of a file at the end of its objects. h5py ignores errors at that time: the file
is damaged, and no exception is raised. After a failed write, HDF5 can also end the process. In
this module HDF5 writes into memory, where no write fails. Python then writes the bytes, and raises
every error of the disk. A large file is written to its temporary path through a Python object that
remembers the first error; it is closed, opened again and compared with the data.
"""

from __future__ import annotations

import errno
import io
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr

LARGEST_IN_MEMORY = 2**28
"""Greatest size of data whose file is formed in memory. [byte]

A record of ten hours with 100 channels at 25 Hz has 7e8 bytes.
"""

# Encoding of the variables of a group, as in `xarray.Dataset.to_netcdf`.
Encoding = Callable[[xr.Dataset], Mapping[str, Any]]
# Name in the file of a variable with the name of a dimension that it does not lie along.
_NOT_COORDINATE = "_nc4_non_coord_"


def encode_hdf5(fill: Callable[[h5py.File], None]) -> bytes:
    """Return the content of an HDF5 file.

    Parameters
    ----------
    fill : callable
        Writes into the empty file.
    """
    content = io.BytesIO()
    with h5py.File(content, "w") as file:
        fill(file)
    return content.getvalue()


def encode_netcdf(
    data: xr.Dataset | xr.DataTree | Mapping[str, xr.Dataset], encoding: Encoding | None = None
) -> bytes:
    """Return the content of a netCDF-4 file; parameters as in `write_netcdf`."""
    content = io.BytesIO()
    _write_groups(_list_groups(data), content, encoding)
    return content.getvalue()


def write_netcdf(
    data: xr.Dataset | xr.DataTree | Mapping[str, xr.Dataset],
    path: Path,
    encoding: Encoding | None = None,
) -> None:
    """Write a netCDF-4 file, usually to the temporary path of `written_atomically`.

    Parameters
    ----------
    data : Dataset, DataTree, or mapping of str to Dataset
        The groups of the file by path; ``/`` is the root.
    path : Path
    encoding : callable, optional
        Returns the encoding of the variables of a group.

    Raises
    ------
    OSError
        A write has failed, or a large file does not have the data when it is read again.
    """
    groups = _list_groups(data)
    if sum(group.nbytes for group in groups.values()) <= LARGEST_IN_MEMORY:
        path.write_bytes(encode_netcdf(groups, encoding))
        return
    with ErrorKeepingFile(path, "w+") as file:
        try:
            _write_groups(groups, file, encoding)
        finally:
            # errors of HDF5 after a failed write are its consequences
            if file.error is not None:
                raise file.error
    _demand_as_written(groups, path)


class ErrorKeepingFile(io.FileIO):
    """A file for HDF5 that keeps its first error of the disk.

    HDF5 would ignore an exception, or end the process. After an error nothing is written.

    Attributes
    ----------
    error : OSError or None
    """

    error: OSError | None = None

    def write(self, content: Any, /) -> int:
        """Write all bytes; the operating system may take them in several parts."""
        rest = memoryview(content).cast("B")
        size = len(rest)
        try:
            while self.error is None and len(rest):
                rest = rest[super().write(rest) :]
        except OSError as error:
            self.error = error
        return size

    def truncate(self, size: int | None = None, /) -> int:
        """Set the length of the file."""
        try:
            if self.error is None:
                return super().truncate(size)
        except OSError as error:
            self.error = error
        return size or 0


def _list_groups(
    data: xr.Dataset | xr.DataTree | Mapping[str, xr.Dataset],
) -> dict[str, xr.Dataset]:
    """Return the groups of a file by path."""
    if isinstance(data, xr.Dataset):
        return {"/": data}
    if isinstance(data, xr.DataTree):
        return {node.path: node.to_dataset(inherit=False) for node in data.subtree}
    return dict(data)


def _write_groups(
    groups: Mapping[str, xr.Dataset], target: io.IOBase, encoding: Encoding | None
) -> None:
    """Write groups as `xarray.Dataset.to_netcdf` does with the engine h5netcdf.

    That function takes an open file only in recent versions of xarray.
    """
    # Deferred as in xarray: commands that write no such file do not load it.
    import h5netcdf

    with h5netcdf.File(target, "w") as file:
        for path, group in groups.items():
            name = path.strip("/")
            store = xr.backends.H5NetCDFStore(file, group=name or None, mode="a")
            given = None if encoding is None else dict(encoding(group))
            group.dump_to_store(store, encoding=given)


def _demand_as_written(groups: Mapping[str, xr.Dataset], path: Path) -> None:
    """Raise if a file does not have the numbers of its groups."""
    different = []
    try:
        with h5py.File(path, "r") as file:
            for name, group in groups.items():
                stored = file[name]
                different += [f"{name.strip('/')}/{key}" for key in _list_different(group, stored)]
    except (OSError, KeyError, RuntimeError) as error:
        different = [str(error)]
    if different:
        text = f"not written as it is in memory ({', '.join(different[:3])}); check the disk"
        raise OSError(errno.EIO, text, os.fspath(path))


def _list_different(group: xr.Dataset, stored: h5py.Group) -> list[str]:
    """Return the names of the variables that a group of a file does not have as they are."""
    names = []
    for key, variable in group.variables.items():
        name = str(key)
        item = stored[name if name in stored else _NOT_COORDINATE + name]
        is_same = item.shape == variable.shape
        # texts and truth values are encoded as other types
        if is_same and variable.dtype.kind in "iuf" and item.dtype.kind == variable.dtype.kind:
            is_float = variable.dtype.kind == "f"
            is_same = np.array_equal(item[()], variable.values, equal_nan=is_float)
        if not is_same:
            names.append(name)
    return names
