"""Conditions of the rows of the tolerance table: words that a case claims, and relations."""

from __future__ import annotations

import operator
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from flightmech.quantities import parse_quantity
from pom.tolerances.bands import NotJudged
from pom.tolerances.criteria import PARTS

_RELATION = re.compile(r"^(speed|groundspeed|distance)(<=|>=|<|>)(.+)$")
_COMPARE = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}
_CHANNEL = {"speed": "V_cas", "groundspeed": "V_ground", "distance": "distance"}
_WARNING = re.compile(r"^(?:stick_shaker|stall_warning|warning)_or_initial_buffet$")
WARNING_EVENTS = ("stall_warning", "initial_buffet")
"""Events of the first warning of a stall; the earlier one counts."""

KINDS = ("underdamped", "overdamped")
"""Kinds of free motion of a control; read from the flight unless the case states one."""

SWEEPS = "alternate_method_moderate_or_rapid_sweep"
"""Control dynamics by sweeps, without a release."""


def is_claim(word: str) -> bool:
    """Whether the case has to claim a condition; the record shows the others."""
    return not (word in PARTS or word in KINDS or is_relation(word))


def missing_claims(condition: str, features: tuple[str, ...]) -> list[str]:
    """Return the words of a condition that the case should claim and does not."""
    # A case that states a kind of motion has to state the kind of the row.
    states_kind = bool(set(KINDS) & set(features))
    missing = []
    for word in filter(None, condition.split(";")):
        is_kind = word in KINDS
        if is_kind and SWEEPS in features:
            missing.append("a release instead of sweeps")
        elif word not in features and (is_claim(word) or (is_kind and states_kind)):
            missing.append(word)
    return missing


def is_relation(word: str) -> bool:
    """Whether a condition is a relation such as ``groundspeed<40kt``."""
    return _RELATION.match(word) is not None


def condition_channels(condition: str) -> list[str]:
    """Return the channels in the relations of a condition."""
    channels = []
    for word in condition.split(";"):
        match = _RELATION.match(word)
        if match:
            channels.append(_CHANNEL[match.group(1)])
    return channels


def satisfies_relation(word: str, value: Any) -> Any:
    """Whether a value, or each value of an array, satisfies a relation with a number. [SI]"""
    name, relation, text = _RELATION.match(word).groups()  # type: ignore[union-attr]
    unit = "m" if name == "distance" else "m s-1"
    # The table writes 40kt, the parser of quantities needs 40 kt.
    limit = parse_quantity(re.sub(r"(?<=\d)(?=[a-z])", " ", text), unit)
    return _COMPARE[relation](value, limit)


def sample_mask(
    condition: str, events: Mapping[str, float], time: np.ndarray, flight: Mapping[str, np.ndarray]
) -> np.ndarray:
    """Return the samples at which the flight satisfies the relations of a condition (time,).

    An example is ``groundspeed<40kt``. ``speed>stick_shaker_or_initial_buffet`` means faster than
    the flight is at the first of the two events. Relations of the distance do not concern samples.

    Raises
    ------
    NotJudged
        The flight lacks the channel of a relation, or the case lacks its events.
    """
    mask = np.ones(time.size, bool)
    for word in condition.split(";"):
        match = _RELATION.match(word)
        if not match or match.group(1) == "distance":
            continue
        channel = _CHANNEL[match.group(1)]
        if channel not in flight:
            raise NotJudged(f"the flight record has no {channel}, which {word} requires")
        if not _WARNING.match(match.group(3)):
            mask &= satisfies_relation(word, flight[channel])
            continue
        times = [events[event] for event in WARNING_EVENTS if event in events]
        if not times:
            raise NotJudged(
                f"give the event stall_warning or initial_buffet in [events]: the row "
                f"counts only with {word}"
            )
        mask &= flight[channel] > np.interp(min(times), time, flight[channel])
    return mask
