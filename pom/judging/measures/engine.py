"""Response of an engine to a slam of its lever: Ti and Tt."""

from __future__ import annotations

import numpy as np

from ...tolerances.bands import Invalid, Outcome, scalar
from ...tolerances.criteria import Criterion
from ...tolerances.remarks import RowRemark
from ..comparison import WHO, Match
from ..events import crossing

LEVEL = 1.0  # [s] over which the end level is averaged; ours


def response(criterion: Criterion, match: Match) -> Outcome:
    """Judge Ti or Tt, counted from the first movement of the lever.

    Ti is the time to 10 % of the change, each record between its own levels.  Tt is the time to 90 % of the go-around
    power of the *flight*, or, when power falls, to a 90 % decay of its starting power.  Levels: the value at the lever
    movement, and the mean of the last second of the window.
    """
    time, flight, model = match.both(criterion)
    moved = max(match.case.events.get("throttle_movement", float(time[0])), float(time[0]))
    after = time >= moved - 1e-9
    time, flight, model = time[after], flight[after], model[after]
    if criterion.measure == "response_initial":
        levels = [y[0] + 0.1 * (_end(time, y) - y[0]) for y in (flight, model)]
        level = "10 % of each record's own change"
    else:
        rises = _end(time, flight) > flight[0]
        levels = [0.9 * _end(time, flight) if rises else 0.1 * flight[0]] * 2
        level = "90 % of the end level of the flight" if rises else "90 % decay of the start level of the flight"
    times = [_time_to(who, time, y, float(level)) for who, y, level in zip(WHO, (flight, model), levels, strict=True)]
    values = RowRemark(
        "values", f"flight {times[0]:.2f} s, model {times[1]:.2f} s", values={"flight": times[0], "model": times[1]}, unit="s"
    )
    return scalar(criterion, times[0], times[1], float(time[0]), (values, RowRemark("method", level)))


def _end(time: np.ndarray, y: np.ndarray) -> float:
    return float(y[time >= time[-1] - LEVEL].mean())


def _time_to(who: str, time: np.ndarray, y: np.ndarray, level: float) -> float:
    """Return the time from the first sample to the first passage of a level. [s]"""
    reached = crossing(time, y, level, 1 if y[0] < level else -1)
    if reached is None:
        raise Invalid(f"{who} does not reach the level in the window")
    return reached - float(time[0])
