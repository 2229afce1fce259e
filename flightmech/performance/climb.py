"""Climb at full throttle: rate, gradient, highest level speed, ceilings.

Quasi-steady: the excess thrust at constant true airspeed over the weight, with the drag of level flight.

References
----------
.. [Ruijgrok] Ruijgrok, Elements of Airplane Performance, 1996, chapters 11 and 12.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq

from ..air import atmosphere
from ..steady_flight.full_throttle import NO_THRUST, full_thrust, has_thrust, heights
from ..steady_flight.result_row import Row, absent
from ..steady_flight.trim_point import Point
from ..units import FOOT
from .polar_and_range import NO_ENGINES, NO_LEVEL, TOLERANCE, at_end, level_speeds, lowest, required, stall

CLIMB = "climb"
_SERVICE = 100.0 * FOOT / 60.0  # climb rate at the service ceiling [m s-1]
_NEAR = 5.0  # of the ceilings [m]
_HIGHEST = 20e3  # where ceilings are looked for with thrust that falls with the pressure [m]


def climb_rows(point: Point, speeds: tuple[float, float]) -> list[Row]:
    """Return climb rate, climb gradient, level speed and ceilings at full throttle as rows."""
    names = {"climb_rate_max": "m s-1", "V_climb_rate_max": "m s-1", "gamma_max": "rad", "V_gamma_max": "m s-1", "V_max": "m s-1"}
    ceilings = {"service_ceiling": "m", "absolute_ceiling": "m"}
    if not has_thrust(point.aircraft):
        return absent(CLIMB, {**names, **ceilings}, NO_THRUST if point.aircraft.engines else NO_ENGINES)

    def climb(V: float) -> float:
        return excess(point.level(V)) * V

    rate = lowest(lambda V: -climb(V), speeds)
    steep = lowest(lambda V: -excess(point.level(V)), speeds)
    if not np.isfinite([rate, steep]).all():
        return absent(CLIMB, {**names, **ceilings}, NO_LEVEL)
    remark = "full throttle, constant true airspeed, drag of level flight"
    rows = [
        Row(CLIMB, "climb_rate_max", climb(rate), "m s-1", remark),
        Row(CLIMB, "V_climb_rate_max", rate, "m s-1", at_end(rate, speeds)),
        Row(CLIMB, "gamma_max", float(np.arcsin(np.clip(excess(point.level(steep)), -1.0, 1.0))), "rad", remark),
        Row(CLIMB, "V_gamma_max", steep, "m s-1", at_end(steep, speeds)),
    ]
    return [*rows, *_fastest(climb, rate, speeds), *_ceilings(point)]


def excess(flight: Point) -> float:
    """Return the excess thrust at full throttle over the weight of a level flight: the sine of the climb angle; NaN without one. [1]"""
    return (float(full_thrust(flight).sum()) - required(flight)) / flight.weight


def _fastest(climb: Callable[[float], float], best: float, speeds: tuple[float, float]) -> list[Row]:
    if climb(best) < 0.0:
        return absent(CLIMB, {"V_max": "m s-1"}, "full throttle does not hold level flight at this height")
    if climb(speeds[1]) > 0.0:
        return absent(CLIMB, {"V_max": "m s-1"}, f"beyond {speeds[1]:.4g} m/s, the end of the speeds examined: thrust exceeds drag there")
    V = _root(climb, best, speeds[1], TOLERANCE * best)
    if np.isnan(V):
        return absent(CLIMB, {"V_max": "m s-1"}, f"not every level flight from {best:.4g} to {speeds[1]:.4g} m/s can be trimmed")
    return [Row(CLIMB, "V_max", V, "m s-1", "full throttle, level")]


def _root(f: Callable[[float], float], low: float, high: float, xtol: float) -> float:
    """Return where a function passes through zero; NaN when it has no value at one of the places looked at."""
    unknown: list[float] = []

    def known(x: float) -> float:
        y = f(x)
        if np.isnan(y):
            unknown.append(x)
            return 0.0  # ends the search
        return y

    x = float(brentq(known, low, high, xtol=xtol))
    return np.nan if unknown else x


def _ceilings(point: Point) -> list[Row]:
    """Heights at which the best climb rate falls to 100 ft/min and to nothing.

    Thrust tables are not looked at beyond their heights; corrected thrust is: held, it goes on falling with the pressure.
    """
    names = {"service_ceiling": _SERVICE, "absolute_ceiling": 0.0}
    reach = heights(point.aircraft)
    if reach.end == np.inf and not reach.lapses:
        return absent(CLIMB, dict.fromkeys(names, "m"), "the thrust tables do not depend on height")
    low, top = point["h"], _HIGHEST if reach.lapses else reach.end

    def best(h: float) -> float:
        flight = point.level(_usual_speed(point, h), h)
        V = lowest(lambda V: -excess(flight.level(V)) * V, level_speeds(flight, stall(flight)))
        return excess(flight.level(V)) * V

    rows = []
    ends = (best(low), best(top)) if low < top else (np.nan, np.nan)
    for name, left in names.items():
        if not low < top:
            rows += absent(CLIMB, {name: "m"}, f"the flight is above the thrust tables, which end at {top:.5g} m")
        elif np.isnan(ends).any():
            rows += absent(CLIMB, {name: "m"}, f"no level flight can be trimmed at {low if np.isnan(ends[0]) else top:.5g} m")
        elif ends[1] > left:
            rows += absent(CLIMB, {name: "m"}, f"above the thrust tables: at their end, {top:.5g} m, it still climbs {ends[1]:.3g} m/s")
        elif ends[0] < left:
            rows += absent(CLIMB, {name: "m"}, f"below this height: it climbs {ends[0]:.3g} m/s here")
        else:
            h = _root(lambda h: best(h) - left, low, top, _NEAR)  # noqa: B023
            if np.isnan(h):
                rows += absent(CLIMB, {name: "m"}, f"not at every height from {low:.5g} to {top:.5g} m a level flight can be trimmed")
                continue
            beyond = f"; above the tables of the deck, which end at {reach.end:.5g} m: corrected thrust held" if h > reach.end else ""
            rows.append(Row(CLIMB, name, float(h), "m", f"{left:.3g} m/s of climb left, constant true airspeed{beyond}"))
    return rows


def _usual_speed(point: Point, h: float) -> float:
    """Return the speed of the same dynamic pressure at another height. [m s-1]"""
    air = atmosphere(h, point.parameter("env.delta_T"), point.parameter("env.qnh"))
    return float(point["V"] * np.sqrt(point["rho"] / air.rho))
