"""Air-data relations: what pressure altitude, Mach number and airspeeds say about pressures, and back.

US Standard Atmosphere 1976 below 20 km; subsonic isentropic impact pressure.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from flightmech.names import attrs

P0, T0, G0, R_AIR, LAPSE, TROPOPAUSE = 101325.0, 288.15, 9.80665, 287.05287, 0.0065, 11000.0
A0 = float(np.sqrt(1.4 * R_AIR * T0))
_P11 = P0 * (1.0 - LAPSE * TROPOPAUSE / T0) ** (G0 / (R_AIR * LAPSE))
_H = R_AIR * (T0 - LAPSE * TROPOPAUSE) / G0


def pressure(h) -> np.ndarray:
    """Return the standard pressure at pressure altitude `h`, below 20 km. [Pa]

    Examples
    --------
    >>> round(float(pressure(0.0)))
    101325
    """
    h = np.asarray(h, float)
    low = P0 * np.maximum(1.0 - LAPSE * h / T0, 1e-3) ** (G0 / (R_AIR * LAPSE))
    return np.where(h <= TROPOPAUSE, low, _P11 * np.exp(-(h - TROPOPAUSE) / _H))


def pressure_altitude(p) -> np.ndarray:
    """Return the height where the standard atmosphere has pressure `p`, the inverse of `pressure`. [m]"""
    p = np.asarray(p, float)
    low = T0 / LAPSE * (1.0 - (p / P0) ** (R_AIR * LAPSE / G0))
    return np.where(p >= _P11, low, TROPOPAUSE - _H * np.log(p / _P11))


def impact_pressure(mach, p) -> np.ndarray:
    """Return the impact pressure at a subsonic Mach number. [Pa]"""
    return p * ((1.0 + 0.2 * np.asarray(mach, float) ** 2) ** 3.5 - 1.0)


def calibrated_airspeed(q_c) -> np.ndarray:
    """Return the calibrated airspeed for an impact pressure. [m s-1]"""
    return A0 * np.sqrt(5.0 * ((np.maximum(q_c, 0.0) / P0 + 1.0) ** (2.0 / 7.0) - 1.0))


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
        return impact_pressure(data["V"].values / np.sqrt(1.4 * R_AIR * data["temperature"].values), data["p_static"].values)
    if "V_cas" in data:
        return P0 * ((1.0 + 0.2 * (data["V_cas"].values / A0) ** 2) ** 3.5 - 1.0)
    return None
