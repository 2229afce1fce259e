"""Pilot forces from the hinge moments of a database and the gearing of an aircraft."""

from __future__ import annotations

from collections.abc import Mapping

from flightmech.steady_flight.trim_point import Point

# Hinge-moment coefficient of each control.
COEFFICIENT = {"delta_e": "Ch_e", "delta_a": "Ch_a", "delta_r": "Ch_r"}


def missing_for_force(point: Point, control: str) -> str:
    """Return in words what is missing for a force on column, wheel or pedals, or ""."""
    coefficient = COEFFICIENT[control]
    if coefficient not in point.compiled.hinges:
        return f"the database has no hinge moments {coefficient}"
    if control not in point.aircraft.controls:
        return f"the aircraft file has no [control.{control}] with S_hinge, c_hinge and gearing"
    if point.aircraft.controls[control].gearing is None:
        return f"the aircraft file gives no gearing in [control.{control}]"
    return ""


def force_factor(point: Point, control: str) -> float:
    """Return the pilot force for a hinge-moment coefficient of one. [N, or N m of the wheel]

    `missing_for_force` must be empty for the control.
    """
    geometry = point.aircraft.controls[control]
    return -float(geometry.gearing or 0.0) * point["qbar"] * geometry.S_hinge * geometry.c_hinge


def column_force_slope(point: Point, changes: Mapping[str, float]) -> tuple[float, str]:
    """Return the column force of small changes at constant speed, or the reason why not. [N]

    `changes` are changes of model variables. [SI]
    """
    reason = missing_for_force(point, "delta_e")
    if reason:
        return 0.0, reason
    change = sum(point.hinge_slope("Ch_e", name) * size for name, size in changes.items())
    return force_factor(point, "delta_e") * change, ""
