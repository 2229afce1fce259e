"""Air data that a record does not hold, computed back from what its air-data computer shows."""

from __future__ import annotations

import numpy as np
import xarray as xr

from flightmech.air import GAMMA, R_AIR, atmosphere, impact_pressure, impact_pressure_at
from flightmech.names import attrs

_EARTH_RADIUS = 6356766.0  # m, of the standard atmosphere's geopotential height


def pressure(h_baro) -> np.ndarray:
    """Return the static pressure behind a pressure altitude, which counts geopotential metres. [Pa]

    Examples
    --------
    >>> round(float(pressure(11000.0)))
    22632
    """
    h = np.asarray(h_baro, float)
    return atmosphere(_EARTH_RADIUS * h / (_EARTH_RADIUS - h)).p_static


def derived(leaves: dict[str, xr.Dataset]) -> dict[str, xr.Dataset]:
    """Return the leaves that gain static or impact pressure computed back from what the air-data computer shows.

    Parameters
    ----------
    leaves : dict of Dataset
        Leaves of a record; nothing is derived where the pressures are recorded.

    Returns
    -------
    dict of Dataset
        The changed leaves: ``p_static`` from ``h_baro``; ``q_c`` from ``mach``, from ``V`` with ``temperature``, or from
        ``V_cas``, whichever stands in the same leaf first.
    """
    changed = {}
    recorded = {str(name) for data in leaves.values() for name in data.data_vars}
    for leaf, data in leaves.items():
        new = data
        if "p_static" not in recorded and "h_baro" in data:
            new = new.assign(p_static=("time", pressure(data["h_baro"].values), attrs("p_static")))
        if "q_c" not in recorded and (q := _impact(new)) is not None:
            new = new.assign(q_c=("time", q, attrs("q_c")))
        if new is not data:
            changed[leaf] = new
    return changed


def _impact(data: xr.Dataset) -> np.ndarray | None:
    if "p_static" in data and "mach" in data:
        return impact_pressure(data["mach"].values, data["p_static"].values)
    if {"p_static", "V", "temperature"} <= set(data.data_vars):
        return impact_pressure(data["V"].values / np.sqrt(GAMMA * R_AIR * data["temperature"].values), data["p_static"].values)
    if "V_cas" in data:
        return impact_pressure_at(data["V_cas"].values)
    return None
