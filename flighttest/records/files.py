"""Records, manoeuvres and reconstructed paths as netCDF files, written atomically; records with an overview and a seal."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import xarray as xr

from flightmech.errors import AeromatchError
from flightmech.support.atomic_write import written_atomically
from flightmech.support.input_files.seal import seal

from ..readers.name_map import NameMap
from ..readers.opening import FORMATS, open_recording
from .file_contents import contents_of
from .listing import listing
from .reading import unnamed_arrays
from .stored_overview import OVERVIEW


def save(data: xr.Dataset, path: str | Path) -> None:
    """Write a manoeuvre or the states of a path to netCDF, sealed; an unfinished file never takes the name."""
    _save({"/": data}, Path(path))


def save_record(record: xr.DataTree, path: str | Path) -> None:
    """Write a flight record to netCDF, one group per leaf, sealed; `flighttest.read` reads it again without a name map."""
    groups = {"/": xr.Dataset(attrs=record.attrs)}
    _save({**groups, **{f"/{leaf}": node.to_dataset() for leaf, node in record.children.items()}}, Path(path))


def _save(groups: Mapping[str, xr.Dataset], target: Path) -> None:
    with written_atomically(target) as part:
        _write(groups, part)
        seal(part, OVERVIEW, _overview(part))


def _overview(part: Path) -> dict[str, Any] | None:
    """Return what `flight show` and `flight info` find in a file, read as it was written; without what they refuse to read."""
    found: dict[str, Any] = {}
    with suppress(AeromatchError):
        names = NameMap({})
        recording = open_recording(part, names)
        about = {"file": None, "format": FORMATS[recording.kind][1], **contents_of(recording, names, part)}
        if not any(table["clock_fault"] for table in about["tables"]):  # whose text names the file
            found["contents"] = about
        found["listing"] = listing(unnamed_arrays(recording, None, part))
    return found or None


def write_groups(groups: Mapping[str, xr.Dataset], target: Path) -> None:
    """Write groups of a netCDF file, all or none; time histories are compressed."""
    with written_atomically(target) as part:
        _write(groups, part)


def _write(groups: Mapping[str, xr.Dataset], part: Path) -> None:
    mode: Any = "w"
    for group, data in groups.items():
        packed = {
            str(n): {"zlib": True, "complevel": 4} for n, v in data.data_vars.items() if v.dims[-1:] == ("time",) and v.dtype.kind == "f"
        }
        data.to_netcdf(part, mode=mode, group=None if group == "/" else group.strip("/"), engine="h5netcdf", encoding=packed)
        mode = "a"
