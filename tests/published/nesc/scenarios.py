"""The F-16 scenarios of the check cases: starts, commands, durations."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from .f16 import DEG

Outputs = Mapping[str, float]
Commands = Callable[[float, Outputs, float], dict[str, float]]
CONTROL, GUIDANCE = "F16_control.dml", "F16_gnc.dml"
# deg, ft, ft/s
LEVEL = {
    "lat": 36.0191666667,
    "lon": -75.6744444444,
    "psi": 45.0,
    "h": 10013.0,
    "V": 400.0 * math.sqrt(2.0),
}
POLE = {"lat": 89.95, "lon": -45.0, "psi": 90.0, "h": 10000.0, "V": 563.643}
DATE_LINE = {**POLE, "lat": 0.0, "lon": -179.95, "psi": 0.0}
COURSE, SIDE_STEP = 45.0, 2000.0  # deg, ft
KEAS = 287.98  # kt, the equivalent airspeed of the start; tool 5 settles there
CLOCK = 1e-9  # s, rounding of the time


@dataclass(frozen=True)
class Scenario:
    """One F-16 case of NASA/TM-2015-218675.

    Parameters
    ----------
    title : str
        What is flown.
    start : dict
        Latitude, longitude, heading [deg], height over the ellipsoid [ft], level speed over the
        rotating Earth [ft/s].
    duration : float
        [s]
    law : str
        DAVE-ML file of the control law; empty for controls fixed at their trimmed positions.
    commands : callable
        Inputs of the law at a time, from the time [s], the outputs of the kernel and the deviation
        to the right of the course [ft].
    at_trim : bool
        Whether the design angle of attack and pitch attitude of the law are those of the trim; else
        those of the file, 2.6538 deg.
    hold : float
        Step of the kernel, over which the controls are held. [s]
    """

    title: str
    start: Mapping[str, float]
    duration: float
    law: str = ""
    commands: Commands | None = None
    at_trim: bool = True
    hold: float = 0.01


def _hold(**changes: Callable[[float, float], float]) -> Commands:
    """Return the commands of case 13: the flight of case 11 held, but for `changes` over the time
    and the deviation from the course.
    """

    def commands(t: float, y: Outputs, deviation: float) -> dict[str, float]:
        held = {"keasCmd": KEAS, "altCmd": LEVEL["h"], "latOffset": 0.0, "baseChiCmd": COURSE}
        return {**held, **{name: change(t, deviation) for name, change in changes.items()}}

    return commands


def _from(when: float, before: float, after: float) -> Callable[[float, float], float]:
    return lambda t, deviation: after if t >= when - CLOCK else before


def _side_step(t: float, deviation: float) -> float:
    return deviation - (SIDE_STEP if t >= 20.0 - CLOCK else 0.0)


def _circle(pole: float) -> Commands:
    """Return the commands of cases 15 and 16; the file navigates from latitude and longitude."""

    def commands(t: float, y: Outputs, deviation: float) -> dict[str, float]:
        place = {"ownshipN_deg": y["lat"] / DEG, "ownshipE_deg": y["lon"] / DEG}
        return {**place, "circlePoleSW": pole, "keasCmd": 287.0, "altCmd": 10000.0}

    return commands


def _step(
    title: str, duration: float, hold: float, **changes: Callable[[float, float], float]
) -> Scenario:
    return Scenario(title, LEVEL, duration, CONTROL, _hold(**changes), hold=hold)


SCENARIOS = {
    "11": Scenario("subsonic trim, controls fixed", LEVEL, 180.0),
    "12": Scenario(
        "supersonic trim, controls fixed",
        {**LEVEL, "h": 30013.0, "V": 1414.2136 * math.sqrt(2.0)},
        180.0,
    ),
    "13p1": _step(
        "altitude +100 ft at 5 s", 20.0, 0.002, altCmd=_from(5.0, LEVEL["h"], LEVEL["h"] + 100.0)
    ),
    "13p2": _step("airspeed -5 KEAS at 5 s", 20.0, 0.005, keasCmd=_from(5.0, KEAS, KEAS - 5.0)),
    "13p3": _step(
        "heading +15 deg at 15 s", 30.0, 0.002, baseChiCmd=_from(15.0, COURSE, COURSE + 15.0)
    ),
    "13p4": _step("course 2000 ft to the right at 20 s", 60.0, 0.005, latOffset=_side_step),
    "15": Scenario(
        "circle of 3 nmi around the North Pole", POLE, 180.0, GUIDANCE, _circle(1.0), at_trim=False
    ),
    "16": Scenario(
        "circle of 3 nmi around equator and date line",
        DATE_LINE,
        180.0,
        GUIDANCE,
        _circle(0.0),
        at_trim=False,
    ),
}
