"""Correct trend and magnitude: the stated criteria, and the engineer's tick that alone makes them a pass (rule R16)."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from flightmech.names import lookup
from flightmech.units import DEGREE, from_si

from ...tolerances.bands import NotJudged, Outcome, difference, half_width
from ...tolerances.criteria import Criterion
from ...tolerances.remarks import RowRemark
from ..comparison import Match

if TYPE_CHECKING:
    from ...cases.case import PomCase

CORRELATION = 0.8  # least; the rule has no number, these are ours
RATIO = (0.5, 2.0)  # amplitude of the model over that of the flight
CLEAR = 0.2  # of the range: a peak that counts as an event of its own
SCATTER = 3.0  # standard deviations of the flight's own scatter: a change below is no trend
SPAN = 1.0  # [s] over which scatter is separated from motion
RESOLVED = {"rad": 0.1 * DEGREE, "rad s-1": 0.1 * DEGREE}  # least dead band by unit: what is read off a recorded attitude or rate


def trend(criterion: Criterion, match: Match) -> Outcome:
    """Compare direction, order of events, shape and size of a change.

    Four criteria are stated: the largest departure from the start has the same sign; highest and lowest value come in
    the same order; the correlation is at least 0.8; the amplitude ratio lies between 0.5 and 2.  One that is not met fails
    the row.  All met is advice: a tick of an engineer (``[ticks]`` of the case) makes it a pass that names him, and he may
    decide against shape and size, not against the sign.

    A flight that changes by less than the dead band (`dead_band`) shows no trend, and no direction is the wrong one; then the
    departure of the model stays within the tolerance that the row has on the channel, or within twice the dead band where it
    has none.
    """
    time, flight, model = match.both(criterion)
    model = flight + difference(criterion.channel, flight, model)
    departures = [y - y[0] for y in (flight, model)]
    extremes = [float(d[np.argmax(np.abs(d))]) for d in departures]
    dead = match.once(("dead band", criterion.name), lambda: dead_band(criterion.channel, time, flight))
    shown = [_shown(criterion.channel, value) for value in (*extremes, dead)]
    if abs(extremes[0]) <= dead:
        allowed = _allowed(match.case, criterion.channel, flight) or RATIO[1] * dead
        met = {"no trend": abs(extremes[1]) <= allowed}
        measured: dict[str, float] = {"departure": abs(extremes[1]) / allowed if allowed else 0.0}
        text = f"largest change of flight {shown[0]}, within the dead band of {shown[2]}: no trend; of model {shown[1]}"
        text += f", allowed {_shown(criterion.channel, allowed)}"
    else:
        ratio, correlation = abs(extremes[1] / extremes[0]), _correlation(flight, model)
        met = {
            "sign": extremes[0] * extremes[1] > 0.0,
            "order of peaks": _order(departures[0]) in ("", _order(departures[1])),
            "correlation": correlation >= CORRELATION,
            "amplitude": RATIO[0] <= ratio <= RATIO[1],
        }
        measured = {"amplitude_ratio": ratio, "correlation": correlation}
        text = f"largest change of flight {shown[0]}, of model {shown[1]}, amplitude ratio {ratio:.2f}, correlation {correlation:.2f}"
    failed = [name for name, good in met.items() if not good]
    text += f"; not met: {', '.join(failed)}" if failed else "; all criteria of trend are met"
    verdict, ticked = _verdict(match.case.ticks.get(criterion.name, ""), failed)
    remarks = (RowRemark("trend", text, criterion.channel, measured, "1"), RowRemark("tick", ticked))
    applied = "correct trend, no number"
    return Outcome(verdict, at=float(time[0]), remarks=remarks, flight=extremes[0], model=extremes[1], applied=applied)


def _verdict(tick: str, failed: list[str]) -> tuple[str, str]:
    """Return the verdict and what becomes of the tick."""
    if tick and not {"sign", "no trend"} & set(failed):
        return "pass", f"ticked by {tick}"
    if tick:
        return (
            "fail",
            f"the tick ({tick}) does not hold: {'the model moves the other way' if 'sign' in failed else 'the flight has no trend'}",
        )
    return ("fail", "an engineer may tick it with his reason") if failed else ("advisory", "to be ticked by an engineer")


def _allowed(case: PomCase, channel: str, flight: np.ndarray) -> float:
    """Return the narrowest half width that other rows of the case have on a channel; 0 when none has one."""
    widths = []
    for criterion in case.criteria:
        if criterion.channel == channel and criterion.applies and criterion.measure in ("trace", "end_value"):
            with suppress(NotJudged):
                widths.append(float(half_width(criterion, flight).min()))
    return min(widths, default=0.0)


def dead_band(channel: str, time: np.ndarray, flight: np.ndarray) -> float:
    """Return the change of a flight trace below which it shows no trend. [SI]

    Three standard deviations of its scatter about straight lines over one second, the median of all such stretches; at least
    0.1 deg or 0.1 deg/s for attitudes and rates.  The rule has no number, these are ours.
    """
    step = max(round(SPAN / float(np.median(np.diff(time)))), 3)
    stretches = [slice(start, start + step + 1) for start in range(0, max(time.size - step, 1), step)]
    scatters = [np.std(y - np.polynomial.Polynomial.fit(t, y, 1)(t)) for t, y in ((time[s], flight[s]) for s in stretches) if t.size > 2]
    scatter = float(np.median(scatters)) if scatters else 0.0
    return max(SCATTER * scatter, RESOLVED.get(lookup(channel).units, 0.0))


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
