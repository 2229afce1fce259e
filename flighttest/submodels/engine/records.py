"""Channels of an engine out of flight records, and settled points out of files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.air import atmosphere
from flightmech.errors import IdentificationError, UnknownName
from flightmech.quantities import time_text
from flightmech.support.arrays import true_runs
from flighttest.records.sensors.measurements import geometric_height
from flighttest.remarks import Convergence, warn_forbidden
from flighttest.submodels.engine.schedule import SAME, find_lever_rest

CHANNELS = (
    "throttle",
    "pla",
    "n1",
    "n2",
    "thrust",
    "fuel_flow",
    "itt",
    "starter",
    "cutoff",
    "ignition",
    "rpm",
    "torque",
    "manifold_pressure",
    "prop_command",
    "mixture",
    "feather",
)
FLIGHT = ("mach", "h", "temperature")
POINTS = ("n1", "n2", *FLIGHT, "thrust", "fuel_flow", "mass", "V", "V_dot", "h_dot", "CL", "alpha")
HEIGHTS = ("h", "h_baro", "h_gps")
MARGIN, STEP = 2000.0, 20.0  # of heights about those recorded [m]
P_STANDARD = 101325.0  # [Pa]
PASSES, MOST_PASSES = 5, 50  # least and largest number, over height and temperature
SAME_HEIGHT = 1.0  # change of the height at which these passes have converged [m]
FLOWING = 0.1  # Mach number from which on a thermometer has flow
GAMMA, R_AIR = 1.4, 287.05287  # [1], [J kg-1 K-1]


def engine_channels(
    states: xr.Dataset,
    engines: Sequence[int] = (1,),
    pla: tuple[float, float] | None = None,
    height: str | None = None,
) -> xr.Dataset:
    """Return what an engine did and the condition in which, as the functions of this package take
    it.

    Parameters
    ----------
    states : Dataset (time,)
        A cut record or reconstructed states: ``engineN.throttle`` or ``engineN.pla`` [rad],
        ``engineN.n1``, ``engineN.n2`` [1] ...; ``mach`` or ``V`` [m/s] and ``temperature`` [K];
        ``h``, ``h_baro`` or ``h_gps`` [m].
    engines : sequence of int
        Several are averaged.
    pla : (idle, full), optional
        Lever angles that are throttle 0 and 1, where the record has angles. [rad]
    height : str, optional
        Channel of the height; by default the first of ``h``, ``h_baro`` and ``h_gps`` that is
        there.

    Returns
    -------
    Dataset (time,)
        ``temperature`` is the standard temperature at the height plus the mean difference of the
        record from it at Mach numbers above 0.1, because a thermometer without flow does not show
        the air temperature.  ``h`` is geometric: the height at which air with this difference has
        the pressure of a pressure altitude ``h_baro``, which is geopotential; other heights are not
        changed. ``pressure_ratio`` is that pressure over the standard pressure at sea level.
        Attribute ``height_change`` of a pressure altitude: the last change of the height over its
        tolerance of 1 m, at most 1 if it converged.

    Raises
    ------
    UnknownName
        A channel that one of the engines lacks, or the height.
    IdentificationError
        Lever angles without their range.

    Warns
    -----
    AeromatchWarning
        Height and temperature do not converge.
    """
    # Every channel is the mean of the engines, so each engine needs it.
    present = [name for name in CHANNELS if f"engine{engines[0]}.{name}" in states]
    channels: dict[str, np.ndarray] = {}
    for name in present:
        for number in engines:
            if f"engine{number}.{name}" not in states:
                raise UnknownName(f"engine{number}.{name}", map(str, states.data_vars), "channel")
        channels[name] = np.mean(
            [states[f"engine{number}.{name}"].values for number in engines], axis=0
        )
    if "throttle" not in channels and "pla" in channels:
        if pla is None or pla[0] == pla[1]:
            raise IdentificationError(
                "the record has lever angles; give the angles of idle and full power as pla"
            )
        channels["throttle"] = (channels["pla"] - pla[0]) / (pla[1] - pla[0])
    channels.pop("pla", None)
    if height is not None and height not in states:
        raise UnknownName(height, map(str, states.data_vars), "channel")
    if not height:
        height = next((name for name in HEIGHTS if name in states), None)
    if height:
        channels["h"] = states[height].values
    # Without a Mach number, M = V / sqrt(gamma R T).
    if "mach" in states:
        channels["mach"] = states["mach"].values
    elif "V" in states and "temperature" in states:
        channels["mach"] = states["V"].values / np.sqrt(
            GAMMA * R_AIR * states["temperature"].values
        )
    attrs = dict(states.attrs)
    if "temperature" in states:
        air, convergence = _outside_air(
            states["temperature"].values, channels, barometric=height == "h_baro"
        )
        channels |= air
        if height == "h_baro":
            attrs["height_change"] = convergence.change
            advice = "the height of the engine points is wrong; check h_baro and temperature"
            warn_forbidden(convergence.remarks("height", advice, "h_baro"), "engine channels")
    columns = {name: ("time", values) for name, values in channels.items()}
    return xr.Dataset(columns, {"time": states["time"].values}, attrs)


def _outside_air(
    reading: np.ndarray, channels: Mapping[str, np.ndarray], barometric: bool
) -> tuple[dict[str, np.ndarray], Convergence]:
    """Return temperature [K], height [m] and pressure ratio, and the convergence of the height.

    The sources are a thermometer and a height.
    """
    if "h" not in channels:
        return {"temperature": reading}, Convergence(True, 0, 0.0)
    h = channels["h"]
    if barometric:
        # A pressure altitude is geopotential; `atmosphere` takes the geometric height.
        h = geometric_height(h)
    log_pressure = np.log(np.asarray(atmosphere(h).p_static))
    flying = np.zeros(len(reading), bool)
    if "mach" in channels:
        flying = channels["mach"] > FLOWING
    used = flying if flying.any() else slice(None)
    convergence = Convergence(True, 1, 0.0)
    # The temperature difference depends on the height, and the height on the difference.
    for count in range(1, MOST_PASSES + 1):
        standard = np.asarray(atmosphere(h).temperature)
        warmer = float(np.mean((reading - standard)[used]))
        if not barometric:
            break
        before = h
        grid = np.arange(h.min() - MARGIN, h.max() + MARGIN, STEP)
        grid_pressure = np.log(np.asarray(atmosphere(grid, delta_T=warmer).p_static))
        # Pressure falls with height; the minus signs make it rise for the interpolation.
        h = np.interp(-log_pressure, -grid_pressure, grid)
        change = float(np.abs(h - before).max()) / SAME_HEIGHT
        convergence = Convergence(change <= 1.0, count, change)
        if convergence.converged and count >= PASSES:
            break
    air = atmosphere(h, delta_T=warmer)
    columns = {
        "temperature": np.asarray(air.temperature),
        "h": h,
        "pressure_ratio": np.asarray(air.p_static) / P_STANDARD,
    }
    return columns, convergence


def read_points(path: str | Path) -> xr.Dataset:
    """Return settled points from a CSV file whose columns are quantities in SI units.

    Parameters
    ----------
    path : str or Path
        Columns among ``n1 n2 mach h temperature thrust fuel_flow mass V V_dot h_dot CL alpha``.

    Raises
    ------
    UnknownName
        Another column.
    """
    table = pd.read_csv(path, comment="#")
    for name in table.columns:
        if name not in POINTS:
            raise UnknownName(str(name), POINTS, "column")
    return xr.Dataset({name: ("point", table[name].values.astype(float)) for name in table.columns})


# Time for which lever and speeds must have been at rest. [s]
SETTLED = 2.0
# Range of the speed of a spool at rest.
STEADY = 0.01
# Time at rest at both ends of a power change. [s]
WINDOW_MARGIN = 1.0
# Smallest range of the throttle of a power change.
LEAST = 0.3


def power_changes(
    record: xr.Dataset, least: float = LEAST, longest: float = 90.0
) -> list[xr.Dataset]:
    """Return the power changes of a flight, each from one settled state of the engine to another.

    Parameters
    ----------
    record : Dataset (time,)
        ``throttle`` and ``n2`` [1] on a uniform clock, as `engine_channels` returns them.  The
        engine is in a steady state at its begin: if the lever moves in the first second, the first
        sample is repeated before it.
    least : float
        Smallest range of the throttle.
    longest : float
        Longer changes are omitted, because the lever moves on and on. [s]

    Returns
    -------
    list of Dataset (time,)
        Attribute ``record`` contains the time of the begin. The list may be empty.

    Raises
    ------
    IdentificationError
        ``throttle`` or ``n2`` is missing.
    """
    missing = [name for name in ("throttle", "n2") if name not in record]
    if missing:
        raise IdentificationError(
            f"power changes are found by throttle and n2; the record lacks {' '.join(missing)}"
        )
    time = record["time"].values
    step = float(np.median(np.diff(time)))
    still = find_lever_rest(record, SETTLED, SAME)
    for name in ("n1", "n2"):
        if name in record:
            still &= find_lever_rest(record.assign(throttle=record[name]), SETTLED, STEADY)
    margin = round(WINDOW_MARGIN / step)
    changes = []
    for begin, end in moving_ranges(still, 2 * margin):
        part = np.arange(begin - margin, min(end + margin, len(time)))
        # Negative indices repeat the first sample.
        change = record.isel(time=np.maximum(part, 0)).assign_coords(time=time[0] + step * part)
        if np.ptp(change["throttle"].values) < least or len(part) * step > longest:
            continue
        name = (
            f"{record.attrs.get('record', 'record')} from {time_text(time[max(part[0], 0)], 4)} s"
        )
        changes.append(change.assign_attrs(record=name))
    return changes


def moving_ranges(still: np.ndarray, least: int) -> list[tuple[int, int]]:
    """Return begin and end of the motions; a rest of fewer than `least` samples does not count."""
    joined: list[tuple[int, int]] = []
    for begin, end in true_runs(~still):
        if joined and begin - joined[-1][1] < least:
            joined[-1] = joined[-1][0], end
        else:
            joined.append((begin, end))
    return joined
