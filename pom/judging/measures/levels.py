"""Levels: snapshots of a steady state, changes between two of them, and the end of a record."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...tolerances.bands import Invalid, NotJudged, Outcome, difference, half_width, inside_window, scalar, trace
from ...tolerances.criteria import Criterion
from ...tolerances.remarks import RowRemark
from ..comparison import WHO, Match
from ..events import event_time

BEFORE, AFTER = 4.0, 1.0  # [s] rule R5: a steady state from 4 s before to 1 s after the captured instant
STEADY = 1.0 / 3.0  # of the tolerance; the rule gives no number for "steady", this is ours
SLOW_PART = 0.1  # of the speed range: the low-speed end of a record; ours


def steady(criterion: Criterion, match: Match) -> Outcome:
    """Judge a snapshot: means over the capture window, after a check that both records stand still.

    Notes
    -----
    Over the 5 s the drift of the fitted line and the standard deviation about it stay below one third of the tolerance.
    """
    capture = event_time(match, "capture")
    levels = _levels(match, criterion.channel, capture)
    flight, model = (level[0] for level in levels)
    remark = _demand_steady(float(half_width(criterion, flight)[0]), *levels)
    turned = flight + float(difference(criterion.channel, np.array([flight]), np.array([model]))[0])
    return scalar(criterion, flight, turned, capture, (remark,))


def change(criterion: Criterion, match: Match) -> Outcome:
    """Judge the change of a level between the event ``trim`` and ``capture``, e.g. elevator per load factor or speed."""
    start, capture = event_time(match, "trim"), event_time(match, "capture")
    before, after = _levels(match, criterion.channel, start), _levels(match, criterion.channel, capture)
    changes = [late[0] - early[0] for early, late in zip(before, after, strict=True)]
    width = float(half_width(criterion, changes[0])[0])
    for pair in (before, after):
        remark = _demand_steady(width, *pair)
    return scalar(criterion, changes[0], changes[1], capture, (remark,))


def _levels(match: Match, channel: str, capture: float) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Return (mean, drift, spread) of flight and model around an instant. [SI]"""
    mask = inside_window(match.time, (capture - BEFORE, capture + AFTER))
    time, *runs = match.over(mask, channel)
    found = []
    for y in runs:
        smooth = difference(channel, np.zeros_like(y), y)
        line = np.polynomial.Polynomial.fit(time, smooth, 1)
        drift, spread = abs(float(line(time[-1]) - line(time[0]))), float(np.std(smooth - line(time)))
        found.append((float(smooth.mean()), drift, spread))
    return found[0], found[1]


def _demand_steady(width: float, *levels: tuple[float, float, float]) -> RowRemark:
    """Return the check as a remark."""
    if width <= 0.0:
        raise Invalid("the tolerance is zero wide")
    shares: dict[str, float] = {}
    parts = []
    for who, (_, drift, spread) in zip(WHO, levels, strict=True):
        text = f"drift {drift / width:.2f}, spread {spread / width:.2f}"
        if max(drift, spread) > STEADY * width:
            raise Invalid(f"{who} is not steady: {text} of the tolerance (1/3 allowed)")
        shares |= {f"{who} drift": drift / width, f"{who} spread": spread / width}
        parts.append(f"{who} {text}")
    return RowRemark("steady", f"steady: {'; '.join(parts)} of the tolerance", values=shares, unit="1")


def end_value(criterion: Criterion, match: Match) -> Outcome:
    """Judge the value at the end of the window, e.g. the bank angle 20 s after release."""
    time, flight, model = match.both(criterion)
    error = difference(criterion.channel, flight, model)
    return scalar(
        criterion,
        float(flight[-1]),
        float(flight[-1] + error[-1]),
        float(time[-1]),
        (RowRemark("method", "judged at the end of the window"),),
    )


def low_speed_end(criterion: Criterion, match: Match) -> Outcome:
    """Judge the last part of a deceleration: from where the flight is within a tenth of its speed range of the lowest speed."""
    speed = next((name for name in ("V_ground", "V_cas") if name in match.flight), None)
    if speed is None:
        raise NotJudged("the flight record has no speed")
    mask = inside_window(match.time, criterion.window)
    v = match.flight[speed]
    fast = mask & (v > v[mask].min() + SLOW_PART * np.ptp(v[mask]))
    if fast.any():
        mask &= match.time > match.time[fast][-1]
    if mask.sum() < 2:
        raise Invalid("the record does not end at its lowest speed")
    outcome = trace(criterion, *match.over(mask, criterion.channel))
    start = float(match.time[mask][0])
    remark = RowRemark("method", f"low-speed end, from {start:.1f} s on", values={"start": start}, unit="s")
    return replace(outcome, remarks=(remark, *outcome.remarks))
