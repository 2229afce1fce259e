"""Cross plots of a control sweep: force or surface over position, breakout, and force increments of rapid sweeps.

The branches of a sweep are distinguished by the direction in which the control moves: with friction the same position has
two forces.  Both records are compared branch by branch at equal position.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...tolerances.bands import NAN, ROUNDING, Invalid, Outcome, applied, half_width, inside_window, ratios, scalar
from ...tolerances.criteria import Criterion
from ...tolerances.remarks import RowRemark
from ..comparison import WHO, Match
from ..events import event_time

TURN = 0.05  # of the travel: a smaller move back is noise, not a new branch; ours
SLACK = 0.02  # of the travel after a turn, where friction changes sides; ours
COVER = 0.9  # of the flight's travel on a branch that the model has to come through; ours
START = 0.01  # of the travel: the control has begun to move; ours
DIRECTIONS = {1: "increasing", -1: "decreasing"}


@dataclass(frozen=True)
class Branch:
    """A part of a sweep in which the control moves one way: 1 increasing, -1 decreasing."""

    direction: int
    time: np.ndarray
    x: np.ndarray
    y: np.ndarray

    def at(self, x: np.ndarray) -> np.ndarray:
        """Return y at given x, linear; NaN beyond the branch."""
        order = np.argsort(self.x, kind="stable")
        return np.interp(x, self.x[order], self.y[order], left=np.nan, right=np.nan)

    def together(self, other: Branch) -> float:
        """Return for how long two branches of the same direction run at the same time; negative when they do not. [s]"""
        if self.direction != other.direction:
            return -np.inf
        return float(min(self.time[-1], other.time[-1]) - max(self.time[0], other.time[0]))


def curve(criterion: Criterion, match: Match) -> Outcome:
    """Judge y over x of a slow sweep: at every flight sample, the model at equal x on the same branch.

    A percentage is of the flight value at that x.
    """
    mask = inside_window(match.time, criterion.window)
    return _compare(criterion, *_branches(criterion, match, mask))


def force_increment(criterion: Criterion, match: Match) -> Outcome:
    """Judge the force of a moderate or rapid sweep above that of the slow one, at equal position and direction.

    The slow (static) sweep lies between the events ``static_sweep_start`` and ``static_sweep_end``.
    """
    mask = inside_window(match.time, criterion.window)
    slow = inside_window(match.time, (event_time(match, "static_sweep_start"), event_time(match, "static_sweep_end")))
    runs = zip(_branches(criterion, match, mask), _branches(criterion, match, slow), strict=True)
    flight, model = (_above(rapid, static) for rapid, static in runs)
    return _compare(criterion, flight, model)


def _branches(criterion: Criterion, match: Match, mask: np.ndarray) -> tuple[list[Branch], list[Branch]]:
    """Return the branches of flight and model, without the samples next to a turn."""
    time, *xs = match.over(mask, criterion.abscissa)
    _, *ys = match.over(mask, criterion.channel)
    found = []
    for who, x, y in zip(WHO, xs, ys, strict=True):
        travel = float(np.ptp(x))
        if travel <= 0.0:
            raise Invalid(f"{who} does not move {criterion.abscissa}")
        way = directions(x, TURN * travel)
        parts = np.split(np.arange(x.size), np.flatnonzero(np.diff(way)) + 1)
        kept = [part[_progress(int(way[part[0]]) * (x[part] - x[part[0]]), SLACK * travel)] for part in parts]
        found.append([Branch(int(way[k[0]]), time[k], x[k], y[k]) for k in kept if k.size > 1])
    return found[0], found[1]


def _progress(moved: np.ndarray, slack: float) -> np.ndarray:
    """Return the samples beyond `slack` that go further than all before; while a control stands still its force may be any."""
    before = np.maximum.accumulate(np.concatenate([[0.0], moved[:-1]]))
    return (moved > slack) & (moved > before)


def directions(x: np.ndarray, least: float) -> np.ndarray:
    """Return 1 where x is on its way up, -1 on its way down; it turns at an extreme from which it moves back by `least`."""
    way = np.zeros(x.size, int)
    current, extreme, since = 0, 0, 0
    low = high = 0
    for i, value in enumerate(x):
        if current == 0:
            low, high = (i if value < x[low] else low), (i if value > x[high] else high)
            if value - x[low] > least:
                current, extreme, since = 1, i, low
            elif x[high] - value > least:
                current, extreme, since = -1, i, high
        elif current * (value - x[extreme]) >= 0.0:
            extreme = i
        elif current * (x[extreme] - value) > least:
            way[since : extreme + 1] = current
            current, since, extreme = -current, extreme + 1, i
    way[since:] = current
    return way


def _above(rapid: list[Branch], static: list[Branch]) -> list[Branch]:
    """Return the branches of a rapid sweep with y above that of the static one, where that went."""
    found = []
    for branch in rapid:
        same = [other for other in static if other.direction == branch.direction]
        levels = [other.at(branch.x) for other in same] or [np.full(branch.x.size, np.nan)]
        increment = branch.y - np.array(levels)[np.argmax(np.isfinite(levels), axis=0), np.arange(branch.x.size)]
        there = np.isfinite(increment)
        if there.sum() > 1:
            found.append(Branch(branch.direction, branch.time[there], branch.x[there], increment[there]))
    return found


def _compare(criterion: Criterion, flight: list[Branch], model: list[Branch]) -> Outcome:
    times, widths, errors, values = [], [], [], []
    for branch in flight:
        partner = max(model, key=branch.together, default=None)
        if partner is None or branch.together(partner) <= 0.0:
            raise Invalid(f"the model does not move {criterion.abscissa} as the flight does, {DIRECTIONS[branch.direction]}")
        theirs = partner.at(branch.x)
        there = np.isfinite(theirs)
        share = np.ptp(branch.x[there]) / np.ptp(branch.x) if there.any() else 0.0
        if share < COVER:
            way = DIRECTIONS[branch.direction]
            raise Invalid(f"the model comes through {100.0 * share:.0f} % of the flight's {way} travel of {criterion.abscissa}")
        times.append(branch.time[there])
        values.append(branch.y[there])
        widths.append(half_width(criterion, branch.y[there]))
        errors.append(theirs[there] - branch.y[there])
    if not times:
        raise Invalid(f"the flight has no sweep of {criterion.abscissa} in the window")
    time, width, error, value = (np.concatenate(parts) for parts in (times, widths, errors, values))
    ratio = ratios(error, width)
    out, worst = ratio > 1.0 + ROUNDING, int(np.argmax(ratio))
    return Outcome(
        verdict="fail" if out.any() else "pass",
        width=float(width.min()),
        worst=float(error[worst]),
        worst_ratio=float(ratio[worst]),
        at=float(time[worst]),
        first_exit=float(time[out].min()) if out.any() else NAN,
        inside=float(1.0 - out.mean()),
        remarks=(_branch_remark(len(times), criterion.abscissa),),
        applied=applied(criterion, width, value),
        rms=float(np.sqrt(np.mean(np.square(ratio)))),
    )


def _branch_remark(count: int, abscissa: str) -> RowRemark:
    text = f"{count} branch{'es' if count > 1 else ''} at equal {abscissa}"
    return RowRemark("method", text, abscissa, {"branches": float(count)}, "1")


def breakout(criterion: Criterion, match: Match) -> Outcome:
    """Judge the force at the first movement from the position at the start, in both directions where the sweep has both."""
    mask = inside_window(match.time, criterion.window)
    time, *xs = match.over(mask, criterion.abscissa)
    _, *forces = match.over(mask, criterion.channel)
    least = START * float(np.ptp(xs[0]))
    judged = []
    for d, way in DIRECTIONS.items():
        flight, model = (_first_force(x, F, d, least) for x, F in zip(xs, forces, strict=True))
        if flight is None:
            continue
        if model is None:
            raise Invalid(f"the model does not move {criterion.abscissa} {way}")
        text = f"{way}: {flight:.1f} N in flight, {model:.1f} N in the model"
        remark = RowRemark("values", text, criterion.channel, {"flight": flight, "model": model}, "N")
        judged.append(scalar(criterion, flight, model, float(time[0]), (remark,)))
    if not judged:
        raise Invalid(f"the flight does not move {criterion.abscissa}")
    worst = max(judged, key=lambda outcome: outcome.worst_ratio)
    return replace(worst, remarks=tuple(remark for outcome in judged for remark in outcome.remarks))


def _first_force(x: np.ndarray, force: np.ndarray, direction: int, least: float) -> float | None:
    """Return the force when the control first leaves its start by `least` in a direction; None when it does not."""
    away = direction * (x - x[0])
    if not (away > least).any():
        return None
    k = int(np.argmax(away > least))
    return float(np.interp(least, away[k - 1 : k + 1], force[k - 1 : k + 1]))


def dead_band(criterion: Criterion, match: Match) -> Outcome:
    """Judge the dead band of the nose-wheel steering: how far the wheel lags between the two branches at pedals neutral."""
    mask = inside_window(match.time, criterion.window)
    bands = []
    for who, branches in zip(WHO, _branches(criterion, match, mask), strict=True):
        angles = {branch.direction: angle for branch in branches if np.isfinite(angle := float(branch.at(np.zeros(1))[0]))}
        if len(angles) < 2:
            raise Invalid(f"{who} does not bring {criterion.abscissa} through neutral in both directions")
        bands.append(abs(angles[-1] - angles[1]))
    return scalar(criterion, bands[0], bands[1], criterion.window[0])
