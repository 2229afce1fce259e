"""Standard atmosphere, and conversions between airspeeds, on arrays.

The atmosphere is the US Standard Atmosphere 1976 below 84.852 km of geopotential height, with the
constants of ISO 2533 (R = 287.05287 J kg-1 K-1). A temperature offset applies to all layers, and
the pressure follows from hydrostatic equilibrium, as in the kernel. Air is a perfect gas with a
ratio of specific heats of 1.4. Above Mach 1 there is a normal shock in front of the pitot tube.

References
----------
.. [US76] U.S. Standard Atmosphere, 1976, NOAA-S/T 76-1562, section 1.
.. [ISO2533] ISO 2533:1975, Standard Atmosphere.
.. [Gracey] NASA RP-1046, Measurement of Aircraft Speed and Altitude, 1980, appendix A.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flightmech.units import G0

# gas constant [J kg-1 K-1] and ratio of specific heats [1] of air
R_AIR = 287.05287
GAMMA = 1.4
# temperature [K], pressure [Pa], density [kg m-3] and speed of sound [m s-1] at sea level
T_SEA, P_SEA = 288.15, 101325.0
RHO_SEA = P_SEA / (R_AIR * T_SEA)
A_SEA = float(np.sqrt(GAMMA * R_AIR * T_SEA))
# [m]
_EARTH_RADIUS = 6356766.0
# base of each layer in geopotential height [m], temperature gradient [K m-1]
_BASE = np.array([0.0, 11000.0, 20000.0, 32000.0, 47000.0, 51000.0, 71000.0])
_GRADIENT = np.array([-0.0065, 0.0, 0.001, 0.0028, 0.0, -0.0028, -0.002])
# limits of the geopotential height [m]
_LOWEST, _TOP = -5000.0, 84852.0


class Air(NamedTuple):
    """State of the air: temperature [K], p_static [Pa], rho [kg m-3], a_sound [m s-1]."""

    temperature: np.ndarray
    p_static: np.ndarray
    rho: np.ndarray
    a_sound: np.ndarray


def atmosphere(h: ArrayLike, delta_T: float = 0.0, qnh: float = P_SEA) -> Air:
    """Return the air at a height.

    Parameters
    ----------
    h : array
        Geometric height above mean sea level, limited to -5 ... 84.8 km (geopotential). [m]
    delta_T : float
        Temperature offset from the standard, positive warmer. [K]
    qnh : float
        Pressure at mean sea level. [Pa]

    Returns
    -------
    Air
        Arrays of the shape of `h`.

    Examples
    --------
    >>> round(float(atmosphere(0.0).rho), 4)
    1.225
    """
    T_base, p_base = _layers(delta_T, qnh)
    H = np.clip(_geopotential(h), _LOWEST, _TOP)
    layer = np.maximum(np.searchsorted(_BASE, H, side="left") - 1, 0)
    T = T_base[layer] + _GRADIENT[layer] * (H - _BASE[layer])
    p = _pressure(p_base[layer], T_base[layer], _GRADIENT[layer], H - _BASE[layer])
    return Air(T, p, p / (R_AIR * T), np.sqrt(GAMMA * R_AIR * T))


def pressure_altitude(p: ArrayLike) -> np.ndarray:
    """Return the height at which the standard atmosphere has the pressure `p` [Pa]. [m]

    The height is geopotential. It is the reading of an altimeter set to 1013.25 hPa.

    Examples
    --------
    >>> round(float(pressure_altitude(22632.06)))
    11000
    """
    p = np.asarray(p, float)
    T_base, p_base = _layers(0.0, P_SEA)
    layer = np.maximum(np.searchsorted(-p_base, -p, side="left") - 1, 0)
    T, L, ratio = T_base[layer], _GRADIENT[layer], p / p_base[layer]
    # Inverse of _pressure. The formula of a layer with a gradient divides by zero if L is zero.
    with np.errstate(divide="ignore", invalid="ignore"):
        sloped = T / L * (ratio ** (-R_AIR * L / G0) - 1.0)
    return _BASE[layer] + np.where(L == 0.0, -R_AIR * T / G0 * np.log(ratio), sloped)


def sea_level_pressure(qnh: float, elevation: float, delta_T: float = 0.0) -> float:
    """Return the pressure at mean sea level that corresponds to an altimeter setting. [Pa]

    An altimeter set to `qnh` shows the elevation of the runway on the runway: the pressure altitude
    there less that of `qnh`. The actual air has a temperature offset. The result is the parameter
    ``env.qnh`` of a simulation.

    Parameters
    ----------
    qnh : float
        Altimeter setting. [Pa]
    elevation : float
        Elevation of the runway. [m]
    delta_T : float
        Temperature offset. [K]

    Examples
    --------
    >>> round(sea_level_pressure(101325.0, 1500.0, 20.0))
    100123
    """
    # The scale of the altimeter moves by the pressure altitude of the setting. Heights of the
    # standard atmosphere are geopotential.
    H = _geopotential(elevation) + pressure_altitude(qnh)
    at_runway = atmosphere(_EARTH_RADIUS * H / (_EARTH_RADIUS - H)).p_static
    # pressure on the runway for a pressure of 101325 Pa at sea level
    actual = atmosphere(elevation, delta_T).p_static
    return float(P_SEA * at_runway / actual)


def impact_pressure(mach: ArrayLike, p: ArrayLike) -> np.ndarray:
    """Return the impact pressure, the difference of pitot and static pressure. [Pa]

    The formula is isentropic up to Mach 1, and Rayleigh's formula above.

    Parameters
    ----------
    mach : array
        Mach number, not negative.
    p : array
        Static pressure. [Pa]

    References
    ----------
    .. [Gracey] eq. (A12) and (A13).
    """
    M2 = np.square(np.asarray(mach, float))
    # Rayleigh's formula is evaluated at Mach 1 where it does not apply, so that it stays finite
    supersonic = np.maximum(M2, 1.0)
    shock = (1.2 * supersonic) ** 3.5 * (6.0 / (7.0 * supersonic - 1.0)) ** 2.5
    return np.asarray(p, float) * (np.where(M2 <= 1.0, (1.0 + 0.2 * M2) ** 3.5, shock) - 1.0)


def mach_number(q_c: ArrayLike, p: ArrayLike) -> np.ndarray:
    """Return the Mach number from impact and static pressure [Pa].

    This is the inverse of `impact_pressure`.
    """
    # ratio of pitot to static pressure
    ratio = 1.0 + np.asarray(q_c, float) / np.asarray(p, float)
    mach = np.sqrt(5.0 * np.maximum(ratio ** (1.0 / 3.5) - 1.0, 0.0))
    if np.any(mach > 1.0):
        # Fixed-point iteration of Rayleigh's formula, solved for the first factor M. It contracts
        # by 0.42 per step at M = 1 and faster above, so 40 steps reach rounding.
        supersonic = np.maximum(mach, 1.0)
        for _ in range(40):
            supersonic = np.sqrt(ratio * (7.0 - 1.0 / supersonic**2) ** 2.5 / (6.0**2.5 * 1.2**3.5))
            supersonic = np.maximum(supersonic, 1.0)
        mach = np.where(mach > 1.0, supersonic, mach)
    return mach


def calibrated_airspeed(q_c: ArrayLike) -> np.ndarray:
    """Return the calibrated airspeed of an impact pressure [Pa]. [m s-1]"""
    return A_SEA * mach_number(q_c, P_SEA)


def impact_pressure_at(V_cas: ArrayLike) -> np.ndarray:
    """Return the impact pressure at a calibrated airspeed [m s-1]. [Pa]

    This is the inverse of `calibrated_airspeed`.
    """
    return impact_pressure(np.asarray(V_cas, float) / A_SEA, P_SEA)


def true_airspeed(V_cas: ArrayLike, p: ArrayLike, temperature: ArrayLike) -> np.ndarray:
    """Return the true airspeed.

    Parameters
    ----------
    V_cas : array
        Calibrated airspeed. [m s-1]
    p, temperature : array
        Static pressure [Pa] and temperature [K].

    Returns
    -------
    array
        True airspeed. [m s-1]

    Examples
    --------
    >>> round(float(true_airspeed(100.0, 101325.0, 288.15)), 6)
    100.0
    """
    return mach_number(impact_pressure_at(V_cas), p) * np.sqrt(
        GAMMA * R_AIR * np.asarray(temperature, float)
    )


def equivalent_airspeed(V: ArrayLike, rho: ArrayLike) -> np.ndarray:
    """Return the equivalent airspeed V sqrt(rho / rho_0). [m s-1]"""
    return np.asarray(V, float) * np.sqrt(np.asarray(rho, float) / RHO_SEA)


def _geopotential(h: ArrayLike) -> np.ndarray:
    """Return the geopotential height of a geometric one. [m]"""
    h = np.asarray(h, float)
    return _EARTH_RADIUS * h / (_EARTH_RADIUS + h)


def _layers(delta_T: float, qnh: float) -> tuple[np.ndarray, np.ndarray]:
    """Return temperature and pressure at the base of each layer."""
    T, p = np.empty(len(_BASE)), np.empty(len(_BASE))
    T[0], p[0] = T_SEA + delta_T, qnh
    # From layer to layer: linear temperature, hydrostatic pressure.
    for i in range(1, len(_BASE)):
        dH = _BASE[i] - _BASE[i - 1]
        T[i] = T[i - 1] + _GRADIENT[i - 1] * dH
        p[i] = _pressure(p[i - 1], T[i - 1], _GRADIENT[i - 1], dH)
    return T, p


def _pressure(p_base: Any, T_base: Any, gradient: Any, dH: Any) -> Any:
    """Return the pressure at the height dH above the base of a layer, [US76] eq. (33a), (33b)."""
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        sloped = ((T_base + gradient * dH) / T_base) ** (-G0 / (R_AIR * gradient))
    return p_base * np.where(gradient == 0.0, np.exp(-G0 * dH / (R_AIR * T_base)), sloped)
