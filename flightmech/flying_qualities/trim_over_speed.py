"""Trimmed flights over speed: trim curves, and speed stability stick fixed and free."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy
import xarray as xr

from flightmech.flying_qualities.control_forces import force_factor, missing_for_force
from flightmech.flying_qualities.longitudinal import NO_ELEVATOR, SMALL
from flightmech.names import quantity_attributes
from flightmech.steady_flight.flight_condition import Characteristic, absent_rows
from flightmech.steady_flight.trim_point import Point

TRIM_CURVES = "trim over speed"
_SPEED_STEP = 1e-3  # of the speed, for slopes along trimmed flights
# Search of the neutral point: first step and tolerance of the c.g., in mean chords.
_CG_STEP, _CG_TOLERANCE = 0.05, 1e-6


def trim_curves(point: Point, speeds: Sequence[float] | np.ndarray) -> xr.Dataset:
    """Return trimmed straight flights at the path angle and configuration of a point.

    Parameters
    ----------
    point : Point
        The flight.
    speeds : array (V,)
        True airspeeds, rising. [m s-1]

    Returns
    -------
    Dataset (V,)
        ``alpha theta delta_e`` [rad], ``thrust`` of all engines [N], ``throttle`` [1] if thrust
        comes from tables, ``CL``, ``CD``, ``F_column`` at the tab position and ``F_column_trimmed``
        with the force trimmed out at the speed of the point [N]. The forces are absent without
        hinge moments. NaN where a flight is not steady.
    """
    flights = [point.retrim(init__V=float(V)) for V in speeds]
    columns: dict[str, list[float]] = {}
    for name in ("alpha", "theta", "CL", "CD"):
        columns[name] = [flight[name] for flight in flights]
    columns["delta_e"] = [flight["applied.delta_e"] for flight in flights]
    columns["thrust"] = [flight.thrust for flight in flights]
    if point.aircraft.engines and point.parameter("mode.engine") == 0.0:
        # levers drive the engines: tables give the throttle
        columns["throttle"] = [flight.variables["engine1.throttle"] for flight in flights]
    if not missing_for_force(point, "delta_e"):
        columns["F_column"] = [_column_force(flight, 0.0) for flight in flights]
        hinge_moment = _elevator_hinge_moment(point)
        columns["F_column_trimmed"] = [_column_force(flight, hinge_moment) for flight in flights]

    steady = np.array([flight.is_trimmed for flight in flights])
    vocabulary_names = {"F_column_trimmed": "F_column"}
    data = {}
    for name, values in columns.items():
        attributes = quantity_attributes(vocabulary_names.get(name, name))
        data[name] = ("V", np.where(steady, values, np.nan), attributes)
    coords = {"V": ("V", np.asarray(speeds, float), quantity_attributes("V"))}
    return xr.Dataset(data, coords, attrs={"title": point.aircraft.name})


def speed_stability(point: Point) -> list[Characteristic]:
    """Return slopes of elevator and column force over speed, and the neutral point, as rows."""
    # central difference along trimmed flights: thrust, Mach number and drag change with speed
    slope = _elevator_slope(point)
    if abs(point.body_slopes("delta_e")[4]) < SMALL:
        names = {"delta_e_per_V": "rad s m-1", "neutral_point_trim": "1"}
        rows = absent_rows(TRIM_CURVES, names, NO_ELEVATOR)
    else:
        remark = "along trimmed flights; positive (trailing edge down to fly faster) is stable"
        rows = [
            Characteristic(TRIM_CURVES, "delta_e_per_V", slope, units="rad s m-1", remark=remark),
            *_neutral_point(point),
        ]
    reason = missing_for_force(point, "delta_e")
    if reason:
        forces = {"F_column": "N", "F_column_per_V": "N s m-1"}
        return [*rows, *absent_rows(TRIM_CURVES, forces, reason)]
    # The tab trims the force out at the speed of the point, and then does not move.
    slower, faster = _retrim_slower_and_faster(point)
    low = _column_force(slower, _elevator_hinge_moment(point))
    high = _column_force(faster, _elevator_hinge_moment(point))
    return [
        *rows,
        Characteristic(
            TRIM_CURVES,
            "F_column",
            _column_force(point, 0.0),
            units="N",
            remark="pull, as the tab stands",
        ),
        Characteristic(
            TRIM_CURVES,
            "F_column_per_V",
            (high - low) / (2.0 * _SPEED_STEP * point["V"]),
            units="N s m-1",
            remark="trimmed out at this speed; push to fly faster is negative",
        ),
    ]


def _neutral_point(point: Point) -> list[Characteristic]:
    """Return the c.g. at which the elevator of trimmed flights does not depend on speed, as row."""
    craft = point.aircraft

    def elevator_slope_at(x_cg_b: float) -> float:
        return _elevator_slope(point.retrim(mass__x_cg_b=x_cg_b))

    # The parameter is the c.g. with the fuel of the aircraft file, not with that of the flight.
    start = point.parameter("mass.x_cg_b")
    search = scipy.optimize.root_scalar(
        elevator_slope_at,
        x0=start,
        x1=start - _CG_STEP * craft.cbar,
        method="secant",
        xtol=_CG_TOLERANCE * craft.cbar,
        maxiter=30,
    )
    neutral = point.retrim(mass__x_cg_b=float(search.root))
    if not (search.converged and neutral.is_trimmed):
        reason = "no c.g. within trim makes the elevator independent of speed"
        return absent_rows(TRIM_CURVES, {"neutral_point_trim": "1"}, reason)
    return [
        Characteristic(
            TRIM_CURVES,
            "neutral_point_trim",
            craft.x_ref_mac - float(neutral.cg[0]) / craft.cbar,
            units="1",
            remark="c.g. for which trimmed flights need no elevator over speed: with thrust, Mach "
            "number and drag",
        )
    ]


def _elevator_slope(point: Point) -> float:
    """Return the slope of the elevator over speed along trimmed flights. [rad s m-1]"""
    slower, faster = _retrim_slower_and_faster(point)
    change = faster["applied.delta_e"] - slower["applied.delta_e"]
    return change / (2.0 * _SPEED_STEP * point["V"])


def _retrim_slower_and_faster(point: Point) -> tuple[Point, Point]:
    V = point["V"]
    slower = point.retrim(init__V=(1.0 - _SPEED_STEP) * V)
    return slower, point.retrim(init__V=(1.0 + _SPEED_STEP) * V)


def _elevator_hinge_moment(point: Point) -> float:
    return point.hinge_moment("Ch_e") or 0.0


def _column_force(flight: Point, trimmed_out: float) -> float:
    """Return the column force, less that of a hinge moment coefficient that the tab balances."""
    return force_factor(flight, "delta_e") * (_elevator_hinge_moment(flight) - trimmed_out)
