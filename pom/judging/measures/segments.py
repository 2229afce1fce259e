"""Climb and descent over a segment: mean rates and gradients from height and time, never means of instantaneous rates."""

from __future__ import annotations

import numpy as np

from flightmech.units import FOOT

from ...tolerances.bands import Invalid, NotJudged, Outcome, scalar
from ...tolerances.criteria import Criterion
from ...tolerances.parameter_channels import plain_id
from ...tolerances.remarks import RowRemark
from ..comparison import Match

LEAST = {"1.c.1": 1000.0, "1.c.2": 1000.0, "1.c.4": 1000.0, "1.d.4": 1000.0, "1.d.5": 3000.0}
"""Height that the segment of a test has to cover. [ft]"""


def segment_mean(criterion: Criterion, match: Match) -> Outcome:
    """Judge the mean speed of a climb or descent, or its mean rate: height change over time.

    A rate of descent counts positive downwards, as the table prints it.
    """
    remarks = demand_height(criterion, match)
    if criterion.channel != "hdot":
        time, flight, model = match.both(criterion)
        values = [float(np.trapezoid(y, time) / (time[-1] - time[0])) for y in (flight, model)]
    else:
        time, flight, model = match.both(criterion, "h")
        sign = -1.0 if criterion.parameter == "descent_rate" else 1.0
        values = [sign * float(y[-1] - y[0]) / float(time[-1] - time[0]) for y in (flight, model)]
    return scalar(criterion, values[0], values[1], float(time[-1]), remarks)


def demand_height(criterion: Criterion, match: Match) -> tuple[RowRemark, ...]:
    """Return a remark on the height that the flight covers; less than the table requires is invalid without a reason in the case."""
    required = LEAST.get(plain_id(match.case.id), 0.0)
    if "h" not in match.flight:
        return ()
    _, flight, _ = match.both(criterion, "h")
    covered = abs(float(flight[-1] - flight[0])) / FOOT
    text = f"segment of {covered:.0f} ft"
    if covered < required and not match.case.shortened:
        raise Invalid(f"{text}; the table requires {required:.0f} ft or more: widen the window, or give the reason in case.shortened")
    text = text if covered >= required else f"{text} of {required:.0f} ft required"
    return (RowRemark("span", text, "h", {"covered": covered, "required": required}, "ft"),)


def floor(criterion: Criterion, match: Match) -> Outcome:
    """Judge the gradient of the model's climb against the certified one, below which it fails even inside its band.

    Gradient is height gained over horizontal distance through the air, so that wind does not count.  The ratio of the
    outcome is the certified gradient over that of the model.
    """
    certified = match.case.certified.get(criterion.parameter)
    if certified is None:
        raise NotJudged(f"give the certified {criterion.parameter} in [certified]")
    gradients = [_gradient(criterion, match, which) for which in range(2)]
    short = gradients[1] < certified
    return Outcome(
        verdict="fail" if short else "pass",
        worst=gradients[1] - certified,
        worst_ratio=certified / gradients[1] if gradients[1] > 0.0 else float("inf"),
        at=criterion.window[1],
        remarks=(RowRemark("certified", "below the certified gradient", values={"certified": certified}, unit="1"),) if short else (),
        flight=gradients[0],
        model=gradients[1],
        applied=f"not below {100.0 * certified:.4g} %",
    )


def _gradient(criterion: Criterion, match: Match, which: int) -> float:
    time, *height = match.both(criterion, "h")
    _, *speed = match.both(criterion, "V")
    h, V = height[which], speed[which]
    along = np.sqrt(np.maximum(V**2 - np.gradient(h, time) ** 2, 0.0))
    return float(h[-1] - h[0]) / float(np.trapezoid(along, time))
