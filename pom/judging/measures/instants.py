"""Values at an event, each record at its own instant; and preconditions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...tolerances.bands import Outcome, demand_finite, difference, scalar
from ...tolerances.criteria import Criterion
from ...tolerances.event_names import OF_PARAMETER
from ...tolerances.remarks import RowRemark
from ..comparison import WHO, Match
from ..events import Instant, find


def event_value(criterion: Criterion, match: Match) -> Outcome:
    """Judge the value at an event: stall warning, buffet, stall, touchdown, flare, minimum control speed."""
    found = find(match, OF_PARAMETER[criterion.parameter], criterion.channel)
    flight, model = _values(criterion, match, found)
    return scalar(criterion, flight, model, found.flight, found.remarks and (*found.remarks, _times(found)))


def setup(criterion: Criterion, match: Match) -> Outcome:
    """Check a precondition, e.g. the engine failure speed: outside it the test is not valid, which is not a failure."""
    found = find(match, OF_PARAMETER[criterion.parameter], criterion.channel)
    flight, model = _values(criterion, match, found)
    outcome = scalar(criterion, flight, model, found.flight, (RowRemark("precondition", "a precondition of the test"),))
    if outcome.verdict == "pass":
        return outcome
    remark = RowRemark("precondition", "a precondition of the test does not hold: the test is not valid")
    return replace(outcome, verdict="invalid", remarks=(remark,))


def _values(criterion: Criterion, match: Match, found: Instant) -> tuple[float, float]:
    """Return the values of flight and model, each at its own instant. [SI]"""
    values = []
    for who, signals, time in zip(WHO, (match.flight, match.model), (found.flight, found.model), strict=True):
        demand_finite(who, np.array([time]), value := np.interp([time], match.time, signals[criterion.channel]))
        values.append(value)
    if criterion.parameter.startswith("descent_rate"):
        values = [-value for value in values]
    error = float(difference(criterion.channel, *values)[0])
    return float(values[0][0]), float(values[0][0]) + error


def _times(found: Instant) -> RowRemark:
    text = f"flight at {found.flight:.2f} s, model at {found.model:.2f} s"
    return RowRemark("event", text, values={"flight": found.flight, "model": found.model}, unit="s")
