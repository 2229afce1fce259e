"""Conditions of rows: which row counts, on which samples, and on which channel, as the flight shows.

A condition is a word that the case claims (``reversible_controls``), a part of the manoeuvre between two events
(``approach_to_stall``), a relation that picks samples (``groundspeed<40kt``) or the row (``distance<=4000ft``), or the
kind of a free motion (``underdamped``).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..tolerances.bands import Invalid
from ..tolerances.criteria import Criterion
from ..tolerances.event_names import PARTS
from ..tolerances.parameter_channels import OTHERS, written
from ..tolerances.row_conditions import KINDS, holds
from .measures.release import free_motion
from .signals import Raw, Signals, signals_of

if TYPE_CHECKING:
    from ..cases.case import PomCase


def settled(case: PomCase, time: np.ndarray, flight: Raw) -> PomCase:
    """Return a case whose criteria are settled on this flight: which rows apply, on which channel, over which part.

    Parameters
    ----------
    case : PomCase
    time : array (time,)
        Samples of the replay. [s]
    flight : mapping of str to array (time,)
        [SI]
    """
    signals = signals_of(case, flight, time)
    return replace(case, criteria=tuple(settle(case, c, time, signals) for c in case.criteria))


def settle(case: PomCase, criterion: Criterion, time: np.ndarray, flight: Signals) -> Criterion:
    """Return one criterion settled on a flight; settling twice is settling once."""
    criterion = _on_channel(criterion, flight)
    criterion = replace(criterion, fraction=case.fraction, largest=case.ranges.get(criterion.channel, criterion.largest))
    if not criterion.applies:
        return criterion
    for word in criterion.condition.split(";"):
        if word in PARTS:
            criterion = _part(case, criterion, word)
        elif word in KINDS:
            criterion = _of_kind(case, criterion, word, time, flight)
        elif word.startswith("distance"):
            criterion = _by_distance(case, criterion, word, time, flight)
    return criterion


def _on_channel(criterion: Criterion, flight: Signals) -> Criterion:
    """Return the criterion on the channel that the flight has of those that a parameter may be judged on."""
    rate = criterion.parameter == "trim_rate"
    other = next((name for name in OTHERS.get(criterion.parameter, ()) if name in flight), "")
    if not other or (criterion.abscissa if rate else criterion.channel) in flight:
        return criterion
    return replace(criterion, abscissa=other) if rate else replace(criterion, channel=other)


def _part(case: PomCase, criterion: Criterion, word: str) -> Criterion:
    start, stop = criterion.window
    missing = [event for event in PARTS[word] if event and event not in case.events]
    if missing:
        return replace(criterion, reason=f"give the event {' and '.join(missing)} in [events]: the row counts only in {word}")
    first, last = (case.events.get(event) for event in PARTS[word])
    window = (start if first is None else max(start, first), stop if last is None else min(stop, last))
    if window[0] >= window[1]:
        return replace(criterion, applies=False, reason=f"no part of the window is {word}")
    return replace(criterion, window=window)


def _of_kind(case: PomCase, criterion: Criterion, word: str, time: np.ndarray, flight: Signals) -> Criterion:
    """Settle a row of control dynamics: on the kind of the motion, and on whether it has what the row measures."""
    if criterion.channel not in flight:
        return criterion
    try:
        motion = free_motion(criterion, time, flight[criterion.channel])
    except Invalid:
        return criterion  # the measure reports what is wrong with the record
    kind = KINDS[0] if motion.overshoots.size else KINDS[1]
    if kind != word and word not in case.features:
        return replace(criterion, applies=False, reason=f"applies only {word}; the flight is {kind}")
    later_only = criterion.parameter == "an" and criterion.band.base != "first_overshoot"
    cycles = motion.overshoots.size >= 2 and motion.period(1) is not None
    lacking = {"period_n": not cycles, "overshoot_n": later_only and motion.overshoots.size < 2}
    if lacking.get(criterion.measure):
        seen = f"{motion.overshoots.size} overshoot{'s' if motion.overshoots.size != 1 else ''} beyond 5 % of the first displacement"
        return replace(criterion, applies=False, reason=f"the flight has {seen} and not what the row measures")
    return criterion


def _by_distance(case: PomCase, criterion: Criterion, word: str, time: np.ndarray, flight: Signals) -> Criterion:
    """Settle a row that counts for short or for long runs."""
    if "distance" not in flight:
        return criterion
    ends = [case.events.get(event, default) for event, default in zip(criterion.bounds, criterion.window, strict=True)]
    run = float(np.diff(np.interp(ends, time, flight["distance"]))[0])
    if holds(word, run):
        return criterion
    return replace(criterion, applies=False, reason=f"applies only with {word}; the flight has {written('distance', run)}")
