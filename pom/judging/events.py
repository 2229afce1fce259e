"""Instants of a flight and the same instants of a model: each found in its own record, and in the same way.

What the pilot does (release, throttle, flare) happens at the same time in both, because the record drives the model.
What the aeroplane does (lift-off speed, touchdown, stall) is a signal: a discrete of its own, or a level that the flight
has at the instant of the event and the model reaches at another.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flightmech.names import lookup
from flightmech.units import KNOT

from ..tolerances.bands import Invalid, NotJudged
from ..tolerances.event_names import ACTS, DISCRETES, LEVELS
from ..tolerances.parameter_channels import written
from ..tolerances.remarks import RowRemark
from .comparison import Match
from .signals import Signals

STANDING = KNOT
"""Ground speed below which an aeroplane stands; the noise of an inertial unit lies well below. [m s-1]"""


@dataclass(frozen=True)
class Instant:
    """One event in both records [s], and how it was found."""

    flight: float
    model: float
    remarks: tuple[RowRemark, ...] = ()


def event_time(match: Match, event: str) -> float:
    """Return the time of an event that the case has to give. [s]"""
    if event not in match.case.events:
        raise NotJudged(f"give the event {event} in [events]")
    return match.case.events[event]


def find(match: Match, event: str, excluded: str = "") -> Instant:
    """Return when an event happens in flight and model.

    Parameters
    ----------
    match : Match
    event : str
    excluded : str
        Channel that is compared and therefore may not indicate the event.

    Raises
    ------
    NotJudged
        The case does not give the event, or no signal indicates it.
    Invalid
        It lies outside the replay, or the model does not come to it.
    """
    given = match.case.events.get(event)
    if given is not None and not match.time[0] - 1e-9 <= given <= match.time[-1] + 1e-9:
        raise Invalid(f"{event} is at {given:g} s, outside the replay, {match.time[0]:g} ... {match.time[-1]:g} s")
    if event in ACTS:
        time = event_time(match, event)
        return Instant(time, time)
    if given is not None and given <= match.time[1]:
        return Instant(given, given, (RowRemark("event", f"the replay starts at {event}", event),))
    names = DISCRETES.get(event, ())
    if names and all(name in match.model for name in names):
        return _by_discrete(match, event, names)
    channel, direction = LEVELS.get(event, ("", 0))
    if not channel or channel == excluded or channel not in match.flight or channel not in match.model:
        signals = [name for name in (*names, channel) if name and name != excluded]
        raise NotJudged(f"{event} is detected by {' or '.join(signals) or 'a signal'}, and flight and model do not both have it")
    time = event_time(match, event)
    level = level_at(match, event, time)
    reached = crossing(match.time, match.model[channel], level, direction)
    if reached is None:
        raise Invalid(f"the model does not come to {event} ({written(channel, level)}) in the record")
    remark = RowRemark("event", f"{event} at {written(channel, level)}", channel, {"level": level}, lookup(channel).units)
    return Instant(time, reached, (remark,))


def level_at(match: Match, event: str, time: float) -> float:
    """Return the level of the signal of an event: what the flight has at the event; for a full stop that of standing still. [SI]"""
    return STANDING if event == "full_stop" else float(np.interp(time, match.time, match.flight[LEVELS[event][0]]))


def _by_discrete(match: Match, event: str, names: tuple[str, ...]) -> Instant:
    """Return an event that a discrete indicates; the flight's is as given where the case gives it."""
    flight, model = (_jump(match, signals, names) for signals in (match.flight, match.model))
    if model is None:
        raise Invalid(f"the model does not come to {event} in the record ({' and '.join(names)} stay off)")
    if flight is None or event in match.case.events:
        flight = event_time(match, event)
    return Instant(flight, model, (RowRemark("event", f"{event} by {' or '.join(names)}", event),))


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
