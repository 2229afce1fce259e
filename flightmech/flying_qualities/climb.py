"""Climb, level speed and ceilings at full throttle.

References
----------
.. [Ruijgrok] Ruijgrok, Elements of Airplane Performance, 1996, chapters 8 to 13.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy

from flightmech.flying_qualities.level_flight import (
    NO_ENGINES,
    NO_LEVEL,
    TOLERANCE,
    describe_speed,
    level_speeds,
    minimum_cost_speed,
    required_thrust,
)
from flightmech.flying_qualities.performance import ambient_air, stall
from flightmech.steady_flight.engine_thrust import (
    NO_THRUST,
    full_thrust,
    has_thrust,
    thrust_over_height,
)
from flightmech.steady_flight.flight_condition import Characteristic, absent_rows
from flightmech.steady_flight.trim_point import Point
from flightmech.units import FOOT

CLIMB = "climb"
_SERVICE_RATE = 100.0 * FOOT / 60.0  # climb rate at the service ceiling [m s-1]
_CEILING_TOLERANCE = 5.0  # [m]
_HIGHEST = 20e3  # end of the search of ceilings if thrust is proportional to the pressure [m]


def climb_rows(point: Point, speeds: tuple[float, float]) -> list[Characteristic]:
    """Return climb rate, climb gradient, level speed and ceilings at full throttle as rows."""
    names = {
        "climb_rate_max": "m s-1",
        "V_climb_rate_max": "m s-1",
        "gamma_max": "rad",
        "V_gamma_max": "m s-1",
        "V_max": "m s-1",
        "service_ceiling": "m",
        "absolute_ceiling": "m",
    }
    if not point.aircraft.engines:
        return absent_rows(CLIMB, names, NO_ENGINES)
    if not has_thrust(point.aircraft):
        return absent_rows(CLIMB, names, NO_THRUST)

    def gradient(V: float) -> float:
        return specific_excess_thrust(point.trim_level(V))

    def climb_rate(V: float) -> float:
        return gradient(V) * V

    # the steepest climb has the largest excess thrust, the fastest its largest product with speed
    V_rate = minimum_cost_speed(lambda V: -climb_rate(V), speeds)
    V_gradient = minimum_cost_speed(lambda V: -gradient(V), speeds)
    if not np.isfinite([V_rate, V_gradient]).all():
        return absent_rows(CLIMB, names, NO_LEVEL)
    # sin(gamma) is the excess thrust over the weight
    gamma = float(np.arcsin(np.clip(gradient(V_gradient), -1.0, 1.0)))
    remark = "full throttle, constant true airspeed, drag of level flight"
    rate_speed, gradient_speed = describe_speed(V_rate, speeds), describe_speed(V_gradient, speeds)
    return [
        Characteristic(CLIMB, "climb_rate_max", climb_rate(V_rate), units="m s-1", remark=remark),
        Characteristic(CLIMB, "V_climb_rate_max", V_rate, units="m s-1", remark=rate_speed),
        Characteristic(CLIMB, "gamma_max", gamma, units="rad", remark=remark),
        Characteristic(CLIMB, "V_gamma_max", V_gradient, units="m s-1", remark=gradient_speed),
        *fastest_level_rows(climb_rate, V_rate, speeds),
        *_ceiling_rows(point),
    ]


def specific_excess_thrust(flight: Point) -> float:
    """Return the excess thrust at full throttle over the weight of a level flight. [1]

    It is the sine of the climb angle, NaN if the flight is not steady.
    """
    return (float(full_thrust(flight).sum()) - required_thrust(flight)) / flight.weight


def fastest_level_rows(
    climb_rate: Callable[[float], float], best: float, speeds: tuple[float, float]
) -> list[Characteristic]:
    """Return the highest speed of level flight at full throttle as a row.

    Parameters
    ----------
    climb_rate : callable
        Climb rate at a true airspeed. [m s-1]
    best : float
        Speed of the highest climb rate. [m s-1]
    speeds : tuple of float
        Range of the search. [m s-1]
    """
    names = {"V_max": "m s-1"}
    if climb_rate(best) < 0.0:
        reason = "full throttle does not hold level flight at this height"
        return absent_rows(CLIMB, names, reason)
    if climb_rate(speeds[1]) > 0.0:
        reason = (
            f"beyond {speeds[1]:.4g} m/s, the end of the speeds examined: thrust exceeds drag there"
        )
        return absent_rows(CLIMB, names, reason)
    # the climb rate is positive at the first speed and negative at the last one
    V = find_zero(climb_rate, best, speeds[1], xtol=TOLERANCE * best)
    if np.isnan(V):
        reason = f"not every level flight from {best:.4g} to {speeds[1]:.4g} m/s can be trimmed"
        return absent_rows(CLIMB, names, reason)
    return [Characteristic(CLIMB, "V_max", V, units="m s-1", remark="full throttle, level")]


def find_zero(f: Callable[[float], float], low: float, high: float, xtol: float) -> float:
    """Return the zero of a function; NaN if the function has no value somewhere in the search."""
    without_value: list[float] = []

    def value_or_zero(x: float) -> float:
        y = f(x)
        if np.isnan(y):
            without_value.append(x)
            return 0.0  # ends the search
        return y

    x = float(scipy.optimize.brentq(value_or_zero, low, high, xtol=xtol))
    return np.nan if without_value else x


def _ceiling_rows(point: Point) -> list[Characteristic]:
    """Return the heights at which the best climb rate falls to 100 ft/min and to zero.

    The search ends where thrust tables end. A table of corrected thrust keeps its last value, and
    the thrust falls on with the pressure.
    """
    names = {"service_ceiling": "m", "absolute_ceiling": "m"}
    heights = thrust_over_height(point.aircraft)
    if heights.end == np.inf and not heights.lapses:
        return absent_rows(CLIMB, names, "the thrust tables do not depend on height")
    # the search goes from the height of the flight upwards
    low, top = point["h"], _HIGHEST if heights.lapses else heights.end
    if not low < top:
        reason = f"the flight is above the thrust tables, which end at {top:.5g} m"
        return absent_rows(CLIMB, names, reason)

    def best_climb_rate(h: float) -> float:
        return _best_climb_rate(point, h)

    ends = best_climb_rate(low), best_climb_rate(top)
    if np.isnan(ends).any():
        h = low if np.isnan(ends[0]) else top
        return absent_rows(CLIMB, names, f"no level flight can be trimmed at {h:.5g} m")
    rows = []
    for name, rate in (("service_ceiling", _SERVICE_RATE), ("absolute_ceiling", 0.0)):
        row = _ceiling_row(
            name,
            rate,
            best_climb_rate,
            heights=(low, top),
            rates=ends,
            table_end=heights.end,
        )
        rows.append(row)
    return rows


def _ceiling_row(
    name: str,
    rate: float,
    best_climb_rate: Callable[[float], float],
    *,
    heights: tuple[float, float],
    rates: tuple[float, float],
    table_end: float,
) -> Characteristic:
    """Return the height at which the best climb rate falls to `rate` [m s-1], as a row.

    `heights` are the ends of the search [m], `rates` the climb rates there [m s-1], and `table_end`
    is the last height of the thrust tables [m].
    """
    low, top = heights
    if rates[1] > rate:
        reason = (
            f"above the thrust tables: at their end, {top:.5g} m, it still climbs "
            f"{rates[1]:.3g} m/s"
        )
        return Characteristic(CLIMB, name, np.nan, units="m", absent=reason)
    if rates[0] < rate:
        reason = f"below this height: it climbs {rates[0]:.3g} m/s here"
        return Characteristic(CLIMB, name, np.nan, units="m", absent=reason)
    # the best climb rate is above `rate` at the lower end and below it at the upper end
    h = find_zero(lambda h: best_climb_rate(h) - rate, low, top, xtol=_CEILING_TOLERANCE)
    if np.isnan(h):
        reason = f"not at every height from {low:.5g} to {top:.5g} m a level flight can be trimmed"
        return Characteristic(CLIMB, name, np.nan, units="m", absent=reason)
    remark = f"{rate:.3g} m/s of climb left, constant true airspeed"
    if h > table_end:
        remark += (
            f"; above the tables of the deck, which end at {table_end:.5g} m: corrected thrust held"
        )
    return Characteristic(CLIMB, name, float(h), units="m", remark=remark)


def _best_climb_rate(point: Point, h: float) -> float:
    """Return the highest climb rate of level flights at a height. [m s-1]"""
    # stall and end of the tables at this height limit the speeds
    flight = point.trim_level(_equivalent_speed(point, h), h)
    speeds = level_speeds(flight, stall(flight))
    V = minimum_cost_speed(lambda V: -specific_excess_thrust(flight.trim_level(V)) * V, speeds)
    return specific_excess_thrust(flight.trim_level(V)) * V


def _equivalent_speed(point: Point, h: float) -> float:
    """Return the speed of the same dynamic pressure at another height. [m s-1]"""
    return float(point["V"] * np.sqrt(point["rho"] / ambient_air(point, h).rho))
