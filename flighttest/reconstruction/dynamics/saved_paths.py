"""Reconstructed flight paths read back from their files."""

from __future__ import annotations

import os
from dataclasses import dataclass

import h5py
import numpy as np
import xarray as xr

from flightmech.errors import ParseError
from flightmech.short_text import ShortText
from flightmech.support.hdf5_seal import decoding_errors, demand_self_contained
from flighttest.records.stored_groups import plain_group

# kinds of NumPy types: truth values, integers, floating-point numbers
_NUMBERS = "biuf"
_DATES = "mM"  # kinds of durations and dates
_OPTIONAL_GROUPS = ("errors", "biases")
_EXPECTED = "a path as `aeromatch flight reconstruct -o` writes it"


@dataclass(frozen=True)
class SavedPath(ShortText):
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
    saved = _read_plain(path, described) or _read_any(path)
    if fault := _find_fault(saved):
        raise ParseError(str(path), 0, fault, _EXPECTED)
    return saved


def _read_any(path: str | os.PathLike) -> SavedPath:
    """Return the content of a file with any variables."""
    with (
        decoding_errors(path, _EXPECTED),
        xr.open_datatree(
            path, engine="h5netcdf", phony_dims="access", decode_timedelta=False
        ) as tree,
    ):
        states = tree.children.get("states", tree).to_dataset(inherit=False).load()
        groups = {}
        for name in _OPTIONAL_GROUPS:
            if name in tree.children:
                groups[name] = tree.children[name].to_dataset(inherit=False).load()
    return SavedPath(states, **groups)


def _find_fault(saved: SavedPath) -> str:
    """Return what makes the content useless, an empty text for nothing.

    A later computation would stop at it, or would take numbers of one time for those of another.
    """
    states, errors = saved.states, saved.errors
    if "time" not in states.dims or "time" not in states.indexes:
        return "no states over time"
    time = states["time"].values
    if time.dtype.kind not in _NUMBERS or not np.all(np.isfinite(time)):
        return "a time that is not a number"
    if np.any(np.diff(time) <= 0.0):
        return "a time that does not increase"
    for name, state in states.data_vars.items():
        if state.dims == ("time",) and state.dtype.kind not in _NUMBERS + _DATES:
            return f"the state {name} that is not a number"
    if errors is None:
        return ""
    if "error" not in errors.indexes or not errors.indexes["error"].is_unique:
        return "errors without a name of their own"
    if "time" not in errors.indexes or not np.array_equal(errors["time"].values, time):
        return "errors of the states at other times than the states"
    for name, change in errors.data_vars.items():
        if change.dims != ("error", "time") or change.dtype.kind not in _NUMBERS:
            return f"the error of {name} that is not a number for each error and time"
    return ""


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
