"""Pilot forces from hinge moments: F = -gearing qbar S_hinge c_hinge Ch, by the virtual work of hand and surface.

Only aerodynamic hinge moments: bobweights, springs, friction and boosters belong to the control-loading model.
"""

from __future__ import annotations

from collections.abc import Mapping

from ..steady_flight.trim_point import Point

COEFFICIENT = {"delta_e": "Ch_e", "delta_a": "Ch_a", "delta_r": "Ch_r"}


def missing(point: Point, control: str) -> str:
    """Return in words what a force on column, wheel or pedals lacks, "" when nothing."""
    coefficient = COEFFICIENT[control]
    if coefficient not in point.pair.hinges:
        return f"the database has no hinge moments {coefficient}"
    if control not in point.aircraft.controls:
        return f"the aircraft file has no [control.{control}] with S_hinge, c_hinge and gearing"
    return f"the aircraft file gives no gearing in [control.{control}]" if point.aircraft.controls[control].gearing is None else ""


def force_factor(point: Point, control: str) -> float:
    """Return the pilot force of a hinge-moment coefficient of one; `missing` has returned "". [N, or N m of the wheel]"""
    geometry = point.aircraft.controls[control]
    return -float(geometry.gearing or 0.0) * point["qbar"] * geometry.S_hinge * geometry.c_hinge


def column_force_slope(point: Point, changes: Mapping[str, float]) -> tuple[float, str]:
    """Return the column force that small changes of model variables take at constant speed, or why there is none. [N]"""
    reason = missing(point, "delta_e")
    if reason:
        return 0.0, reason
    change = sum(point.hinge_slope("Ch_e", name) * size for name, size in changes.items())
    return force_factor(point, "delta_e") * change, ""
