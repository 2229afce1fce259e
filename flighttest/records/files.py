"""Manoeuvres and reconstructed paths as netCDF files, written atomically."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import xarray as xr

from flightmech.support.atomic_write import written_atomically


def save(data: xr.Dataset, path: str | Path) -> None:
    """Write a manoeuvre or the states of a path to netCDF; an unfinished file never takes the name."""
    write_groups({"/": data}, Path(path))


def save_record(record: xr.DataTree, path: str | Path) -> None:
    """Write a flight record to netCDF, one group per leaf; `flighttest.read` reads it again without a name map."""
    groups = {"/": xr.Dataset(attrs=record.attrs)}
    write_groups({**groups, **{f"/{leaf}": node.to_dataset() for leaf, node in record.children.items()}}, Path(path))


def write_groups(groups: Mapping[str, xr.Dataset], target: Path) -> None:
    """Write groups of a netCDF file, all or none; time histories are compressed."""
    with written_atomically(target) as part:
        mode: Any = "w"
        for group, data in groups.items():
            packed = {
                str(n): {"zlib": True, "complevel": 4}
                for n, v in data.data_vars.items()
                if v.dims[-1:] == ("time",) and v.dtype.kind == "f"
            }
            data.to_netcdf(part, mode=mode, group=None if group == "/" else group.strip("/"), engine="h5netcdf", encoding=packed)
            mode = "a"
