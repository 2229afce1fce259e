"""Numbers of taxi and trim tests: radius of a turn, rate of a trim surface."""

from __future__ import annotations

import numpy as np

from ...tolerances.bands import Invalid, Outcome, scalar
from ...tolerances.criteria import Criterion
from ..comparison import WHO, Match
from ..events import crossing
from .curves import dead_band

LEAST_TURN = np.radians(90.0)  # ours: less does not determine a radius


def number(criterion: Criterion, match: Match) -> Outcome:
    """Judge a number that a whole manoeuvre gives."""
    if criterion.parameter == "nosewheel_deadband":
        return dead_band(criterion, match)
    values = _RADIUS_OR_RATE[criterion.parameter](criterion, match)
    return scalar(criterion, values[0], values[1], criterion.window[0])


def _radii(criterion: Criterion, match: Match) -> list[float]:
    """Return the radii of the paths of the c.g.: distance over the ground per change of heading. [m]"""
    _, *distances = match.both(criterion, "distance")
    _, *headings = match.both(criterion, "psi")
    radii = []
    for who, distance, psi in zip(WHO, distances, headings, strict=True):
        smooth = np.unwrap(psi)
        turned = abs(float(smooth[-1] - smooth[0]))
        if turned < LEAST_TURN:
            raise Invalid(f"{who} turns by {np.degrees(turned):.0f} deg; at least {np.degrees(LEAST_TURN):.0f} deg determine a radius")
        radii.append(float(distance[-1] - distance[0]) / turned)
    return radii


def _rates(criterion: Criterion, match: Match) -> list[float]:
    """Return the mean rates of a trim surface between 10 and 90 % of its travel. [rad s-1]"""
    time, *surfaces = match.both(criterion, criterion.abscissa)
    rates = []
    for who, y in zip(WHO, surfaces, strict=True):
        travel = float(y[-1] - y[0])
        direction = 1 if travel > 0.0 else -1
        passed = [crossing(time, y, float(y[0]) + share * travel, direction) for share in (0.1, 0.9)]
        if travel == 0.0 or passed[0] is None or passed[1] is None:
            raise Invalid(f"{who} does not move {criterion.abscissa}")
        rates.append(0.8 * travel / (passed[1] - passed[0]))
    return rates


_RADIUS_OR_RATE = {"turn_radius": _radii, "trim_rate": _rates}
