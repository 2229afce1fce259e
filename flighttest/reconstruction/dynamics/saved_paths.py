"""Reconstructed flight paths read back from their files."""

from __future__ import annotations

import os
from dataclasses import dataclass

import h5py
import xarray as xr

from flightmech.errors import ParseError
from flightmech.support.hdf5_seal import decoding_errors, demand_self_contained
from flighttest.records.stored_groups import plain_group

_OPTIONAL_GROUPS = ("errors", "biases")
_EXPECTED = "a path as `aeromatch flight reconstruct -o` writes it"


@dataclass(frozen=True)
class SavedPath:
    """Part of a reconstruction that `coefficients` needs.

    Attributes
    ----------
    states : Dataset (time,)
        As in `flighttest.reconstruction.FlightPath`. [SI]
    errors : Dataset (error, time) or None
        Change of the states for one standard error of each independent error of the instruments.
        None if the file does not have this group.
    biases : Dataset (parameter,) or None
        Constants of the instruments, as in `flighttest.reconstruction.FlightPath`. None if the file
        does not have this group.
    """

    states: xr.Dataset
    errors: xr.Dataset | None = None
    biases: xr.Dataset | None = None


def open_path(path: str | os.PathLike, described: bool = True) -> SavedPath:
    """Return the content of a reconstruction file.

    The file has groups ``states``, ``errors`` and ``biases``, or states in its root.

    Parameters
    ----------
    path : path
    described : bool
        Whether the variables have their attributes. Without attributes a file of plain numbers is
        read faster.

    Raises
    ------
    ParseError
        The file is not a netCDF file, or has no states over time.
    """
    demand_self_contained(path)
    plain = _read_plain(path, described)
    if plain is not None:
        return plain
    with (
        decoding_errors(path, _EXPECTED),
        xr.open_datatree(path, engine="h5netcdf", decode_timedelta=False) as tree,
    ):
        states = tree.children.get("states", tree).to_dataset(inherit=False).load()
        groups = {}
        for name in _OPTIONAL_GROUPS:
            if name in tree.children:
                groups[name] = tree.children[name].to_dataset(inherit=False).load()
    if "time" not in states.dims:
        raise ParseError(str(path), 0, "no states over time", _EXPECTED)
    return SavedPath(states, **groups)


def _read_plain(path: str | os.PathLike, described: bool) -> SavedPath | None:
    """Return the content of a file of plain numbers; None for any other file.

    The general reader reads or refuses all other files.
    """
    groups = {}
    try:
        with h5py.File(path, "r") as file:
            states = plain_group(file.get("states", file), described)
            for name in _OPTIONAL_GROUPS:
                if name in file:
                    groups[name] = plain_group(file[name], described)
    except Exception:
        return None
    # `plain_group` returns None for a group that has more than plain numbers.
    if states is None or "time" not in states.dims:
        return None
    if any(group is None for group in groups.values()):
        return None
    return SavedPath(states, **groups)


def open_states(path: str | os.PathLike) -> xr.Dataset:
    """Return the states of a reconstruction file; raises as `open_path`."""
    return open_path(path).states
