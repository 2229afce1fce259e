"""Air data of the flight side: calibrated airspeed, and the offsets of the standard atmosphere that reproduce a day.

U.S. Standard Atmosphere 1976 up to 20 km geopotential, subsonic.
"""

from __future__ import annotations

import math

from flightmech.units import G0

R_AIR = 8314.32 / 28.9644  # [J kg-1 K-1]
EARTH_RADIUS = 6356766.0  # of the geopotential height [m]
P_SEA, T_SEA = 101325.0, 288.15
A_SEA = math.sqrt(1.4 * R_AIR * T_SEA)
GRADIENT, TROPOPAUSE = -0.0065, 11000.0  # [US76] table 4


def calibrated_airspeed(mach, p_static):
    """Return the speed that gives the same impact pressure at standard sea level. [m s-1]

    Parameters
    ----------
    mach : array
        Below 1.
    p_static : array
        [Pa]

    Examples
    --------
    >>> round(calibrated_airspeed(0.5, 101325.0), 6)  # at sea level calibrated is true airspeed
    170.146994
    """
    q_c = p_static * ((1.0 + 0.2 * mach**2) ** 3.5 - 1.0)
    return A_SEA * (5.0 * ((q_c / P_SEA + 1.0) ** (1.0 / 3.5) - 1.0)) ** 0.5


def offsets(h: float, p_static: float, temperature: float) -> tuple[float, float]:
    """Return the temperature offset and the sea-level pressure of the atmosphere that has these values at a height.

    Parameters
    ----------
    h : float
        Height over mean sea level. [m]
    p_static, temperature : float
        [Pa], [K]

    Returns
    -------
    delta_T : float
        Added to the temperature of every layer. [K]
    qnh : float
        Pressure at sea level. [Pa]
    """
    H = EARTH_RADIUS * h / (EARTH_RADIUS + h)
    low = min(H, TROPOPAUSE)
    delta_T = temperature - (T_SEA + GRADIENT * low)
    if H > TROPOPAUSE:
        p_static = p_static * math.exp(G0 * (H - TROPOPAUSE) / (R_AIR * temperature))
    return delta_T, p_static * ((T_SEA + delta_T) / (T_SEA + delta_T + GRADIENT * low)) ** (-G0 / (R_AIR * GRADIENT))
