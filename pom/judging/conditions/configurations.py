"""Configuration of a flown case: flaps, gear, and whether it starts on the ground."""

from __future__ import annotations

from collections.abc import Callable

from flightmech.units import DEGREE, KNOT
from pom.cases.case import PomCase
from pom.judging.conditions.flown_case import FlownCase, NotChecked, control_travel

FLAPS_OUT = 2.0 * DEGREE  # our number: more is an extended flap
GEAR_UP, GEAR_DOWN = 0.05, 0.95
FLYING = 15.0  # [m s-1] a trimmed aeroplane at this airspeed is not on the ground


def flap_angle(flown: FlownCase) -> float:
    """Return the size of the flap deflection at the start. [rad]"""
    return abs(float(flown.channel("delta_f")[0]))


def _gear_failure(flown: FlownCase, is_down: bool) -> str:
    """Return the position of the gear if it is another one; empty without a retractable gear."""
    if "gear" not in flown.flight and not _is_retractable(flown.case):
        return ""
    position = float(flown.channel("gear")[0])
    if is_down and position < GEAR_DOWN:
        return f"gear at {position:.2g}"
    if not is_down and position > GEAR_UP:
        return f"gear at {position:.2g}"
    return ""


def _is_retractable(case: PomCase) -> bool:
    """Return whether the aircraft file states positions of the gear."""
    try:
        return control_travel(case, "gear") > 0.0
    except NotChecked:
        return False


def _flap_failure(flown: FlownCase, is_out: bool) -> str:
    angle = flap_angle(flown)
    if is_out == (angle > FLAPS_OUT):
        return ""
    return f"flaps at {angle / DEGREE:.3g} deg"


def _clean(flown: FlownCase) -> str:
    parts = _flap_failure(flown, is_out=False), _gear_failure(flown, is_down=False)
    return ", ".join(filter(None, parts))


def _extended(flown: FlownCase) -> str:
    return _flap_failure(flown, is_out=True)


def _landing(flown: FlownCase) -> str:
    parts = _flap_failure(flown, is_out=True), _gear_failure(flown, is_down=True)
    return ", ".join(filter(None, parts))


def _take_off(flown: FlownCase) -> str:
    angle = flap_angle(flown)
    try:
        is_full = angle > 0.98 * control_travel(flown.case, "delta_f")
    except NotChecked:
        is_full = False
    parts = [f"full flaps, {angle / DEGREE:.3g} deg"] if is_full else []
    # a test that starts in the air may have its gear up
    if flown.case.drive.trim == "ground":
        parts.append(_gear_failure(flown, is_down=True))
    return ", ".join(filter(None, parts))


def _on_ground(flown: FlownCase) -> str:
    if flown.case.drive.trim == "ground":
        return ""
    speed = float(flown.channel("V_cas", "V")[0])
    if speed > FLYING and flown.case.drive.trim is True:
        return f"{speed / KNOT:.3g} kt of airspeed"
    return ""


CONFIGURATION_CHECKS: dict[str, Callable[[FlownCase], str]] = {
    "clean": _clean,
    "extended": _extended,
    "landing": _landing,
    "takeoff": _take_off,
    "gear_up": lambda flown: _gear_failure(flown, is_down=False),
    "gear_down": lambda flown: _gear_failure(flown, is_down=True),
    "ground": _on_ground,
}
"""By configuration: returns what differs from it; empty if nothing does."""
