"""Performance: stall, trimmed drag polar, glide, level flight, range.

Level flight is trimmed by the kernel, so thrust lines, trim drag and Mach effects are in the thrust
required.

References
----------
.. [Ruijgrok] Ruijgrok, Elements of Airplane Performance, 1996, chapters 8 to 13.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import xarray as xr
from scipy.optimize import brentq, minimize_scalar

from flightmech.air import atmosphere
from flightmech.errors import SimulationError
from flightmech.names import quantity_attributes
from flightmech.steady_flight.engine_thrust import (
    NO_THRUST,
    burns_fuel,
    full_thrust,
    has_thrust,
    thrust_over_height,
)
from flightmech.steady_flight.flight_condition import Characteristic, absent_rows
from flightmech.steady_flight.trim_point import Point
from flightmech.units import DEGREE, FOOT

STALL, POLAR, LEVEL, RANGE = "stall", "drag polar", "level flight", "range"
_POLAR_POINTS = 121
_STEPS, _BALANCED = (
    60,
    1e-14,
)  # most steps to the elevator of no moment, and the moment that counts as none
_PLAIN = 15.0 * DEGREE
_BELOW = 5.0 * DEGREE  # angles of attack below zero that the polar shows
_FIT = (0.1, 0.7)  # of the largest lift coefficient: where the parabola is fitted
_SLOW, _FAST = 1.02, 6.0  # of the stall speed: where level flight is looked at
_GRID = 25
TOLERANCE = 1e-4  # of the speeds found
NO_ENGINES = "the aircraft file has no engines"
NO_LEVEL = "no level flight is steady at any speed of the tables"


class Stall(NamedTuple):
    """Largest trimmed lift coefficient, power off, and the speed it gives."""

    CL: float
    alpha: float
    V: float
    why: str


def polar(point: Point, mach: float | None = None) -> xr.Dataset:
    """Return the trimmed drag polar, power off, over the angles of attack of the lift tables.

    Parameters
    ----------
    point : Point
        The flight; configuration, c.g. and height are taken from it.
    mach : float, optional
        Mach number; that of the flight unless given.

    Returns
    -------
    Dataset (alpha,)
        ``CL``, ``CD``, ``delta_e`` [rad] for no pitching moment about the c.g., ``L_D``; rows end
        where the elevator does.
    """
    at = {
        **point.power_off,
        "mach": point["mach"] if mach is None else mach,
        "dnz": 0.0,
        "qhat": 0.0,
    }
    alpha = np.linspace(max(alpha_range(point)[0], -_BELOW), alpha_range(point)[1], _POLAR_POINTS)
    delta_e = _balanced(point, alpha, at)
    alpha, delta_e = (values[np.isfinite(delta_e)] for values in (alpha, delta_e))
    if not alpha.size:
        raise SimulationError(
            "the elevator balances the pitching moment at no angle of attack; check the c.g. "
            "and the limits of delta_e"
        )
    CL, CD = point.coefficients(**at, alpha=alpha, delta_e=delta_e)[:2]
    data = {
        name: ("alpha", values, quantity_attributes(name))
        for name, values in (("CL", CL), ("CD", CD), ("delta_e", delta_e))
    }
    return xr.Dataset(
        {**data, "L_D": ("alpha", CL / CD, {"units": "1"})},
        {"alpha": ("alpha", alpha, quantity_attributes("alpha"))},
        attrs={"mach": at["mach"]},
    )


def alpha_range(point: Point) -> tuple[float, float]:
    """Return the ends of the lift tables; -15 to 15 degrees when they do not depend on the angle of
    attack. [rad]
    """
    return point.compiled.lift_range.get("alpha", (-_PLAIN, _PLAIN))


def _balanced(point: Point, alpha: np.ndarray, at: dict[str, float]) -> np.ndarray:
    """Return the elevator for no pitching moment about the c.g. (alpha,); that of the flight
    without effect, NaN beyond its limits.
    """
    travel = point.aircraft.limits.get("delta_e", (-45.0 * DEGREE, 45.0 * DEGREE))
    low, high = (np.full(alpha.shape, end) for end in travel)

    def moment(delta_e: np.ndarray) -> np.ndarray:
        return point.body_coefficients(**at, alpha=alpha, delta_e=delta_e)[4]

    first, last = moment(low), moment(high)
    if (first == last).all():
        return np.full(alpha.shape, point.variables["delta_e"])
    inside = np.sign(first) * np.sign(last) <= 0.0
    for _ in range(_STEPS):  # false position, the end that stays counted by half
        there = np.where(
            inside & (last != first),
            high - last * (high - low) / np.where(last != first, last - first, 1.0),
            high,
        )
        left = moment(there)
        stays = np.sign(left) == np.sign(last)
        low, first = np.where(stays, low, high), np.where(stays, 0.5 * first, last)
        high, last = there, left
        if np.abs(last[inside]).max(initial=0.0) < _BALANCED:
            break
    return np.where(inside, high, np.nan)


def stall(point: Point) -> Stall:
    """Return the stall, power off, in one-g flight at the height and mass of a point: largest
    trimmed lift of the tables.
    """
    air = atmosphere(point["h"], point.parameter("env.delta_T"), point.parameter("env.qnh"))
    mach = point["mach"]
    for _ in range(20):
        curve = polar(point, mach)
        best = int(np.argmax(curve["CL"].values))
        V = float(
            np.sqrt(2.0 * point.weight / (air.rho * point.aircraft.S * float(curve["CL"][best])))
        )
        if abs(V / float(air.a_sound) - mach) < 1e-6:
            break
        mach = V / float(air.a_sound)
    alpha = float(curve["alpha"][best])
    if best < curve.sizes["alpha"] - 1:
        why = "maximum of the lift table"
    elif alpha < alpha_range(point)[1] - 1e-9:
        why = "end of the elevator travel: the table would give more"
    else:
        why = "end of the lift table, no maximum inside: the true one lies higher"
    return Stall(float(curve["CL"][best]), alpha, V, why)


def stall_rows(found: Stall) -> list[Characteristic]:
    """Return the stall as rows."""
    return [
        Characteristic(STALL, "CL_max", found.CL, "1", f"trimmed, power off; {found.why}"),
        Characteristic(STALL, "alpha_stall", found.alpha, "rad", found.why),
        Characteristic(STALL, "V_stall", found.V, "m s-1", "true airspeed, one g, power off"),
    ]


def polar_rows(point: Point, curve: xr.Dataset) -> list[Characteristic]:
    """Return the parabola through the polar and the best glide as rows."""
    CL, CD = curve["CL"].values, curve["CD"].values
    low, high = _FIT[0] * CL.max(), _FIT[1] * CL.max()
    inside = (np.clip(CL, low, high) == CL) & (np.arange(CL.size) <= np.argmax(CL))
    mach = f"trimmed, power off, Mach {curve.attrs['mach']:.3g}"
    rows = absent_rows(
        POLAR,
        {"CD0": "1", "k": "1", "oswald": "1"},
        "the polar has fewer than three points in its middle",
    )
    if inside.sum() >= 3:
        X = np.column_stack([np.ones(inside.sum()), CL[inside] ** 2])
        (CD0, k), *_ = np.linalg.lstsq(X, CD[inside])
        rms = float(np.sqrt(np.mean((X @ [CD0, k] - CD[inside]) ** 2)))
        oswald = point.aircraft.S / (np.pi * point.aircraft.b**2 * k)
        rows = [
            Characteristic(
                POLAR,
                "CD0",
                float(CD0),
                "1",
                f"CD = CD0 + k CL^2 over CL {low:.2f} ... {high:.2f}, rms {rms:.2g}; {mach}",
            ),
            Characteristic(POLAR, "k", float(k), "1", mach),
            Characteristic(POLAR, "oswald", float(oswald), "1", "1/(pi A k)"),
        ]
    best = int(np.argmax(curve["L_D"].values))
    V = float(
        np.sqrt(
            2.0 * point.weight / (point["rho"] * point.aircraft.S * np.hypot(CL[best], CD[best]))
        )
    )
    return [
        *rows,
        Characteristic(
            POLAR, "L_D_max", float(curve["L_D"][best]), "1", f"{mach}; at CL {CL[best]:.3f}"
        ),
        Characteristic(POLAR, "V_best_glide", V, "m s-1", "true airspeed, power off"),
        Characteristic(
            POLAR,
            "gamma_best_glide",
            -float(np.arctan(1.0 / curve["L_D"][best])),
            "rad",
            "power off",
        ),
    ]


def level_speeds(point: Point, found: Stall) -> tuple[float, float]:
    """Return the range of speeds in which level flight is looked at: from the stall to where tables
    or sense end. [m s-1]
    """
    a_sound = float(
        atmosphere(point["h"], point.parameter("env.delta_T"), point.parameter("env.qnh")).a_sound
    )
    fastest = min(
        _FAST * found.V, point.compiled.lift_range.get("mach", (0.0, np.inf))[1] * a_sound
    )
    return _SLOW * found.V, max(fastest, 1.05 * _SLOW * found.V)


def level_rows(point: Point, speeds: tuple[float, float]) -> list[Characteristic]:
    """Return the speeds of least drag and least power and the range figures as rows."""
    drags = {
        "V_minimum_drag": "m s-1",
        "minimum_drag": "N",
        "V_minimum_power": "m s-1",
        "minimum_power": "W",
    }
    ranges = {"L_D_level": "1", "M_L_D_max": "1", "V_M_L_D_max": "m s-1"}
    consumed = _specific_range(point, speeds)
    if not point.aircraft.engines:
        return [
            *absent_rows(LEVEL, drags, NO_ENGINES),
            *absent_rows(RANGE, ranges, NO_ENGINES),
            *consumed,
        ]
    drag = minimum_cost_speed(lambda V: required_thrust(point.trim_level(V)), speeds)
    power = minimum_cost_speed(lambda V: required_thrust(point.trim_level(V)) * V, speeds)
    reach = minimum_cost_speed(lambda V: required_thrust(point.trim_level(V)) / V, speeds)
    if not np.isfinite([drag, power, reach]).all():
        return [
            *absent_rows(LEVEL, drags, NO_LEVEL),
            *absent_rows(RANGE, ranges, NO_LEVEL),
            *consumed,
        ]
    least, far = required_thrust(point.trim_level(drag)), point.trim_level(reach)
    return [
        Characteristic(LEVEL, "V_minimum_drag", drag, "m s-1", is_at_end(drag, speeds)),
        Characteristic(LEVEL, "minimum_drag", least, "N", "thrust required there"),
        Characteristic(LEVEL, "V_minimum_power", power, "m s-1", is_at_end(power, speeds)),
        Characteristic(
            LEVEL,
            "minimum_power",
            required_thrust(point.trim_level(power)) * power,
            "W",
            "thrust required times speed there",
        ),
        Characteristic(
            RANGE, "L_D_level", point.weight / least, "1", "weight over least thrust required"
        ),
        Characteristic(
            RANGE,
            "M_L_D_max",
            far["mach"] * far.weight / far.thrust,
            "1",
            "jet range at constant specific fuel consumption",
        ),
        Characteristic(RANGE, "V_M_L_D_max", reach, "m s-1", is_at_end(reach, speeds)),
        *consumed,
    ]


def _specific_range(point: Point, speeds: tuple[float, float]) -> list[Characteristic]:
    """Distance per fuel in level flight, the lever where it holds the speed."""
    names = {"specific_range": "m kg-1", "V_specific_range": "m s-1"}
    if not burns_fuel(point.aircraft):
        return absent_rows(
            RANGE, names, "the aircraft file gives no fuel flow; L/D and M L/D stand for it"
        )

    def far(V: float) -> float:
        flight = point.retrim(init__V=V, init__gamma=0.0, mode__engine=0.0)
        return V / flight.fuel_flow if flight.is_trimmed else float("nan")

    V = minimum_cost_speed(lambda V: -far(V), speeds)
    if not np.isfinite(V):
        return absent_rows(RANGE, names, "the engines hold level flight at no speed of the tables")
    return [
        Characteristic(
            RANGE,
            "specific_range",
            far(V),
            "m kg-1",
            "best of level flight, fuel flow of the engine decks",
        ),
        Characteristic(RANGE, "V_specific_range", V, "m s-1", is_at_end(V, speeds)),
    ]


def performance_curves(point: Point, speeds: tuple[float, float], count: int = 41) -> xr.Dataset:
    """Return thrust required and available, lift over drag and climb over speed, level flight.

    Returns
    -------
    Dataset (V,)
        ``thrust_required``, ``thrust_available`` [N], ``L_D``, ``M_L_D``, ``climb_rate`` [m s-1];
        what needs the thrust of the engines is absent without it; NaN where no steady flight is
        found.
    """
    V = np.linspace(*speeds, count)
    flights = [point.trim_level(float(x)) for x in V]
    need = np.array([required_thrust(flight) for flight in flights])
    ratio = point.weight / np.where(need > 0.0, need, np.nan)
    mach = np.array([flight["mach"] for flight in flights])
    columns = {"thrust_required": (need, "N"), "L_D": (ratio, "1"), "M_L_D": (mach * ratio, "1")}
    if has_thrust(point.aircraft):
        have = np.array([full_thrust(flight).sum() for flight in flights])
        columns |= {
            "thrust_available": (have, "N"),
            "climb_rate": ((have - need) / point.weight * V, "m s-1"),
        }
    data = {name: ("V", values, {"units": units}) for name, (values, units) in columns.items()}
    return xr.Dataset(
        data, {"V": ("V", V, quantity_attributes("V"))}, attrs={"title": point.aircraft.name}
    )


def one_g(point: Point, mach: np.ndarray) -> xr.Dataset:
    """Return level flight over Mach numbers: the 1 g line of a mass, height and configuration
    ([LR743] Fig. 9).

    Parameters
    ----------
    point : Point
        The flight; mass, c.g., configuration and height are taken from it.
    mach : array (mach,)
        Rising.

    Returns
    -------
    Dataset (mach,)
        ``alpha``, ``delta_e`` [rad], ``V``, ``V_cas`` [m s-1] with the thrust that holds the speed;
        NaN where no level flight is steady, as below the stall.
    """
    a_sound = float(
        atmosphere(point["h"], point.parameter("env.delta_T"), point.parameter("env.qnh")).a_sound
    )
    flights = [point.trim_level(float(one) * a_sound) for one in mach]
    outputs = {"alpha": "alpha", "delta_e": "applied.delta_e", "V": "V", "V_cas": "V_cas"}
    data = {
        name: (
            "mach",
            np.array([flight[output] if flight.is_trimmed else np.nan for flight in flights]),
            quantity_attributes(name),
        )
        for name, output in outputs.items()
    }
    return xr.Dataset(
        data, {"mach": ("mach", np.asarray(mach, float), quantity_attributes("mach"))}
    )


def required_thrust(flight: Point) -> float:
    """Return the thrust of a level flight, NaN when it is not steady. [N]"""
    return flight.thrust if flight.is_trimmed else float("nan")


def minimum_cost_speed(cost: Callable[[float], float], speeds: tuple[float, float]) -> float:
    """Return the speed of the lowest cost, the best of a grid refined between its neighbours; NaN
    when there is no cost at all.
    """
    grid = np.linspace(*speeds, _GRID)
    costs = np.array([cost(float(V)) for V in grid])
    if np.isnan(costs).all():
        return float("nan")
    best = int(np.nanargmin(costs))
    bounds = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]

    def finite(V: float) -> float:
        found = cost(float(V))
        return found if np.isfinite(found) else float(np.nanmax(costs))

    return float(
        minimize_scalar(
            finite, bounds=bounds, method="bounded", options={"xatol": TOLERANCE * bounds[0]}
        ).x
    )


def is_at_end(V: float, speeds: tuple[float, float]) -> str:
    """Return a remark on a speed found: whether it is that of the flight or the end of the search."""
    where = [
        name
        for name, end in zip(("slow", "fast"), speeds, strict=True)
        if abs(V - end) < 0.005 * end
    ]
    return (
        f"true airspeed; at the {where[0]} end of the speeds looked at"
        if where
        else "true airspeed"
    )


CLIMB = "climb"
_SERVICE = 100.0 * FOOT / 60.0  # climb rate at the service ceiling [m s-1]
_NEAR = 5.0  # of the ceilings [m]
_HIGHEST = 20e3  # where ceilings are looked for with thrust that falls with the pressure [m]


def climb_rows(point: Point, speeds: tuple[float, float]) -> list[Characteristic]:
    """Return climb rate, climb gradient, level speed and ceilings at full throttle as rows."""
    names = {
        "climb_rate_max": "m s-1",
        "V_climb_rate_max": "m s-1",
        "gamma_max": "rad",
        "V_gamma_max": "m s-1",
        "V_max": "m s-1",
    }
    ceilings = {"service_ceiling": "m", "absolute_ceiling": "m"}
    if not has_thrust(point.aircraft):
        return absent_rows(
            CLIMB, {**names, **ceilings}, NO_THRUST if point.aircraft.engines else NO_ENGINES
        )

    def climb(V: float) -> float:
        return specific_excess_thrust(point.trim_level(V)) * V

    rate = minimum_cost_speed(lambda V: -climb(V), speeds)
    steep = minimum_cost_speed(lambda V: -specific_excess_thrust(point.trim_level(V)), speeds)
    if not np.isfinite([rate, steep]).all():
        return absent_rows(CLIMB, {**names, **ceilings}, NO_LEVEL)
    remark = "full throttle, constant true airspeed, drag of level flight"
    rows = [
        Characteristic(CLIMB, "climb_rate_max", climb(rate), "m s-1", remark),
        Characteristic(CLIMB, "V_climb_rate_max", rate, "m s-1", is_at_end(rate, speeds)),
        Characteristic(
            CLIMB,
            "gamma_max",
            float(np.arcsin(np.clip(specific_excess_thrust(point.trim_level(steep)), -1.0, 1.0))),
            "rad",
            remark,
        ),
        Characteristic(CLIMB, "V_gamma_max", steep, "m s-1", is_at_end(steep, speeds)),
    ]
    return [*rows, *_fastest(climb, rate, speeds), *_ceilings(point)]


def specific_excess_thrust(flight: Point) -> float:
    """Return the excess thrust at full throttle over the weight of a level flight: the sine of the
    climb angle; NaN without one. [1]
    """
    return (float(full_thrust(flight).sum()) - required_thrust(flight)) / flight.weight


def _fastest(
    climb: Callable[[float], float], best: float, speeds: tuple[float, float]
) -> list[Characteristic]:
    if climb(best) < 0.0:
        return absent_rows(
            CLIMB, {"V_max": "m s-1"}, "full throttle does not hold level flight at this height"
        )
    if climb(speeds[1]) > 0.0:
        return absent_rows(
            CLIMB,
            {"V_max": "m s-1"},
            f"beyond {speeds[1]:.4g} m/s, the end of the speeds examined: thrust exceeds drag there",
        )
    V = _root(climb, best, speeds[1], TOLERANCE * best)
    if np.isnan(V):
        return absent_rows(
            CLIMB,
            {"V_max": "m s-1"},
            f"not every level flight from {best:.4g} to {speeds[1]:.4g} m/s can be trimmed",
        )
    return [Characteristic(CLIMB, "V_max", V, "m s-1", "full throttle, level")]


def _root(f: Callable[[float], float], low: float, high: float, xtol: float) -> float:
    """Return where a function passes through zero; NaN when it has no value at one of the places
    looked at.
    """
    unknown: list[float] = []

    def known(x: float) -> float:
        y = f(x)
        if np.isnan(y):
            unknown.append(x)
            return 0.0  # ends the search
        return y

    x = float(brentq(known, low, high, xtol=xtol))
    return np.nan if unknown else x


def _ceilings(point: Point) -> list[Characteristic]:
    """Heights at which the best climb rate falls to 100 ft/min and to nothing.

    Thrust tables are not looked at beyond their heights; corrected thrust is: held, it goes on
    falling with the pressure.
    """
    names = {"service_ceiling": _SERVICE, "absolute_ceiling": 0.0}
    reach = thrust_over_height(point.aircraft)
    if reach.end == np.inf and not reach.lapses:
        return absent_rows(
            CLIMB, dict.fromkeys(names, "m"), "the thrust tables do not depend on height"
        )
    low, top = point["h"], _HIGHEST if reach.lapses else reach.end

    def best(h: float) -> float:
        flight = point.trim_level(_usual_speed(point, h), h)
        V = minimum_cost_speed(
            lambda V: -specific_excess_thrust(flight.trim_level(V)) * V,
            level_speeds(flight, stall(flight)),
        )
        return specific_excess_thrust(flight.trim_level(V)) * V

    rows = []
    ends = (best(low), best(top)) if low < top else (np.nan, np.nan)
    for name, left in names.items():
        if not low < top:
            rows += absent_rows(
                CLIMB,
                {name: "m"},
                f"the flight is above the thrust tables, which end at {top:.5g} m",
            )
        elif np.isnan(ends).any():
            rows += absent_rows(
                CLIMB,
                {name: "m"},
                f"no level flight can be trimmed at {low if np.isnan(ends[0]) else top:.5g} m",
            )
        elif ends[1] > left:
            rows += absent_rows(
                CLIMB,
                {name: "m"},
                f"above the thrust tables: at their end, {top:.5g} m, it still climbs "
                f"{ends[1]:.3g} m/s",
            )
        elif ends[0] < left:
            rows += absent_rows(
                CLIMB, {name: "m"}, f"below this height: it climbs {ends[0]:.3g} m/s here"
            )
        else:
            h = _root(lambda h: best(h) - left, low, top, _NEAR)  # noqa: B023
            if np.isnan(h):
                rows += absent_rows(
                    CLIMB,
                    {name: "m"},
                    f"not at every height from {low:.5g} to {top:.5g} m a level flight can "
                    f"be trimmed",
                )
                continue
            beyond = (
                f"; above the tables of the deck, which end at {reach.end:.5g} m: corrected "
                f"thrust held"
                if h > reach.end
                else ""
            )
            rows.append(
                Characteristic(
                    CLIMB,
                    name,
                    float(h),
                    "m",
                    f"{left:.3g} m/s of climb left, constant true airspeed{beyond}",
                )
            )
    return rows


def _usual_speed(point: Point, h: float) -> float:
    """Return the speed of the same dynamic pressure at another height. [m s-1]"""
    air = atmosphere(h, point.parameter("env.delta_T"), point.parameter("env.qnh"))
    return float(point["V"] * np.sqrt(point["rho"] / air.rho))
