"""Whether the end of the input that a case states is that of the recorded controls.

Period and damping are measured from this instant on.  A later one leaves the first, largest
oscillation out, an earlier one measures the answer to the input as a free response.
"""

from __future__ import annotations

import numpy as np
import scipy

from pom.cases.case import PomCase
from pom.judging.condition_checks import MOVED, SMOOTH
from pom.judging.signals import RunSignals
from pom.tolerances.bands import RowRemark

INPUT_END = "input_end"
_MODES = ("period", "t_half", "damping_ratio", "period_n", "overshoot_n", "overshoot_count")
_CONTROLS = {"delta_e": "elevator", "delta_a": "aileron", "delta_r": "rudder"}
SHARE = 0.2
"""Share of the largest deflection within which a control has come to rest.

The pilot of a real record holds a control within some tenths of its pulse.
"""
LATE = (1.0, 0.1)
"""Time that a stated end may come after the rest: [s], and share of the free response."""


def input_end_remarks(case: PomCase, flight: RunSignals) -> tuple[RowRemark, ...]:
    """Return the departure of a stated end of the input; empty if it fits or nothing shows it.

    Parameters
    ----------
    case : PomCase
    flight : RunSignals
        Over the window of the case. [SI]
    """
    stated = case.events.get(INPUT_END)
    is_used = any(
        item.applies and item.measure in _MODES and INPUT_END in item.bounds
        for item in case.criteria
    )
    if stated is None or not is_used or case.reference != "flight":
        return ()
    found = _find_rest(flight)
    if found is None:
        return ()
    control, rest = found
    stop = float(flight.time[-1])
    allowed = max(LATE[0], LATE[1] * (stop - rest))
    if stated < rest - SMOOTH:
        text = (
            f"the input ends at {stated:g} s in the case, the {control} moves until {rest:.1f} s: "
            f"what is measured is not a free response"
        )
    elif stated > rest + allowed:
        text = (
            f"the input ends at {stated:g} s in the case, the {control} is at rest from "
            f"{rest:.1f} s on: the first part of the free response is left out"
        )
    else:
        return ()
    return (RowRemark("departure", f"departure: {text}", INPUT_END),)


def _find_rest(flight: RunSignals) -> tuple[str, float] | None:
    """Return the control that moves most, and when it comes to rest [s]; None if none moves."""
    time = flight.time
    if time.size < 2:
        return None
    width = max(1, round(SMOOTH / float(np.median(np.diff(time)))))
    best: tuple[str, np.ndarray] | None = None
    most = MOVED
    for name, control in _CONTROLS.items():
        if name not in flight:
            continue
        values = np.asarray(flight[name], float)
        smooth = scipy.ndimage.uniform_filter1d(values, width, mode="nearest")
        # from the position in the last part of the window
        away = np.abs(smooth - np.median(smooth[-max(1, time.size // 4) :]))
        if np.isfinite(away).all() and away.max() > most:
            best, most = (control, away), float(away.max())
    if best is None:
        return None
    control, away = best
    return control, float(time[np.flatnonzero(away > SHARE * most)[-1]])
