"""Manoeuvres and reconstructed paths as netCDF files, written whole or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from flightmech.errors import ParseError
from flightmech.whole import written_whole

if TYPE_CHECKING:
    from .reconstruction import Path as FlightPath


def save(data: xr.Dataset, path: str | Path) -> None:
    """Write a manoeuvre or the states of a path to netCDF; an unfinished file never takes the name."""
    _whole({"/": data}, Path(path))


def save_record(record: xr.DataTree, path: str | Path) -> None:
    """Write a flight record to netCDF, one group per leaf; `flighttest.read` reads it again without a name map."""
    groups = {"/": xr.Dataset(attrs=record.attrs)}
    _whole({**groups, **{f"/{leaf}": node.to_dataset() for leaf, node in record.children.items()}}, Path(path))


def save_path(path: FlightPath, target: str | Path) -> None:
    """Write a reconstruction: groups ``states`` (with the report as attribute), ``biases``, ``residuals``."""
    states = path.states.assign_attrs(report=path.report())
    biases = path.biases.assign(held=path.biases["held"].astype("int8"))
    _whole({"/states": states, "/residuals": path.residuals, "/biases": biases}, Path(target))


def open_biases(path: str | Path) -> xr.Dataset:
    """Return the constants of a reconstruction written by `save_path`, as a prior or for `combine_biases`.

    Raises
    ------
    ParseError
        Not such a file.
    """
    try:
        with xr.open_dataset(path, group="biases", engine="h5netcdf") as data:
            found = data.load()
    except (OSError, ValueError, KeyError) as error:
        if not Path(path).exists():
            raise
        wanted = "a path as `aeromatch flight reconstruct -o` writes it"
        raise ParseError(str(path), 0, f"no constants of a reconstruction ({error})", wanted) from error
    return found.assign(held=found["held"].astype(bool))


def _whole(groups: Mapping[str, xr.Dataset], target: Path) -> None:
    with written_whole(target) as part:
        mode: Any = "w"
        for group, data in groups.items():
            packed = {
                str(n): {"zlib": True, "complevel": 4} for n, v in data.data_vars.items() if v.dims == ("time",) and v.dtype.kind == "f"
            }
            data.to_netcdf(part, mode=mode, group=None if group == "/" else group.strip("/"), engine="h5netcdf", encoding=packed)
            mode = "a"
