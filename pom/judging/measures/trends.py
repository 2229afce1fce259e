"""Correct trend and magnitude: the stated criteria, and the engineer's tick that alone makes them a pass (rule R16)."""

from __future__ import annotations

import numpy as np

from flightmech.names import lookup
from flightmech.units import from_si

from ...tolerances.bands import Invalid, Outcome, difference
from ...tolerances.criteria import Criterion
from ...tolerances.remarks import RowRemark
from ..comparison import Match

CORRELATION = 0.8  # least; the rule has no number, these are ours
RATIO = (0.5, 2.0)  # amplitude of the model over that of the flight
CLEAR = 0.2  # of the range: a peak that counts as an event of its own


def trend(criterion: Criterion, match: Match) -> Outcome:
    """Compare direction, order of events, shape and size of a change.

    Four criteria are stated: the largest departure from the start has the same sign; highest and lowest value come in
    the same order; the correlation is at least 0.8; the amplitude ratio lies between 0.5 and 2.  The outcome is advice.
    A tick of an engineer (``[ticks]`` of the case) makes it a pass that names him, but not when the sign is wrong.
    """
    time, flight, model = match.both(criterion)
    model = flight + difference(criterion.channel, flight, model)
    departures = [y - y[0] for y in (flight, model)]
    extremes = [float(d[np.argmax(np.abs(d))]) for d in departures]
    if extremes[0] == 0.0:
        raise Invalid("the flight does not change in the window")
    ratio = abs(extremes[1] / extremes[0])
    met = {
        "sign": extremes[0] * extremes[1] > 0.0,
        "order of peaks": _order(departures[0]) in ("", _order(departures[1])),
        "correlation": (correlation := _correlation(flight, model)) >= CORRELATION,
        "amplitude": RATIO[0] <= ratio <= RATIO[1],
    }
    shown = [_shown(criterion.channel, value) for value in extremes]
    failed = [name for name, good in met.items() if not good]
    text = (
        f"largest change of flight {shown[0]}, of model {shown[1]}, amplitude ratio {ratio:.2f}, correlation {correlation:.2f}; "
        f"{'all four criteria of trend are met' if not failed else 'not met: ' + ', '.join(failed)}"
    )
    tick = match.case.ticks.get(criterion.name, "")
    if tick and met["sign"]:
        verdict, ticked = "pass", f"ticked by {tick}"
    elif tick:
        verdict, ticked = "advisory", f"the tick ({tick}) does not hold: the model moves the other way"
    else:
        verdict, ticked = "advisory", "to be ticked by an engineer"
    measured = {"amplitude_ratio": ratio, "correlation": correlation}
    remarks = (RowRemark("trend", text, criterion.channel, measured, "1"), RowRemark("tick", ticked))
    applied = "correct trend, no number"
    return Outcome(verdict, at=float(time[0]), remarks=remarks, flight=extremes[0], model=extremes[1], applied=applied)


def _order(departure: np.ndarray) -> str:
    """Return which of the two extremes comes first; empty when there is only one clear extreme."""
    high, low = float(departure.max()), float(departure.min())
    span = high - low
    if min(high, -low) < CLEAR * span:
        return ""
    return "high first" if int(np.argmax(departure)) < int(np.argmin(departure)) else "low first"


def _correlation(flight: np.ndarray, model: np.ndarray) -> float:
    return float(np.corrcoef(flight, model)[0, 1]) if np.ptp(flight) > 0.0 and np.ptp(model) > 0.0 else 0.0


def _shown(channel: str, value: float) -> str:
    unit = lookup(channel).display_units
    return f"{from_si(value, unit):+.3g} {unit}"
