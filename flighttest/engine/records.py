"""Channels of an engine out of flight records, and settled points out of files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, UnknownName

CHANNELS = ("throttle", "pla", "n1", "n2", "thrust", "fuel_flow", "itt", "starter", "cutoff", "ignition")
FLIGHT = ("mach", "h", "temperature")
POINTS = ("n1", "n2", *FLIGHT, "thrust", "fuel_flow", "mass", "V", "V_dot", "h_dot", "CL", "alpha")
GAMMA, R_AIR = 1.4, 287.05287  # [1], [J kg-1 K-1]


def engine_channels(states: xr.Dataset, engines: Sequence[int] = (1,), pla: tuple[float, float] | None = None) -> xr.Dataset:
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

    Returns
    -------
    Dataset (time,)

    Raises
    ------
    UnknownName
        A channel that one of the engines lacks.
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
    height = next((name for name in ("h", "h_baro", "h_gps") if name in states), None)
    if height:
        found["h"] = states[height].values
    if "temperature" in states:
        found["temperature"] = states["temperature"].values
    if "mach" in states:
        found["mach"] = states["mach"].values
    elif "V" in states and "temperature" in states:
        found["mach"] = states["V"].values / np.sqrt(GAMMA * R_AIR * states["temperature"].values)
    return xr.Dataset({name: ("time", values) for name, values in found.items()}, {"time": states["time"].values}, dict(states.attrs))


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
