"""Instants of a flight and the same instants of a model: each found in its own record, and in the same way.

What the pilot does (release, throttle, flare) happens at the same time in both, because the record drives the model.
What the aeroplane does (lift-off speed, touchdown, stall) is a signal: a discrete of its own, or a level that the flight
has at the marked instant and the model reaches at another.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flightmech.units import KNOT

from ..tolerances.bands import Invalid, NotJudged
from ..tolerances.event_names import ACTS, DISCRETES, LEVELS
from ..tolerances.parameter_channels import written
from .comparison import Match
from .signals import Signals

STANDING = KNOT
"""Ground speed below which an aeroplane stands; the noise of an inertial unit lies well below. [m s-1]"""


@dataclass(frozen=True)
class Instant:
    """One event in both records, and how it was found. [s]"""

    flight: float
    model: float
    how: str = ""


def marked(match: Match, event: str) -> float:
    """Return the time of an event that the case has to mark. [s]"""
    if event not in match.case.events:
        raise NotJudged(f"mark the event {event} in [events]")
    return match.case.events[event]


def find(match: Match, event: str, beside: str = "") -> Instant:
    """Return when an event happens in flight and model.

    Parameters
    ----------
    match : Match
    event : str
    beside : str
        Channel that is compared and therefore may not tell the event.

    Raises
    ------
    NotJudged
        The event is not marked, or no signal tells it.
    Invalid
        It is marked outside the replay, or the model does not come to it.
    """
    mark = match.case.events.get(event)
    if mark is not None and not match.time[0] - 1e-9 <= mark <= match.time[-1] + 1e-9:
        raise Invalid(f"{event} is marked at {mark:g} s, outside the replay, {match.time[0]:g} ... {match.time[-1]:g} s")
    if event in ACTS:
        time = marked(match, event)
        return Instant(time, time)
    if mark is not None and mark <= match.time[1]:
        return Instant(mark, mark, f"the replay starts at {event}")
    names = DISCRETES.get(event, ())
    if names and all(name in match.model for name in names):
        return _by_discrete(match, event, names)
    channel, direction = LEVELS.get(event, ("", 0))
    if not channel or channel == beside or channel not in match.flight or channel not in match.model:
        tellers = [name for name in (*names, channel) if name and name != beside]
        raise NotJudged(f"{event} has to be told by {' or '.join(tellers) or 'a signal'}, and flight and model do not both have it")
    time = marked(match, event)
    level = level_at(match, event, time)
    reached = crossing(match.time, match.model[channel], level, direction)
    if reached is None:
        raise Invalid(f"the model does not come to {event} ({written(channel, level)}) in the record")
    return Instant(time, reached, f"{event} at {written(channel, level)}")


def level_at(match: Match, event: str, time: float) -> float:
    """Return the level of the signal of an event: what the flight has at the mark; for a full stop that of standing still. [SI]"""
    return STANDING if event == "full_stop" else float(np.interp(time, match.time, match.flight[LEVELS[event][0]]))


def _by_discrete(match: Match, event: str, names: tuple[str, ...]) -> Instant:
    """Return an event that a discrete tells; the flight's is as marked where the case marks it."""
    flight, model = (_jump(match, signals, names) for signals in (match.flight, match.model))
    if model is None:
        raise Invalid(f"the model does not come to {event} in the record ({' and '.join(names)} stay off)")
    if flight is None or event in match.case.events:
        flight = marked(match, event)
    return Instant(flight, model, f"{event} by {' or '.join(names)}")


def _jump(match: Match, signals: Signals, names: tuple[str, ...]) -> float | None:
    """Return when the first of several discretes comes on; None when none does, or one is not there. [s]"""
    if not all(name in signals for name in names):
        return None
    return crossing(match.time, np.max([signals[name] for name in names], axis=0), 0.5, 1)


def crossing(time: np.ndarray, y: np.ndarray, level: float, direction: int, start: float = -np.inf) -> float | None:
    """Return when `y` first passes `level` upwards (1) or downwards (-1), linear between samples; None when it does not. [s]

    A signal that is beyond the level from the start has not passed it.
    """
    beyond = direction * (y - level) >= 0.0
    passed = np.flatnonzero(~beyond[:-1] & beyond[1:] & (time[1:] >= start - 1e-9))
    if not passed.size:
        return None
    k = int(passed[0])
    return float(time[k] + (level - y[k]) / (y[k + 1] - y[k]) * (time[k + 1] - time[k]))
