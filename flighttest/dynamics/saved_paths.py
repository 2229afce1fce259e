"""Reconstructed flight paths read back from their files."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import xarray as xr

from flightmech.errors import ParseError
from flightmech.support.input_files.self_contained import demand_self_contained

from ..records.plain_groups import plain_group


@dataclass(frozen=True)
class SavedPath:
    """What `coefficients` needs of a reconstruction.

    Attributes
    ----------
    states : Dataset (time,)
        As of `flighttest.reconstruction.Path`. [SI]
    errors : Dataset (error, time) or None
        Change of the states for one standard error of each independent error of the instruments; None when the file has none.
    """

    states: xr.Dataset
    errors: xr.Dataset | None = None


def open_path(path: str | os.PathLike) -> SavedPath:
    """Return states and errors of a reconstruction file: groups ``states`` and ``errors`` of it, or states in its root.

    Raises
    ------
    ParseError
        Not a netCDF file, or one without states over time.
    """
    demand_self_contained(path)
    plain = _plain(path)
    if plain is not None:
        return plain
    try:
        with xr.open_datatree(path, engine="h5netcdf", decode_timedelta=False) as tree:
            states = tree.children.get("states", tree).to_dataset(inherit=False).load()
            errors = tree.children["errors"].to_dataset(inherit=False).load() if "errors" in tree.children else None
    except (OSError, ValueError, KeyError) as error:
        if not Path(path).exists():
            raise
        raise ParseError(str(path), 0, f"no netCDF-4 content ({error})", "a path as `aeromatch flight reconstruct -o` writes it") from error
    if "time" not in states.dims:
        raise ParseError(str(path), 0, "no states over time", "a path as `aeromatch flight reconstruct -o` writes it")
    return SavedPath(states, errors)


def _plain(path: str | os.PathLike) -> SavedPath | None:
    """Return what a file of plain numbers holds; None of any other, which xarray reads or refuses."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            states = plain_group(file.get("states", file))
            errors = plain_group(file["errors"]) if "errors" in file else None
            whole = states is not None and "time" in states.dims and (errors is not None or "errors" not in file)
    except (OSError, RuntimeError, ValueError, KeyError, TypeError, AttributeError):
        return None
    return SavedPath(states, errors) if states is not None and whole else None


def open_states(path: str | os.PathLike) -> xr.Dataset:
    """Return the states of a reconstruction file alone; errors as of `open_path`."""
    return open_path(path).states
