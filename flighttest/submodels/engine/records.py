"""Channels of an engine out of flight records, and settled points out of files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.air import atmosphere
from flightmech.errors import IdentificationError, UnknownName
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
)
FLIGHT = ("mach", "h", "temperature")
POINTS = ("n1", "n2", *FLIGHT, "thrust", "fuel_flow", "mass", "V", "V_dot", "h_dot", "CL", "alpha")
HEIGHTS = ("h", "h_baro", "h_gps")
MARGIN, STEP = 2000.0, 20.0  # of heights about those recorded [m]
P_STANDARD = 101325.0  # [Pa]
PASSES = 5  # over height and temperature
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
        ``temperature`` is the standard one at the height plus the mean difference of the record
        from it where the Mach number is above 0.1: a thermometer without flow does not show the
        air.  ``h`` is the height at which the air so much warmer has the pressure of a pressure
        altitude ``h_baro``, other heights are taken as they are; ``pressure_ratio`` is that
        pressure.

    Raises
    ------
    UnknownName
        A channel that one of the engines lacks, or the height.
    IdentificationError
        Lever angles without their range.
    """
    present = [name for name in CHANNELS if f"engine{engines[0]}.{name}" in states]
    found: dict[str, np.ndarray] = {}
    for name in present:
        for number in engines:
            if f"engine{number}.{name}" not in states:
                raise UnknownName(f"engine{number}.{name}", map(str, states.data_vars), "channel")
        found[name] = np.mean(
            [states[f"engine{number}.{name}"].values for number in engines], axis=0
        )
    if "throttle" not in found and "pla" in found:
        if pla is None or pla[0] == pla[1]:
            raise IdentificationError(
                "the record has lever angles; give the angles of idle and full power as pla"
            )
        found["throttle"] = (found["pla"] - pla[0]) / (pla[1] - pla[0])
    found.pop("pla", None)
    if height is not None and height not in states:
        raise UnknownName(height, map(str, states.data_vars), "channel")
    height = height or next((name for name in HEIGHTS if name in states), None)
    if height:
        found["h"] = states[height].values
    if "mach" in states:
        found["mach"] = states["mach"].values
    elif "V" in states and "temperature" in states:
        found["mach"] = states["V"].values / np.sqrt(GAMMA * R_AIR * states["temperature"].values)
    if "temperature" in states:
        found |= _outside_air(states["temperature"].values, found, height == "h_baro")
    return xr.Dataset(
        {name: ("time", values) for name, values in found.items()},
        {"time": states["time"].values},
        dict(states.attrs),
    )


def _outside_air(
    reading: np.ndarray, found: Mapping[str, np.ndarray], barometric: bool
) -> dict[str, np.ndarray]:
    """Temperature [K], height [m] and pressure ratio from a thermometer and a height."""
    if "h" not in found:
        return {"temperature": reading}
    h = found["h"]
    pressure = np.log(np.asarray(atmosphere(h).p_static))  # of a pressure altitude
    flying = found["mach"] > FLOWING if "mach" in found else np.zeros(len(reading), bool)
    for _ in range(PASSES if barometric else 1):
        standard = np.asarray(atmosphere(h).temperature)
        warmer = float(np.mean((reading - standard)[flying if flying.any() else slice(None)]))
        if barometric:
            grid = np.arange(h.min() - MARGIN, h.max() + MARGIN, STEP)
            h = np.interp(
                -pressure, -np.log(np.asarray(atmosphere(grid, delta_T=warmer).p_static)), grid
            )
    air = atmosphere(h, delta_T=warmer)
    return {
        "temperature": np.asarray(air.temperature),
        "h": h,
        "pressure_ratio": np.asarray(air.p_static) / P_STANDARD,
    }


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


SETTLED = 2.0  # time over which lever and speeds must have rested [s]
STEADY = 0.01  # range of a spool's speed that counts as rest
WINDOW_MARGIN = 1.0  # at rest, kept at both ends [s]
LEAST = 0.3  # range of the throttle that counts as a power change


def power_changes(
    record: xr.Dataset, least: float = LEAST, longest: float = 90.0
) -> list[xr.Dataset]:
    """Return the power changes of a flight, each from one settled state of the engine to another.

    Parameters
    ----------
    record : Dataset (time,)
        ``throttle`` and ``n2`` [1] on a uniform clock, as `engine_channels` returns them.  It
        counts as begun with the engine settled: where the lever moves in its first second, the
        first sample is held before.
    least : float
        Smallest range of the throttle.
    longest : float
        Changes that last longer are left out: a lever that moves on and on. [s]

    Returns
    -------
    list of Dataset (time,)
        Attribute ``record`` with the time at which it begins; empty when there is none.

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
    found = []
    for begin, end in _moving(still, 2 * margin):
        part = np.arange(begin - margin, min(end + margin, len(time)))
        change = record.isel(time=np.maximum(part, 0)).assign_coords(time=time[0] + step * part)
        if np.ptp(change["throttle"].values) < least or len(part) * step > longest:
            continue
        name = f"{record.attrs.get('record', 'record')} from {time[max(part[0], 0)]:.4g} s"
        found.append(change.assign_attrs(record=name))
    return found


def _moving(still: np.ndarray, least: int) -> list[tuple[int, int]]:
    """Begin and end of what is not at rest; a rest of fewer than `least` samples does not count."""
    edges = np.flatnonzero(np.diff(np.concatenate([[True], still, [True]]).astype(int))).reshape(
        -1, 2
    )
    joined: list[tuple[int, int]] = []
    for begin, end in edges.tolist():
        if joined and begin - joined[-1][1] < least:
            joined[-1] = joined[-1][0], end
        else:
            joined.append((begin, end))
    return joined
