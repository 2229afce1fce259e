"""The flight side of a case: reconstructed states over the window."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import flighttest
from flightmech.aircraft.aircraft import read_aircraft
from flightmech.errors import IdentificationError, OutOfRange, ParseError, SchemaError
from pom.cases.case import PomCase
from pom.cases.case_file import WIND
from pom.tolerances.channels import WRAPPED

CALIBRATION = "calibration"  # attribute of flight states and of the signals of a result: JSON
ERROR = "error."
"""Before the name of a channel: what one standard error of each constant of the instruments changes in it, dimensions (error, time)."""


def calibration_text(biases: xr.Dataset) -> str:
    """Return the corrections of a reconstruction as the JSON text that travels with its states.

    Parameters
    ----------
    biases : Dataset (parameter,)
        ``estimate``, ``stderr``, ``unit``, ``held``, from `flighttest.reconstruct` or
        `flighttest.reconstruction.open_biases`. Constants that were held are left out: nothing was
        corrected by them that the instrument's own specification does not state.
    """
    rows = [
        {
            "parameter": str(biases["parameter"].values[i]),
            "estimate": float(biases["estimate"].values[i]),
            "stderr": float(biases["stderr"].values[i]),
            "unit": str(biases["unit"].values[i]),
        }
        for i in np.flatnonzero(~biases["held"].values.astype(bool))
    ]
    return json.dumps(rows)


def flight_states(case: PomCase, path: Any = None) -> xr.Dataset:
    """Return the corrected flight states of a case over its window.

    Parameters
    ----------
    case : PomCase
    path : Path of flighttest.reconstruct, or Dataset (time), optional
        Reconstructed path of the record; without it `recorded_states`.

    Returns
    -------
    Dataset (time)
        States, controls, thrust, mass properties; the attribute ``calibration`` gives the
        corrections of the instruments. [SI]

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
            f"case {case.name}: the window {start:g} ... {stop:g} s lies outside the record "
            f"{time[0]:g} ... {time[-1]:g} s "
            f"({case.record}); choose one inside"
        )
    first, behind = (
        np.searchsorted(time, start - 1e-9),
        np.searchsorted(time, stop + 1e-9, side="right"),
    )
    inside = unwrap_angles(
        states.isel(time=slice(first, behind))
    )  # no copy: a batch holds the states of all its cases
    return (
        inside.assign(measured_wind(case, inside["time"].values))
        if case.wind == "measured"
        else inside
    )


def window_problem(case: PomCase) -> str:
    """Return what is wrong with the window of a case against its record; empty when it lies inside,
    or there is no record yet.
    """
    if not Path(case.record).is_file():
        return ""
    kept = read_path_states(case.record)
    if kept is not None:
        leaves = [kept]
    else:
        leaves = [
            leaf.to_dataset()
            for leaf in flighttest.read(case.record, names=case.names or None).children.values()
        ]
    times = [leaf["time"].values.astype(float) for leaf in leaves if leaf.sizes.get("time", 0) > 1]
    time = min(
        times, key=lambda time: float(np.median(np.diff(time)))
    )  # the fastest clock, on which the states are reconstructed
    first, last, step = float(time[0]), float(time[-1]), float(np.median(np.diff(time)))
    start, stop = case.window
    if start >= first - 0.5 * step and stop <= last + 0.5 * step:
        return ""
    return (
        f"case {case.path}: case.window {start:g} ... {stop:g} s lies outside the record "
        f"{first:g} ... {last:g} s; choose one inside"
    )


def _states(case: PomCase, path: Any) -> xr.Dataset:
    if path is None:
        return recorded_states(case)
    return path if isinstance(path, xr.Dataset) else _calibrated(path)


def _calibrated(path: Any) -> xr.Dataset:
    known = (
        {} if path.biases is None else {CALIBRATION: calibration_text(path.biases)}
    )  # states of another program hold no constants
    return _with_errors(path.states.assign_attrs(known), path.errors)


def _with_errors(states: xr.Dataset, errors: xr.Dataset | None) -> xr.Dataset:
    """Return states with what the constants of the instruments leave open in them, as variables
    named `ERROR` and the channel.
    """
    if errors is None:
        return states
    named = {
        f"{ERROR}{name}": (item.dims, item.values, item.attrs)
        for name, item in errors.data_vars.items()
    }
    return states.assign(named).assign_coords(error=errors["error"].values)


def measured_wind(case: PomCase, time: np.ndarray) -> dict[str, Any]:
    """Return the wind that the raw record of a case holds, on the clock of its states.

    Returns
    -------
    dict of str to (dimension, array (time,))
        ``wind_n``, ``wind_e`` and ``wind_d``, which is zero where none is recorded: velocity of the
        air mass. [m s-1]

    Raises
    ------
    SchemaError
        The record has no wind, or is a reconstructed path.
    """
    found = {}
    for leaf in flighttest.read(case.record, names=case.names or None).children.values():
        node = leaf.to_dataset()
        for name in (name for name in WIND if name in node):
            found[name] = "time", np.interp(time, node["time"].values, node[name].values)
    if not {"wind_n", "wind_e"} <= set(found):
        problem = (
            f'drive.wind: "measured", but {case.record} holds no wind_n and wind_e; map '
            f'them, or take the wind of the "record"'
        )
        raise SchemaError(f"case {case.path}", [problem])
    return {"wind_d": ("time", np.zeros(time.size)), **found}


def recorded_states(case: PomCase, biases: xr.Dataset | None = None) -> xr.Dataset:
    """Return the states of the record of a case: read when it is a reconstructed path,
    reconstructed when it is raw.

    Parameters
    ----------
    case : PomCase
    biases : Dataset, optional
        Constants of the instruments as other records give them
        (`flighttest.reconstruction.open_biases`), the prior of a reconstruction.  Without them a
        raw record has only itself and the class of its instruments.

    Raises
    ------
    SchemaError
        The record is raw and the case names no aircraft.
    IdentificationError
        The reconstruction does not settle.
    """
    found = read_path_states(case.record)
    if found is not None:
        return found
    if not case.aircraft:
        raise SchemaError(
            f"case {case.path}",
            [
                "case.aircraft: missing; the record has to be reconstructed, and that needs "
                "the aircraft"
            ],
        )
    record = flighttest.read(case.record, names=case.names or None)
    try:
        return _calibrated(
            flighttest.reconstruct(record, read_aircraft(case.aircraft), prior=biases)
        )
    except IdentificationError as error:
        hint = (
            "give the constants of the instruments from other records (--biases), or a "
            "reconstructed path as the record of the case"
        )
        raise IdentificationError(f"case {case.name}: {error}; {hint}") from error


def read_path_states(record: str) -> xr.Dataset | None:
    """Return the states of a file of reconstructed states, variables without attributes; None when
    it is something else.
    """
    if Path(record).suffix != ".nc":
        return None
    try:
        path = flighttest.dynamics.open_path(record, described=False)
    except ParseError:
        return None
    if not {"V", "alpha", "theta"} <= set(path.states.data_vars):
        return None
    return _calibrated(path)


def unwrap_angles(states: xr.Dataset) -> xr.Dataset:
    """Return the states with angles that jump by a full turn made continuous."""
    items = {name: states.variables[name] for name in states.data_vars}
    smooth = {
        name: (items[name].dims, np.unwrap(items[name].values), items[name].attrs)
        for name in WRAPPED & items.keys()
    }
    return xr.Dataset({**items, **smooth}, states.coords, states.attrs)
