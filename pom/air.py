"""The offsets of the standard atmosphere that reproduce the air of a day, up to 20 km geopotential height."""

from __future__ import annotations

import math

from flightmech.units import G0

R_AIR = 8314.32 / 28.9644  # [J kg-1 K-1]
EARTH_RADIUS = 6356766.0  # of the geopotential height [m]
T_SEA = 288.15
GRADIENT, TROPOPAUSE = -0.0065, 11000.0  # [US76] table 4


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
