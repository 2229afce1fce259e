"""The flight side of a case: reconstructed states over the window."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import OutOfRange, SchemaError

from .case import PomCase
from .channels import WRAPPED


def flight_states(case: PomCase, path: Any = None) -> xr.Dataset:
    """Return the corrected flight states of a case over its window.

    Parameters
    ----------
    case : PomCase
    path : Path of flighttest.reconstruct, or Dataset (time), optional
        Reconstructed path of the record.  Without it the record is read and reconstructed, or, when it is a netCDF
        file of a reconstructed path, read only.

    Returns
    -------
    Dataset (time)
        States, controls, thrust, mass properties. [SI]

    Raises
    ------
    OutOfRange
        The window is not inside the record.
    SchemaError
        The record names no aircraft and needs reconstruction, or time does not rise.
    """
    states = _states(case, path)
    time = states["time"].values.astype(float)
    if time.size < 2 or not (np.diff(time) > 0.0).all():
        raise SchemaError(f"record {case.record}", ["time does not rise from sample to sample"])
    start, stop = case.window
    step = float(np.median(np.diff(time)))
    if start < time[0] - 0.5 * step or stop > time[-1] + 0.5 * step:
        raise OutOfRange(
            f"case {case.name}: the window {start:g} ... {stop:g} s lies outside the record {time[0]:g} ... {time[-1]:g} s "
            f"({case.record}); choose one inside"
        )
    return unwrapped(states.isel(time=(time >= start - 1e-9) & (time <= stop + 1e-9)))


def _states(case: PomCase, path: Any) -> xr.Dataset:
    if path is not None:
        return path if isinstance(path, xr.Dataset) else path.states
    if Path(case.record).suffix == ".nc":
        with xr.open_dataset(case.record, engine="h5netcdf") as found:
            if {"V", "alpha", "theta"} <= set(found.data_vars):
                return found.load()
    if not case.aircraft:
        raise SchemaError(f"case {case.path}", ["case.aircraft: missing; the record has to be reconstructed, and that needs the aircraft"])
    import flighttest
    from flightmech import read_aircraft

    record = flighttest.read(case.record, names=case.names or None)
    return flighttest.reconstruct(record, read_aircraft(case.aircraft)).states


def unwrapped(states: xr.Dataset) -> xr.Dataset:
    """Return the states with angles that jump by a full turn made continuous."""
    names = WRAPPED & set(map(str, states.data_vars))
    return states.assign({name: (states[name].dims, np.unwrap(states[name].values), states[name].attrs) for name in names})
