"""Reconstructed paths as netCDF files, written atomically."""

from __future__ import annotations

import os
import pathlib
from typing import TYPE_CHECKING

import xarray as xr

from flightmech.errors import ParseError
from flightmech.support.input_files.self_contained import demand_self_contained

from ..records.files import write_groups
from ..records.plain_groups import plain_group

if TYPE_CHECKING:
    from .smoother import Path


def save_path(path: Path, target: str | os.PathLike[str]) -> None:
    """Write a reconstruction: groups ``states`` (with the report as attribute), ``biases``, ``residuals``, ``errors``."""
    states = path.states.assign_attrs(report=path.report())
    biases = path.biases.assign(held=path.biases["held"].astype("int8"))
    groups = {"/states": states, "/residuals": path.residuals, "/biases": biases}
    write_groups(groups if path.errors is None else {**groups, "/errors": path.errors}, pathlib.Path(target))


def open_biases(path: str | os.PathLike[str]) -> xr.Dataset:
    """Return the constants of a reconstruction written by `save_path`, as a prior or for `combine_biases`.

    Raises
    ------
    ParseError
        Not such a file.
    """
    import h5py

    demand_self_contained(path)
    try:
        with h5py.File(path, "r") as file:
            found = plain_group(file["biases"])
        if found is None:
            with xr.open_dataset(path, group="biases", engine="h5netcdf") as data:
                found = data.load()
    except (OSError, ValueError, KeyError) as error:
        if not os.path.exists(path):
            raise
        wanted = "a path as `aeromatch flight reconstruct -o` writes it"
        raise ParseError(str(path), 0, f"no constants of a reconstruction ({error})", wanted) from error
    return found.assign(held=found["held"].astype(bool))
