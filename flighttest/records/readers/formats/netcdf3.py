"""Classic netCDF files (before netCDF-4) as one table of the variables over the clock."""

from __future__ import annotations

from pathlib import Path
from typing import Any

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
        The file is damaged, or has no variable over a clock.
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
            values: np.ndarray
            if variable.shape:
                values = np.ma.filled(np.ma.asarray(variable[:], float), np.nan)
            else:
                values = np.asarray(variable.getValue(), float)
            # The unit of a clock is "seconds since DATE" by the CF conventions.
            unit = _text(getattr(variable, "units", b"")).split(" since ")[0]
            root.arrays[name] = Array.of(values, unit or None)
        tables, left_out = nested_tables(root, names)
        title = _text(getattr(file, "title", b""))
    if not tables:
        raise ParseError(
            str(path),
            0,
            found="no variable of numbers",
            expected="a recording: variables over their stamps",
        )
    facts = {"title": title} if title else {}
    return Recording("netcdf3", tables, facts, left_out=tuple(left_out))


def _text(attribute: Any) -> str:
    """Return an attribute as text."""
    if isinstance(attribute, bytes):
        return attribute.decode("utf-8", "replace")
    return str(attribute)
