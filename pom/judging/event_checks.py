"""Stated events of a case against what the flight record shows of them.

Events bound the windows of the rows.  A passage of 200 ft that is stated before the rotation leaves
the take-off out, and a brake release that is stated late leaves its first part out.  The end of an
input is checked in `pom.judging.window_checks`.
"""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

from flightmech.quantities import time_text
from flightmech.units import FOOT, KNOT
from pom.cases.case import PomCase
from pom.cases.drafting.event_detection import Recorded, find_events
from pom.judging.signals import RunSignals
from pom.tolerances.bands import RowRemark

HEIGHT = 200.0 * FOOT
HEIGHT_ALLOWANCE = 20.0 * FOOT
"""Distance of the height from 200 ft at the stated instant: as the height rows have it. [m]"""
STANDING = 3.0 * KNOT
"""Ground speed of an aeroplane that stands; the wind moves its airspeed. [m s-1]"""
ALLOWED = 1.0
"""Time between a stated event and the recorded one. [s]"""
FOUND = {
    "main_gear_liftoff": "the last main wheel leaves the ground",
    "touchdown": "the first main wheel touches the ground",
    "nosewheel_touchdown": "the nose wheel touches the ground",
    "change_start": "the control begins to move",
    "change_end": "the control stops",
    "throttle_movement": "the lever begins to move",
    "engine_failure": "the engines begin to differ",
    "before_engine_failure": "the engines begin to differ",
}
"""Events that `find_events` finds in the samples of a record, in words."""


def event_remarks(case: PomCase, flight: RunSignals) -> tuple[RowRemark, ...]:
    """Return the departures of stated events that the record contradicts.

    Parameters
    ----------
    case : PomCase
    flight : RunSignals
        Over the window of the case. [SI]

    Returns
    -------
    tuple of RowRemark
        Kind ``departure``; ``not_checked`` for an event that bounds a judged row and that the
        record does not show.  Only events of `FOUND`, ``200ft_agl``, ``brake_release`` and
        ``full_stop`` are compared.
    """
    if case.reference != "flight" or flight.time.size < 2:
        return ()
    bounds: set[str] = set()
    for item in case.criteria:
        if item.applies:
            # "change_start-5s" is bounded by change_start
            bounds |= {re.split("[-+]", bound)[0] for bound in item.bounds}
    remarks = []
    for name, instant in case.events.items():
        # An event is contradicted only where the replay has samples of it.
        if not flight.time[0] - 1e-6 <= instant <= flight.time[-1] + 1e-6:
            continue
        check = _DIRECT.get(name)
        if check is not None:
            found = check(instant, flight)
        elif name in FOUND:
            found = _compare_found(name, instant, case, flight)
        else:
            continue
        if found is None and name in bounds:
            text = f"not checked: {name} at {time_text(instant)} s: the record does not show it"
            remarks.append(RowRemark("not_checked", text, name))
        elif found:
            text = f"departure: {name} is stated at {time_text(instant)} s, {found}"
            remarks.append(RowRemark("departure", text, name))
    return tuple(remarks)


def _value_at(instant: float, flight: RunSignals, name: str) -> float | None:
    """Return a channel of the flight at an instant [SI]; None if it has no sample there."""
    if name not in flight:
        return None
    values = np.asarray(flight[name], float)
    value = float(np.interp(instant, flight.time, values))
    return value if np.isfinite(value) else None


def _check_height(instant: float, flight: RunSignals) -> str | None:
    height = _value_at(instant, flight, "h_agl")
    if height is None:
        return None
    if abs(height - HEIGHT) <= HEIGHT_ALLOWANCE:
        return ""
    return f"where the record is {height / FOOT:.0f} ft above the ground"


def _check_standing(instant: float, flight: RunSignals) -> str | None:
    if "vn" not in flight or "ve" not in flight:
        return None
    speed = _value_at(instant, flight, "V_ground")
    if speed is None:
        return None
    if speed <= STANDING:
        return ""
    return f"where the ground speed of the record is {speed / KNOT:.0f} kt"


def _compare_found(name: str, instant: float, case: PomCase, flight: RunSignals) -> str | None:
    """Return where the record has an event that is stated elsewhere; None if it shows none."""
    window = (float(flight.time[0]), float(flight.time[-1]))
    channels = {}
    for channel in flight:
        values = np.asarray(flight[channel], float)
        if values.shape == flight.time.shape and np.isfinite(values).all():
            channels[channel] = (flight.time, values)
    recorded = Recorded(channels, window)
    found = find_events([name], case.id, recorded, manoeuvre=window, window=window).get(name)
    if found is None:
        return None
    if abs(found - instant) <= ALLOWED:
        return ""
    return f"in the record {FOUND[name]} at {found:.1f} s"


_DIRECT: dict[str, Callable[[float, RunSignals], str | None]] = {
    "200ft_agl": _check_height,
    "brake_release": _check_standing,
    "full_stop": _check_standing,
}
