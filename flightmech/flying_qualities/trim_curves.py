"""Trim over speed: angle of attack, elevator, thrust and stick force of straight flight, and the stability they show.

The tab that makes the column force zero at the speed of the point is taken as a constant hinge moment, so the curve shows the force
that the pilot feels when he leaves that speed without trimming.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from scipy.optimize import root_scalar

from ..names import attrs
from ..steady_flight.result_row import Row, absent
from ..steady_flight.trim_point import Point
from .stability import NO_ELEVATOR
from .stick_forces import force_factor, missing

TRIM_CURVES = "trim over speed"
_NUDGE = 1e-3  # of the speed, for slopes along trimmed flights


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
        ``alpha theta delta_e`` [rad], ``thrust`` of all engines [N], ``throttle`` [1] when thrust comes from tables, ``CL``, ``CD``,
        ``F_column`` as the tab stands and ``F_column_trimmed`` with the force trimmed out at the speed of the point [N], both absent
        without hinge moments; NaN where no steady flight is found.
    """
    flights = [point.at(init__V=float(V)) for V in speeds]
    columns: dict[str, list[float]] = {name: [flight[name] for flight in flights] for name in ("alpha", "theta", "CL", "CD")}
    columns["delta_e"] = [flight["applied.delta_e"] for flight in flights]
    columns["thrust"] = [flight.thrust for flight in flights]
    if _throttled(point):
        columns["throttle"] = [flight.variables["engine1.throttle"] for flight in flights]
    if not missing(point, "delta_e"):
        columns["F_column"] = [_force(flight, 0.0) for flight in flights]
        columns["F_column_trimmed"] = [_force(flight, _hinge(point)) for flight in flights]
    steady = np.array([flight.is_trimmed for flight in flights])
    named = {"F_column_trimmed": "F_column"}
    data = {name: ("V", np.where(steady, values, np.nan), attrs(named.get(name, name))) for name, values in columns.items()}
    return xr.Dataset(data, {"V": ("V", np.asarray(speeds, float), attrs("V"))}, attrs={"title": point.aircraft.name})


def speed_stability(point: Point) -> list[Row]:
    """Return the slopes of elevator and column force over speed, and the neutral point that the trim curve shows, as rows."""
    slope = _elevator_slope(point)
    if abs(point.slope("delta_e")[4]) < 1e-9:
        rows = absent(TRIM_CURVES, {"delta_e_per_V": "rad s m-1", "neutral_point_trim": "1"}, NO_ELEVATOR)
    else:
        rows = [
            Row(
                TRIM_CURVES,
                "delta_e_per_V",
                slope,
                "rad s m-1",
                "along trimmed flights; positive (trailing edge down to fly faster) is stable",
            )
        ]
        rows += _neutral_point(point)
    forces = {"F_column": "N", "F_column_per_V": "N s m-1"}
    reason = missing(point, "delta_e")
    if reason:
        return [*rows, *absent(TRIM_CURVES, forces, reason)]
    low, high = (_force(flight, _hinge(point)) for flight in _neighbours(point))
    return [
        *rows,
        Row(TRIM_CURVES, "F_column", _force(point, 0.0), "N", "pull, as the tab stands"),
        Row(
            TRIM_CURVES,
            "F_column_per_V",
            (high - low) / (2.0 * _NUDGE * point["V"]),
            "N s m-1",
            "trimmed out at this speed; push to fly faster is negative",
        ),
    ]


def _neutral_point(point: Point) -> list[Row]:
    craft = point.aircraft

    def residual(x: float) -> float:
        return _elevator_slope(point.at(mass__x_cg_b=x))

    found = root_scalar(residual, x0=point.cg[0], x1=point.cg[0] - 0.05 * craft.cbar, method="secant", xtol=1e-6 * craft.cbar, maxiter=30)
    if not (found.converged and point.at(mass__x_cg_b=float(found.root)).is_trimmed):
        return absent(TRIM_CURVES, {"neutral_point_trim": "1"}, "no c.g. within trim makes the elevator independent of speed")
    text = "c.g. for which trimmed flights need no elevator over speed: with thrust, Mach number and drag"
    return [Row(TRIM_CURVES, "neutral_point_trim", craft.x_ref_mac - float(found.root) / craft.cbar, "1", text)]


def _elevator_slope(point: Point) -> float:
    low, high = _neighbours(point)
    return (high["applied.delta_e"] - low["applied.delta_e"]) / (2.0 * _NUDGE * point["V"])


def _neighbours(point: Point) -> tuple[Point, Point]:
    V = point["V"]
    return point.at(init__V=(1.0 - _NUDGE) * V), point.at(init__V=(1.0 + _NUDGE) * V)


def _hinge(point: Point) -> float:
    return point.hinge("Ch_e") or 0.0


def _force(flight: Point, trimmed_out: float) -> float:
    return force_factor(flight, "delta_e") * (_hinge(flight) - trimmed_out)


def _throttled(point: Point) -> bool:
    return bool(point.aircraft.engines) and point.parameter("mode.engine") == 0.0
