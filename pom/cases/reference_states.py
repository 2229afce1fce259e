"""Flight side of a case: reconstructed states over the window."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import flighttest
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.aircraft.controls import DEVICE
from flightmech.errors import IdentificationError, OutOfRange, ParseError, SchemaError
from flightmech.names import WRAPPED
from flightmech.quantities import time_text
from flightmech.support.array_files.labelled_arrays import make_variable
from flighttest.reconstruction.path_quantities import CHANNEL_GAPS
from flighttest.records.signals.clock_gaps import clock_gaps, gap_text, gaps_in
from pom.cases.case import PomCase, driven_quantities
from pom.cases.case_file import BRAKES, WIND

CALIBRATION = "calibration"  # attribute of flight states and of the signals of a result: JSON
RECORD_SPAN = "record_span"  # attribute of flight states: start and end of their record [s]
ERROR = "error."
"""Prefix of the change of a channel by one standard error of each instrument constant.

The dimensions are (error, time).
"""
GAP_REMEDY = "restore the missing samples, or choose a window before or after the gap"
_LEVER_ENDS = (".throttle", ".pla")
_TIME_ROUNDING = 1e-9  # [s] a sample at a bound of the window may be off by a rounding error


def calibration_text(biases: xr.Dataset) -> str:
    """Return the corrections of a reconstruction as the JSON text in its states.

    Parameters
    ----------
    biases : Dataset (parameter,)
        ``estimate``, ``stderr``, ``unit``, ``held``, from `flighttest.reconstruct` or
        `flighttest.reconstruction.open_biases`.  The text omits fixed constants: their correction
        is that of the specification of the instrument.
    """
    rows = []
    for i in np.flatnonzero(~biases["held"].values.astype(bool)):
        row = {
            "parameter": str(biases["parameter"].values[i]),
            "estimate": float(biases["estimate"].values[i]),
            "stderr": float(biases["stderr"].values[i]),
            "unit": str(biases["unit"].values[i]),
        }
        rows.append(row)
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
        corrections of the instruments, the attribute ``record_span`` start and end of the record.
        [SI]

    Raises
    ------
    OutOfRange
        The window is not inside the record.
    SchemaError
        The record needs reconstruction and the case names no aircraft, or time does not rise.
    """
    states = whole_states(case, path)
    time = states["time"].values.astype(float)
    if time.size < 2 or not (np.diff(time) > 0.0).all():
        raise SchemaError(f"record {case.record}", ["time does not rise from sample to sample"])
    start, stop = case.window
    if not _is_inside(case.window, time):
        raise OutOfRange(
            f"case {case.name}: the window {time_text(start)} ... {time_text(stop)} s lies outside "
            "the record "
            f"{time_text(time[0])} ... {time_text(time[-1])} s ({case.record}); choose one inside"
        )
    first = np.searchsorted(time, start - _TIME_ROUNDING)
    end = np.searchsorted(time, stop + _TIME_ROUNDING, side="right")
    # A slice is a view: a batch holds the states of all its cases.
    inside = unwrap_angles(states.isel(time=slice(first, end)))
    inside = inside.assign_attrs({RECORD_SPAN: (float(time[0]), float(time[-1]))})
    if case.wind == "measured":
        return inside.assign(measured_wind(case, inside["time"].values))
    return inside


def refusal_of(case: PomCase, record: xr.Dataset) -> str:
    """Return why no model can fly a case: a gap of states or inputs; empty without one.

    Parameters
    ----------
    case : PomCase
    record : Dataset (time,)
        States of the whole record. [SI] Their attribute ``channel_gaps`` gives the gaps of recorded
        channels.  A gap counts in the window, and for channels that drive the case.
    """
    time = np.asarray(record["time"].values, float)
    if time.size < 2:
        return ""
    # the grid of the states ends up to a step before the last sample of the record
    step = float(np.median(np.diff(time)))
    inner = (case.window[0] + step, case.window[1] - step)
    gaps = gaps_in(inner, clock_gaps(time))
    text = ""
    if gaps:
        text = gap_text(gaps[0])
    else:
        # other channels may have a clock of their own
        by_channel = json.loads(record.attrs.get(CHANNEL_GAPS, "{}"))
        for gap, channels in _drive_gaps(case, inner, by_channel).items():
            text = f"{gap_text(gap)} of {', '.join(channels)}"
            break
    if not text:
        return ""
    return (
        f"not flown: record {Path(case.record).stem} has {text}, inside the window "
        f"{time_text(case.window[0])} ... {time_text(case.window[1])} s, and nothing shows the "
        "inputs in it; "
        f"{GAP_REMEDY}"
    )


def drives(case: PomCase, channel: str) -> bool:
    """Return whether a channel of the record drives the models of a case.

    A value of the case file replaces the channel.  The math pilot adds to the recorded control, so
    that this one drives as well.
    """
    if channel in case.conditions:
        return False
    if channel.startswith(DEVICE):
        return True
    if channel in WIND:
        return case.wind == "measured"
    piloted = {loop.control for loop in case.drive.pilot}
    if "throttle" in piloted and channel.endswith(_LEVER_ENDS):
        return True
    names = driven_quantities(case) | piloted
    # one recorded brake drives both sides
    return channel in names or (channel == "brake" and not names.isdisjoint(BRAKES))


def _drive_gaps(
    case: PomCase, window: tuple[float, float], gaps: Mapping[str, Sequence[tuple[float, float]]]
) -> dict[tuple[float, float], list[str]]:
    """Return the gaps of driving channels in a window, in order, with their channels. [s]

    Parameters
    ----------
    case : PomCase
    window : (float, float)
        [s]
    gaps : mapping of str to sequence of (float, float)
        By channel of the record. [s]
    """
    channels: dict[tuple[float, float], list[str]] = {}
    for name, spans in gaps.items():
        if not drives(case, name):
            continue
        for start, stop in gaps_in(window, spans):
            channels.setdefault((start, stop), []).append(name)
    return dict(sorted(channels.items()))


def _is_inside(window: tuple[float, float], time: np.ndarray) -> bool:
    """Return whether a window lies inside a record, up to half a time step."""
    half_step = 0.5 * float(np.median(np.diff(time)))
    return window[0] >= time[0] - half_step and window[1] <= time[-1] + half_step


def window_problem(case: PomCase, leaves: Sequence[xr.Dataset] | None = None) -> str:
    """Return the problem of a window outside its record, or of a record without a clock.

    Empty if the window lies inside the record, or if the record does not exist yet.  `leaves` are
    those of `record_leaves`, if they are in memory.
    """
    if leaves is None:
        leaves = record_leaves(case)
    if not leaves:
        return ""
    time = _fastest_clock(leaves)
    if time is None:
        return (
            f"case {case.path}: the record {case.record} has fewer than two samples on every "
            f"clock; give a record that covers the window"
        )
    if _is_inside(case.window, time):
        return ""
    start, stop = case.window
    return (
        f"case {case.path}: case.window {time_text(start)} ... {time_text(stop)} s lies outside "
        "the record "
        f"{time_text(time[0])} ... {time_text(time[-1])} s; choose one inside"
    )


def record_leaves(case: PomCase) -> list[xr.Dataset]:
    """Return the states of a reconstructed path, or the groups of channels of a raw record.

    Empty if the record does not exist yet.
    """
    if not Path(case.record).is_file():
        return []
    states = read_path_states(case.record)
    if states is not None:
        return [states]
    record = flighttest.read(case.record, names=case.names or None)
    return [leaf.to_dataset() for leaf in record.children.values()]


def join_channels(leaves: Sequence[xr.Dataset], names: Iterable[str]) -> xr.Dataset | None:
    """Return channels of a record as recorded, on its fastest clock; None without a clock. [SI]

    Parameters
    ----------
    leaves : sequence of Dataset (time,)
        Of `record_leaves`.
    names : iterable of str
        Those that the record lacks, or that hold no value, are left out.
    """
    clock = _fastest_clock(leaves)
    if clock is None:
        return None
    channels = {}
    for name in names:
        leaf = next((item for item in leaves if name in item), None)
        if leaf is None or leaf[name].dims != ("time",):
            continue
        values = leaf[name].values.astype(float)
        known = np.isfinite(values)
        if known.any():
            channels[name] = "time", np.interp(clock, leaf["time"].values[known], values[known])
    return xr.Dataset(channels, {"time": clock})


def _fastest_clock(leaves: Sequence[xr.Dataset]) -> np.ndarray | None:
    """Return the clock of the states of a record, or None if no clock has two samples. [s]

    The states of a raw record are reconstructed on its fastest clock.
    """
    times = [leaf["time"].values.astype(float) for leaf in leaves if leaf.sizes.get("time", 0) > 1]
    return min(times, key=lambda time: float(np.median(np.diff(time))), default=None)


def whole_states(case: PomCase, path: Any = None) -> xr.Dataset:
    """Return the states of the whole record of a case; parameters and errors as `flight_states`."""
    if path is None:
        return recorded_states(case)
    if isinstance(path, xr.Dataset):
        return path
    return _path_states(path)


def _path_states(path: Any) -> xr.Dataset:
    """Return the states of a reconstructed path with its corrections and their errors."""
    attributes = {}
    # the states of another program have no instrument constants
    if path.biases is not None:
        attributes[CALIBRATION] = calibration_text(path.biases)
    return _with_errors(path.states.assign_attrs(attributes), path.errors)


def _with_errors(states: xr.Dataset, errors: xr.Dataset | None) -> xr.Dataset:
    """Return states with the errors of the instrument constants as variables named `ERROR`."""
    if errors is None:
        return states
    named = {}
    for name, item in errors.data_vars.items():
        named[f"{ERROR}{name}"] = (item.dims, item.values, item.attrs)
    return states.assign(named).assign_coords(error=errors["error"].values)


def measured_wind(case: PomCase, time: np.ndarray) -> dict[str, Any]:
    """Return the recorded wind of a raw record, on the clock of its states.

    Returns
    -------
    dict of str to (dimension, array (time,))
        ``wind_n``, ``wind_e`` and ``wind_d``: velocity of the air mass.  ``wind_d`` is zero if the
        record has none. [m s-1]

    Raises
    ------
    SchemaError
        The record has no wind, or is a reconstructed path.
    """
    # a sensor group of the record may have its own clock
    wind = {}
    for leaf in flighttest.read(case.record, names=case.names or None).children.values():
        node = leaf.to_dataset()
        for name in WIND:
            if name in node:
                wind[name] = "time", np.interp(time, node["time"].values, node[name].values)
    if not {"wind_n", "wind_e"} <= set(wind):
        problem = (
            f'drive.wind: "measured", but {case.record} holds no wind_n and wind_e; map them, or '
            f'take the wind of the "record"'
        )
        raise SchemaError(f"case {case.path}", [problem])
    return {"wind_d": ("time", np.zeros(time.size)), **wind}


def recorded_states(case: PomCase, biases: xr.Dataset | None = None) -> xr.Dataset:
    """Return the states of the record of a case.

    A reconstructed path is read, a raw record is reconstructed.

    Parameters
    ----------
    case : PomCase
    biases : Dataset, optional
        Instrument constants from other records (`flighttest.reconstruction.open_biases`), the
        prior of a reconstruction.  Without them the prior is the class of the instruments.

    Raises
    ------
    SchemaError
        The record is raw and the case names no aircraft.
    IdentificationError
        The reconstruction does not converge.
    """
    states = read_path_states(case.record)
    if states is not None:
        return states
    if not case.aircraft:
        problem = (
            "case.aircraft: missing; the record has to be reconstructed, and that needs the "
            "aircraft"
        )
        raise SchemaError(f"case {case.path}", [problem])
    record = flighttest.read(case.record, names=case.names or None)
    aircraft = read_aircraft(case.aircraft)
    try:
        return _path_states(flighttest.reconstruct(record, aircraft, prior=biases))
    except IdentificationError as error:
        hint = (
            "give the constants of the instruments from other records (--biases), or a "
            "reconstructed path as the record of the case"
        )
        raise IdentificationError(f"case {case.name}: {error}; {hint}") from error


def read_path_states(record: str) -> xr.Dataset | None:
    """Return the states of a reconstructed path, or None if the file is of another kind.

    The variables have no attributes.
    """
    if Path(record).suffix != ".nc":
        return None
    try:
        path = flighttest.dynamics.open_path(record, described=False)
    except ParseError:
        return None
    # a path without these states cannot start a model
    if not {"V", "alpha", "theta"} <= set(path.states.data_vars):
        return None
    return _path_states(path)


def unwrap_angles(states: xr.Dataset) -> xr.Dataset:
    """Return the states with angles that jump by a full turn made continuous."""
    items = {name: states.variables[name] for name in states.data_vars}
    continuous = {}
    for name in WRAPPED & items.keys():
        item = items[name]
        continuous[name] = make_variable(item.dims, np.unwrap(item.values), item.attrs)
    return xr.Dataset({**items, **continuous}, states.coords, states.attrs)
