"""netCDF classic files (before netCDF-4): one table of the variables over the clock."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.io import netcdf_file

from flightmech.errors import ParseError
from flighttest.records.readers.formats.nested import Array, Group, nested_tables
from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.recording import Recording, decoding_errors


def read(path: Path, names: NameMap) -> Recording:
    """Return the variables of a classic netCDF file as the table ``data``.

    Raises
    ------
    ParseError
        The file is damaged, or holds no variable over a clock.
    """

    root = Group()
    with (
        decoding_errors(path, "a whole netCDF file"),
        netcdf_file(str(path), "r", mmap=False, maskandscale=True) as file,
    ):
        for name, variable in file.variables.items():
            if variable.data.dtype.kind not in "fiu":
                root.left_out[name] = "text"
                continue
            values = (
                np.ma.filled(np.ma.asarray(variable[:], float), np.nan)
                if variable.shape
                else np.asarray(variable.getValue(), float)
            )
            unit = getattr(variable, "units", b"")
            unit = unit.decode("utf-8", "replace") if isinstance(unit, bytes) else str(unit)
            root.arrays[name] = Array.of(values, unit.split(" since ")[0] or None)
        found, left_out = nested_tables(root, names)
        title = getattr(file, "title", b"")
    if not found:
        raise ParseError(
            str(path), 0, "no variable of numbers", "a recording: variables over their stamps"
        )
    title = title.decode("utf-8", "replace") if isinstance(title, bytes) else str(title)
    return Recording("netcdf3", found, {"title": title} if title else {}, left_out=tuple(left_out))
