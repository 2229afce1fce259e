"""Reconstructed flight paths read back from their files."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import h5py
import xarray as xr

from flightmech.errors import ParseError
from flightmech.support.hdf5_seal import demand_self_contained
from flighttest.records.stored_groups import plain_group


@dataclass(frozen=True)
class SavedPath:
    """What `coefficients` needs of a reconstruction.

    Attributes
    ----------
    states : Dataset (time,)
        As of `flighttest.reconstruction.FlightPath`. [SI]
    errors : Dataset (error, time) or None
        Change of the states for one standard error of each independent error of the instruments;
        None when the file has none.
    biases : Dataset (parameter,) or None
        Constants of the instruments, as of `flighttest.reconstruction.FlightPath`; None when the file has
        none.
    """

    states: xr.Dataset
    errors: xr.Dataset | None = None
    biases: xr.Dataset | None = None


def open_path(path: str | os.PathLike, described: bool = True) -> SavedPath:
    """Return what a reconstruction file holds: its groups ``states``, ``errors`` and ``biases``, or
    states in its root.

    Parameters
    ----------
    path : path
    described : bool
        With the attributes of the variables; without them a file of plain numbers is read in two
        thirds of the time.

    Raises
    ------
    ParseError
        Not a netCDF file, or one without states over time.
    """
    demand_self_contained(path)
    plain = _plain(path, described)
    if plain is not None:
        return plain
    try:
        with xr.open_datatree(path, engine="h5netcdf", decode_timedelta=False) as tree:
            states = tree.children.get("states", tree).to_dataset(inherit=False).load()
            rest = {
                name: tree.children[name].to_dataset(inherit=False).load()
                for name in _REST
                if name in tree.children
            }
    except (OSError, ValueError, KeyError) as error:
        if not Path(path).exists():
            raise
        raise ParseError(
            str(path),
            0,
            f"no netCDF-4 content ({error})",
            "a path as `aeromatch flight reconstruct -o` writes it",
        ) from error
    if "time" not in states.dims:
        raise ParseError(
            str(path),
            0,
            "no states over time",
            "a path as `aeromatch flight reconstruct -o` writes it",
        )
    return SavedPath(states, **rest)


_REST = ("errors", "biases")


def _plain(path: str | os.PathLike, described: bool) -> SavedPath | None:
    """Return what a file of plain numbers holds; None of any other, which xarray reads or refuses."""

    try:
        with h5py.File(path, "r") as file:
            states = plain_group(file.get("states", file), described)
            rest = {name: plain_group(file[name], described) for name in _REST if name in file}
    except (OSError, RuntimeError, ValueError, KeyError, TypeError, AttributeError):
        return None
    whole = (
        states is not None
        and "time" in states.dims
        and all(found is not None for found in rest.values())
    )
    return SavedPath(states, **rest) if states is not None and whole else None


def open_states(path: str | os.PathLike) -> xr.Dataset:
    """Return the states of a reconstruction file alone; errors as of `open_path`."""
    return open_path(path).states
