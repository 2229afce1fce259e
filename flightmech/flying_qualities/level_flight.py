"""Level flight over speed: least drag, least power, range, and the curves of performance.

The kernel trims level flight.  The required thrust therefore contains thrust lines, trim drag and
Mach effects.

References
----------
.. [Ruijgrok] Ruijgrok, Elements of Airplane Performance, 1996, chapters 8 to 13.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy
import xarray as xr

from flightmech.flying_qualities.performance import Stall, ambient_air
from flightmech.names import quantity_attributes
from flightmech.steady_flight.engine_thrust import burns_fuel, full_thrust, has_thrust
from flightmech.steady_flight.flight_condition import Characteristic, absent_rows
from flightmech.steady_flight.trim_point import Point

LEVEL, RANGE = "level flight", "range"
TOLERANCE = 1e-4  # of a speed that is the result of a search, relative
NO_ENGINES = "the aircraft file has no engines"
NO_LEVEL = "no level flight is steady at any speed of the tables"
# Range of speeds of level flight, and least width of this range, in stall speeds.
_SLOWEST, _FASTEST, _LEAST_WIDTH = 1.02, 6.0, 1.05
_GRID_SIZE = 25  # speeds of a search, before its refinement
_NEAR_END = 0.005  # distance from an end of the speeds that counts as at the end, relative


def level_speeds(point: Point, slowest: Stall) -> tuple[float, float]:
    """Return the range of speeds of the searches in level flight. [m s-1]

    It extends from the stall to the end of the tables or to six times the stall speed.
    """
    a_sound = float(ambient_air(point).a_sound)
    _, last_mach = point.compiled.lift_range.get("mach", (0.0, np.inf))
    fastest = min(_FASTEST * slowest.V, last_mach * a_sound)
    return _SLOWEST * slowest.V, max(fastest, _LEAST_WIDTH * _SLOWEST * slowest.V)


def level_rows(point: Point, speeds: tuple[float, float]) -> list[Characteristic]:
    """Return the speeds of least drag and least power and the range figures as rows."""
    drags = {
        "V_minimum_drag": "m s-1",
        "minimum_drag": "N",
        "V_minimum_power": "m s-1",
        "minimum_power": "W",
    }
    ranges = {"L_D_level": "1", "M_L_D_max": "1", "V_M_L_D_max": "m s-1"}
    specific_range = _specific_range_rows(point, speeds)
    if not point.aircraft.engines:
        absent = absent_rows(LEVEL, drags, NO_ENGINES) + absent_rows(RANGE, ranges, NO_ENGINES)
        return absent + specific_range

    def drag(V: float) -> float:
        return required_thrust(point.trim_level(V))

    V_drag = minimum_cost_speed(drag, speeds)
    V_power = minimum_cost_speed(lambda V: drag(V) * V, speeds)
    # M L/D is largest where drag over speed is least
    V_range = minimum_cost_speed(lambda V: drag(V) / V, speeds)
    if not np.isfinite([V_drag, V_power, V_range]).all():
        absent = absent_rows(LEVEL, drags, NO_LEVEL) + absent_rows(RANGE, ranges, NO_LEVEL)
        return absent + specific_range

    least_drag, farthest = drag(V_drag), point.trim_level(V_range)
    range_factor = farthest["mach"] * farthest.weight / farthest.thrust
    rows = [
        _speed_row(LEVEL, "V_minimum_drag", V_drag, speeds=speeds),
        Characteristic(
            LEVEL, "minimum_drag", least_drag, units="N", remark="thrust required there"
        ),
        _speed_row(LEVEL, "V_minimum_power", V_power, speeds=speeds),
        Characteristic(
            LEVEL,
            "minimum_power",
            drag(V_power) * V_power,
            units="W",
            remark="thrust required times speed there",
        ),
        Characteristic(
            RANGE,
            "L_D_level",
            point.weight / least_drag,
            units="1",
            remark="weight over least thrust required",
        ),
        Characteristic(
            RANGE,
            "M_L_D_max",
            range_factor,
            units="1",
            remark="jet range at constant specific fuel consumption",
        ),
        _speed_row(RANGE, "V_M_L_D_max", V_range, speeds=speeds),
    ]
    return rows + specific_range


def _specific_range_rows(point: Point, speeds: tuple[float, float]) -> list[Characteristic]:
    """Return the best distance per fuel in level flight with the lever trimmed, and its speed."""
    names = {"specific_range": "m kg-1", "V_specific_range": "m s-1"}
    if not burns_fuel(point.aircraft):
        reason = "the aircraft file gives no fuel flow; L/D and M L/D stand for it"
        return absent_rows(RANGE, names, reason)

    def specific_range(V: float) -> float:
        # mode.engine 0: the lever drives the engine decks, which give the fuel flow
        flight = point.retrim(init__V=V, init__gamma=0.0, mode__engine=0.0)
        return V / flight.fuel_flow if flight.is_trimmed else float("nan")

    V = minimum_cost_speed(lambda V: -specific_range(V), speeds)
    if not np.isfinite(V):
        reason = "the engines hold level flight at no speed of the tables"
        return absent_rows(RANGE, names, reason)
    return [
        Characteristic(
            RANGE,
            "specific_range",
            specific_range(V),
            units="m kg-1",
            remark="best of level flight, fuel flow of the engine decks",
        ),
        _speed_row(RANGE, "V_specific_range", V, speeds=speeds),
    ]


def _speed_row(group: str, quantity: str, V: float, speeds: tuple[float, float]) -> Characteristic:
    return Characteristic(group, quantity, V, units="m s-1", remark=describe_speed(V, speeds))


def performance_curves(point: Point, speeds: tuple[float, float], count: int = 41) -> xr.Dataset:
    """Return thrust required and available, lift over drag and climb over speed, level flight.

    Parameters
    ----------
    point : Point
        The flight.
    speeds : tuple of float
        First and last true airspeed. [m s-1]
    count : int
        Number of speeds.

    Returns
    -------
    Dataset (V,)
        ``thrust_required``, ``thrust_available`` [N], ``L_D``, ``M_L_D``, ``climb_rate`` [m s-1].
        Without the thrust of the engines, available thrust and climb are absent. NaN where a flight
        is not steady.
    """
    V = np.linspace(*speeds, count)
    flights = [point.trim_level(float(speed)) for speed in V]
    required = np.array([required_thrust(flight) for flight in flights])
    ratio = point.weight / np.where(required > 0.0, required, np.nan)
    mach = np.array([flight["mach"] for flight in flights])
    data = {
        "thrust_required": ("V", required, {"units": "N"}),
        "L_D": ("V", ratio, {"units": "1"}),
        "M_L_D": ("V", mach * ratio, {"units": "1"}),
    }
    # excess thrust times speed over weight, with the drag of level flight
    if has_thrust(point.aircraft):
        available = np.array([full_thrust(flight).sum() for flight in flights])
        climb_rate = (available - required) / point.weight * V
        data["thrust_available"] = ("V", available, {"units": "N"})
        data["climb_rate"] = ("V", climb_rate, {"units": "m s-1"})
    coords = {"V": ("V", V, quantity_attributes("V"))}
    return xr.Dataset(data, coords, attrs={"title": point.aircraft.name})


def required_thrust(flight: Point) -> float:
    """Return the thrust of a level flight, NaN if it is not steady. [N]"""
    return flight.thrust if flight.is_trimmed else float("nan")


def minimum_cost_speed(cost: Callable[[float], float], speeds: tuple[float, float]) -> float:
    """Return the speed of the lowest cost, NaN if the cost has no value. [m s-1]

    The search refines the best speed of a grid between its neighbours.
    """
    grid = np.linspace(*speeds, _GRID_SIZE)
    costs = np.array([cost(float(V)) for V in grid])
    if np.isnan(costs).all():
        return float("nan")
    # NaN marks a speed without a steady flight
    best = int(np.nanargmin(costs))
    bounds = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]

    def finite_cost(V: float) -> float:
        # a speed without a steady flight gets the highest cost of the grid
        value = cost(float(V))
        return value if np.isfinite(value) else float(np.nanmax(costs))

    search = scipy.optimize.minimize_scalar(
        finite_cost, bounds=bounds, method="bounded", options={"xatol": TOLERANCE * bounds[0]}
    )
    return float(search.x)


def describe_speed(V: float, speeds: tuple[float, float]) -> str:
    """Return a remark on the result of a search: whether it is an end of the speeds."""
    for name, end in zip(("slow", "fast"), speeds, strict=True):
        if abs(V - end) < _NEAR_END * end:
            return f"true airspeed; at the {name} end of the speeds looked at"
    return "true airspeed"
