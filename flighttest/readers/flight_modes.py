"""Flight modes of autopilots: the numbers in their logs, and when the mode changes.

References
----------
.. [PX4] PX4 Autopilot, ``msg/VehicleStatus.msg``: constants NAVIGATION_STATE of ``nav_state``.
.. [ArduPlane] ArduPilot, ``ArduPlane/mode.h``: enumeration Mode::Number of the message MODE.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

PX4 = {
    **dict(enumerate(("manual", "altitude", "position", "auto_mission", "auto_loiter", "auto_rtl"))),
    **{10: "acro", 12: "descend", 13: "termination", 14: "offboard", 15: "stabilized"},
    **dict(enumerate(("auto_takeoff", "auto_land", "auto_follow_target", "auto_precland", "orbit", "auto_vtol_takeoff"), start=17)),
}
"""[PX4] Numbers that changed their meaning between releases are left out."""
ARDUPLANE = {
    **dict(enumerate(("manual", "circle", "stabilize", "training", "acro", "fbwa", "fbwb", "cruise", "autotune"))),
    **dict(enumerate(("auto", "rtl", "loiter", "takeoff", "avoid_adsb", "guided", "initialising"), start=10)),
    **dict(enumerate(("qstabilize", "qhover", "qloiter", "qland", "qrtl", "qautotune", "qacro", "thermal", "loiter_alt_qland"), start=17)),
}


def changes(times: np.ndarray, numbers: np.ndarray, names: Mapping[int, str]) -> tuple[tuple[float, str], ...]:
    """Return when each flight mode begins and its name, ``mode_7`` for a number without one; a mode that is logged again goes on."""
    if not len(times):
        return ()
    order = np.argsort(times, kind="stable")
    times, numbers = np.asarray(times, float)[order], np.asarray(numbers, int)[order]
    begin = np.flatnonzero(np.concatenate([[True], np.diff(numbers) != 0]))
    return tuple((float(times[k]), names.get(int(numbers[k]), f"mode_{numbers[k]}")) for k in begin)


def rows(modes: Sequence[tuple[float, str]], start: float, end: float) -> list[dict[str, object]]:
    """Return the modes as manoeuvres between start and end of a record: ``manoeuvre control start end note``. [s]"""
    ends = [time for time, _ in modes[1:]] + [np.inf]
    spans = [(name, max(begin, start), min(until, end)) for (begin, name), until in zip(modes, ends, strict=True)]
    about = "flight mode of the log"
    return [{"manoeuvre": name, "control": "", "start": a, "end": b, "note": about} for name, a, b in spans if b > a]
