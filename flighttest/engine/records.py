"""Channels of an engine out of flight records, and settled points out of files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from flightmech.air import atmosphere
from flightmech.errors import IdentificationError, UnknownName

CHANNELS = ("throttle", "pla", "n1", "n2", "thrust", "fuel_flow", "itt", "starter", "cutoff", "ignition")
FLIGHT = ("mach", "h", "temperature")
POINTS = ("n1", "n2", *FLIGHT, "thrust", "fuel_flow", "mass", "V", "V_dot", "h_dot", "CL", "alpha")
HEIGHTS = ("h", "h_baro", "h_gps")
MARGIN, STEP = 2000.0, 20.0  # of heights about those recorded [m]
P_STANDARD = 101325.0  # [Pa]
PASSES = 5  # over height and temperature
FLOWING = 0.1  # Mach number from which on a thermometer has flow
GAMMA, R_AIR = 1.4, 287.05287  # [1], [J kg-1 K-1]


def engine_channels(
    states: xr.Dataset, engines: Sequence[int] = (1,), pla: tuple[float, float] | None = None, height: str | None = None
) -> xr.Dataset:
    """Return what an engine did and the condition in which, as the functions of this package take it.

    Parameters
    ----------
    states : Dataset (time,)
        A cut record or reconstructed states: ``engineN.throttle`` or ``engineN.pla`` [rad], ``engineN.n1``, ``engineN.n2`` [1] ...;
        ``mach`` or ``V`` [m/s] and ``temperature`` [K]; ``h``, ``h_baro`` or ``h_gps`` [m].
    engines : sequence of int
        Several are averaged.
    pla : (idle, full), optional
        Lever angles that are throttle 0 and 1, where the record has angles. [rad]
    height : str, optional
        Channel of the height; by default the first of ``h``, ``h_baro`` and ``h_gps`` that is there.

    Returns
    -------
    Dataset (time,)
        ``temperature`` is the standard one at the height plus the mean difference of the record from it where the Mach number is
        above 0.1: a thermometer without flow does not show the air.  ``h`` is the height at which the air so much warmer has the
        pressure of a pressure altitude ``h_baro``, other heights are taken as they are; ``pressure_ratio`` is that pressure.

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
        found[name] = np.mean([states[f"engine{number}.{name}"].values for number in engines], axis=0)
    if "throttle" not in found and "pla" in found:
        if pla is None or pla[0] == pla[1]:
            raise IdentificationError("the record has lever angles; give the angles of idle and full power as pla")
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
    return xr.Dataset({name: ("time", values) for name, values in found.items()}, {"time": states["time"].values}, dict(states.attrs))


def _outside_air(reading: np.ndarray, found: Mapping[str, np.ndarray], barometric: bool) -> dict[str, np.ndarray]:
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
            h = np.interp(-pressure, -np.log(np.asarray(atmosphere(grid, delta_T=warmer).p_static)), grid)
    air = atmosphere(h, delta_T=warmer)
    return {"temperature": np.asarray(air.temperature), "h": h, "pressure_ratio": np.asarray(air.p_static) / P_STANDARD}


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
    import pandas as pd

    table = pd.read_csv(path, comment="#")
    for name in table.columns:
        if name not in POINTS:
            raise UnknownName(str(name), POINTS, "column")
    return xr.Dataset({name: ("point", table[name].values.astype(float)) for name in table.columns})
