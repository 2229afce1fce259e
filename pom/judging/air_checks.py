"""Air of a record: temperature against standard atmosphere, pressure and airspeeds.

The temperature decides density and true airspeed, and no row judges it.  What contradicts usual
weather or the other channels is named; the tolerances stand in the texts.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import xarray as xr

from flightmech.air import P_SEA, atmosphere, true_airspeed
from pom.cases.case import PomCase
from pom.tolerances.bands import RowRemark

AIR, SPEED = "temperature", "V"
"""Quantities of the remarks: on the air alone, and on the true airspeed against it."""
MOST_WARMTH = 15.0
"""Difference from the standard atmosphere that needs a word. [K]  Most flight tests are within."""
USUAL_PRESSURE = (96000.0, 104500.0)  # at sea level; beyond it are storms and records [Pa]
SPEEDS = 0.02  # relative difference of true airspeeds; 25 K of a wrong temperature give 0.04
FLYING = 30.0  # [m s-1] below it air data mean little


def air_remarks(case: PomCase, states: xr.Dataset) -> tuple[RowRemark, ...]:
    """Return the remarks on the air of a flight.

    Parameters
    ----------
    case : PomCase
    states : Dataset (time)
        Of the flight over the window of the case. [SI]

    Returns
    -------
    tuple of RowRemark
        ``record_warning`` for air that is unusual or contradicts another channel, with the error
        that it supposes (`pom.probing.temperature_effect`); ``probe`` otherwise.
    """
    if case.reference != "flight" or not {"h", "temperature"} <= set(states):
        return ()
    remarks = [*_weather_remarks(states), *_speed_remarks(states)]
    if not remarks:
        # A height that was computed from the pressure shows nothing of the temperature.
        text = (
            f"not checked: an error of the temperature within {MOST_WARMTH:g} K of the standard "
            f"atmosphere (25 K too much are 9 % of density and 4 % of true airspeed)"
        )
        remarks.append(RowRemark("probe", text, AIR))
    return tuple(remarks)


def _warn(text: str, quantity: str, error: float) -> RowRemark:
    """Return a warning; `error`: what the temperature may be too high by. [K]"""
    return RowRemark("record_warning", f"record: {text}", quantity, {"error": error}, "K")


def _weather_remarks(states: xr.Dataset) -> Iterator[RowRemark]:
    """Yield what is unusual of temperature and pressure at the start."""
    h, T = (float(np.atleast_1d(states[name].values)[0]) for name in ("h", "temperature"))
    if not np.isfinite([h, T]).all():
        return
    warmth = T - float(atmosphere(h).temperature)
    if abs(warmth) > MOST_WARMTH:
        text = (
            f"the air is {warmth:+.0f} K off the standard atmosphere, more than {MOST_WARMTH:g} K; "
            f"check the temperature"
        )
        yield _warn(text, AIR, warmth)
    if "p_static" not in states:
        return
    p = float(np.atleast_1d(states["p_static"].values)[0])
    sea = P_SEA * p / float(atmosphere(h, warmth).p_static)
    least, most = USUAL_PRESSURE
    if not least <= sea <= most:
        text = (
            f"height, pressure and temperature together are those of {sea / 100.0:.0f} hPa "
            f"at sea level, usual are {least / 100.0:.0f} to {most / 100.0:.0f} hPa; check the "
            f"temperature ({warmth:+.0f} K off the standard atmosphere) and the height"
        )
        yield _warn(text, AIR, warmth)


def _speed_remarks(states: xr.Dataset) -> Iterator[RowRemark]:
    """Yield the contradiction of true and calibrated airspeed."""
    if not {"V", "V_cas", "p_static"} <= set(states):
        return
    names = ("V", "V_cas", "p_static", "temperature")
    V, V_cas, p, T = (np.atleast_1d(states[name].values).astype(float) for name in names)
    is_flying = np.isfinite(V * V_cas) & (V_cas > FLYING)
    if not is_flying.any():
        return
    V, V_cas = V[is_flying], V_cas[is_flying]
    p, T = (np.broadcast_to(item, is_flying.shape)[is_flying] for item in (p, T))
    ratio = float(np.median(V / true_airspeed(V_cas, p, T)))
    if abs(ratio - 1.0) > SPEEDS:
        # V ~ sqrt(T) at equal calibrated airspeed and pressure
        error = float(np.median(T)) * (1.0 - ratio**2)
        text = (
            f"the true airspeed is {ratio:.3f} of what calibrated airspeed, pressure and "
            f"temperature give (tolerance {100 * SPEEDS:g} %); check the temperature and the two "
            f"airspeeds"
        )
        yield _warn(text, SPEED, error)
