"""The words in the conditions of rows: claims of a case, parts of a manoeuvre, kinds of damping, relations such as
``groundspeed<40kt``, which picks samples, or ``distance<=4000ft``, which picks the row."""

from __future__ import annotations

import operator
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from flightmech.units import quantity

from .bands import NotJudged
from .event_names import PARTS

_RELATION = re.compile(r"^(speed|groundspeed|distance)(<=|>=|<|>)(.+)$")
_COMPARE = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}
_CHANNEL = {"speed": "V_cas", "groundspeed": "V_ground", "distance": "distance"}
_WARNING = re.compile(r"^(?:stick_shaker|stall_warning|warning)_or_initial_buffet$")
KINDS = ("underdamped", "overdamped")
"""Kinds of a control's motion after release; taken from the flight unless the case states it."""

SWEEPS = "alternate_method_moderate_or_rapid_sweep"
"""Control dynamics by sweeps, without a release."""


def claimed(word: str) -> bool:
    """Whether a condition is one that the case has to claim; the others are seen in the record."""
    return not (word in PARTS or word in KINDS or is_relation(word))


def unclaimed(condition: str, features: tuple[str, ...]) -> list[str]:
    """Return the words of a condition that the case would have to claim and does not."""
    missing = []
    for word in filter(None, condition.split(";")):
        if word in KINDS and SWEEPS in features:
            missing.append("a release instead of sweeps")
        elif word not in features and (claimed(word) or (word in KINDS and set(KINDS) & set(features))):
            missing.append(word)
    return missing


def is_relation(word: str) -> bool:
    """Whether a condition is a relation such as ``groundspeed<40kt``."""
    return _RELATION.match(word) is not None


def asked(condition: str) -> list[str]:
    """Return the channels that the relations of a condition speak of."""
    return [_CHANNEL[match.group(1)] for word in condition.split(";") if (match := _RELATION.match(word))]


def holds(word: str, value: Any) -> Any:
    """Return whether a value, or each of an array, fulfils a relation with a number. [SI]"""
    name, relation, text = _RELATION.match(word).groups()  # type: ignore[union-attr]
    unit = "m" if name == "distance" else "m s-1"
    return _COMPARE[relation](value, quantity(re.sub(r"(?<=\d)(?=[a-z])", " ", text), unit))


def sample_mask(condition: str, events: Mapping[str, float], time: np.ndarray, flight: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the samples at which the flight fulfils the relations of a condition, such as ``groundspeed<40kt``.

    ``speed>stick_shaker_or_initial_buffet``: faster than the flight is at the first of the two events.

    Raises
    ------
    NotJudged
        The flight lacks the channel, or the case the events, that the relation speaks of.
    """
    mask = np.ones(time.size, bool)
    for word in condition.split(";"):
        match = _RELATION.match(word)
        if not match or match.group(1) == "distance":
            continue
        channel = _CHANNEL[match.group(1)]
        if channel not in flight:
            raise NotJudged(f"the flight record has no {channel}, which {word} requires")
        if _WARNING.match(match.group(3)):
            times = [events[event] for event in ("stall_warning", "initial_buffet") if event in events]
            if not times:
                raise NotJudged(f"give the event stall_warning or initial_buffet in [events]: the row counts only with {word}")
            mask &= flight[channel] > np.interp(min(times), time, flight[channel])
        else:
            mask &= holds(word, flight[channel])
    return mask
