"""Cross plots of a control sweep: force or surface over position, breakout, and force increments of rapid sweeps.

The branches of a sweep are told apart by the direction in which the control moves: with friction the same position has
two forces.  Both records are compared branch by branch at equal position.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..criteria import Criterion
from ..events import marked
from ..match import WHO, Match
from ..tolerance import NAN, ROUNDING, Invalid, Outcome, applied, half_width, inside_window, ratios, scalar

TURN = 0.05  # of the travel: a smaller move back is noise, not a new branch; ours
SLACK = 0.02  # of the travel after a turn, where friction changes sides; ours
COVER = 0.9  # of the flight's travel on a branch that the model has to come through; ours
START = 0.01  # of the travel: the control has begun to move; ours
DIRECTIONS = {1: "increasing", -1: "decreasing"}


def curve(criterion: Criterion, match: Match) -> Outcome:
    """Judge y over x of a slow sweep: at every flight sample, the model at equal x on the same branch.

    A percentage is of the flight value at that x.
    """
    mask = inside_window(match.time, criterion.window)
    return _compare(criterion, *_branches(criterion, match, mask))


def force_increment(criterion: Criterion, match: Match) -> Outcome:
    """Judge the force of a moderate or rapid sweep above that of the slow one, at equal position on the same branch.

    The slow (static) sweep lies between the events ``static_sweep_start`` and ``static_sweep_end``.
    """
    mask = inside_window(match.time, criterion.window)
    slow = inside_window(match.time, (marked(match, "static_sweep_start"), marked(match, "static_sweep_end")))
    flight, model = _branches(criterion, match, mask)
    static = _branches(criterion, match, slow)
    return _compare(criterion, _above(flight, static[0]), _above(model, static[1]))


Branches = dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]]  # direction of motion: time, x and y


def _branches(criterion: Criterion, match: Match, mask: np.ndarray) -> tuple[Branches, Branches]:
    time, *xs = match.over(mask, criterion.abscissa)
    _, *ys = match.over(mask, criterion.channel)
    found = []
    for who, x, y in zip(WHO, xs, ys, strict=True):
        travel = float(np.ptp(x))
        if travel <= 0.0:
            raise Invalid(f"{who} does not move {criterion.abscissa}")
        way = directions(x, TURN * travel)
        kept = _after_turns(x, way, SLACK * travel)
        found.append({d: (time[k], x[k], y[k]) for d in DIRECTIONS if (k := (way == d) & kept).sum() > 1})
    return found[0], found[1]


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


def _after_turns(x: np.ndarray, way: np.ndarray, slack: float) -> np.ndarray:
    """Return the samples further than `slack` from where their branch began."""
    starts = np.flatnonzero(np.diff(way, prepend=way[0] + 1))
    begin = x[starts][np.cumsum(np.isin(np.arange(x.size), starts)) - 1]
    return np.abs(x - begin) > slack


def _at(x: np.ndarray, branch: tuple[np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
    """Return y of a branch at given x; NaN beyond it."""
    order = np.argsort(branch[1], kind="stable")
    return np.interp(x, branch[1][order], branch[2][order], left=np.nan, right=np.nan)


def _above(branches: Branches, static: Branches) -> Branches:
    """Return the branches with y above that of the static sweep, where it went."""
    found: Branches = {}
    for d, (time, x, y) in branches.items():
        if d in static:
            increment = y - _at(x, static[d])
            there = np.isfinite(increment)
            found[d] = (time[there], x[there], increment[there])
    return found


def _compare(criterion: Criterion, flight: Branches, model: Branches) -> Outcome:
    times, widths, errors, values = [], [], [], []
    for d, (time, x, y) in flight.items():
        theirs = _at(x, model[d]) if d in model else np.full(x.size, np.nan)
        there = np.isfinite(theirs)
        span = np.ptp(x[there]) if there.any() else 0.0
        if span < COVER * np.ptp(x):
            raise Invalid(
                f"the model comes through {100.0 * span / np.ptp(x):.0f} % of the travel with {criterion.abscissa} {DIRECTIONS[d]}"
            )
        times.append(time[there])
        values.append(y[there])
        widths.append(half_width(criterion, y[there]))
        errors.append(theirs[there] - y[there])
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
        note=f"{len(times)} branch{'es' if len(times) > 1 else ''} at equal {criterion.abscissa}",
        applied=applied(criterion, width, value),
        rms=float(np.sqrt(np.mean(np.square(ratio)))),
    )


def breakout(criterion: Criterion, match: Match) -> Outcome:
    """Judge the force at the first movement from the position at the start, in both directions where the sweep has both."""
    mask = inside_window(match.time, criterion.window)
    time, *xs = match.over(mask, criterion.abscissa)
    _, *forces = match.over(mask, criterion.channel)
    least = START * float(np.ptp(xs[0]))
    judged = []
    for d, word in DIRECTIONS.items():
        flight, model = (_first_force(x, F, d, least) for x, F in zip(xs, forces, strict=True))
        if flight is None:
            continue
        if model is None:
            raise Invalid(f"the model does not move {criterion.abscissa} {word}")
        judged.append(scalar(criterion, flight, model, float(time[0]), f"{word}: {flight:.1f} N in flight, {model:.1f} N in the model"))
    if not judged:
        raise Invalid(f"the flight does not move {criterion.abscissa}")
    worst = max(judged, key=lambda outcome: outcome.worst_ratio)
    return replace(worst, note="; ".join(outcome.note for outcome in judged))


def _first_force(x: np.ndarray, force: np.ndarray, direction: int, least: float) -> float | None:
    """Return the force when the control first leaves its start by `least` in a direction; None when it does not."""
    away = direction * (x - x[0]) > least
    if not away.any():
        return None
    k = int(np.argmax(away))
    return float(np.interp(x[0] + direction * least, *sorted_pair(x[k - 1 : k + 1], force[k - 1 : k + 1])))


def sorted_pair(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return samples in the order of x."""
    order = np.argsort(x)
    return x[order], y[order]


def dead_band(criterion: Criterion, match: Match) -> Outcome:
    """Judge the dead band of the nose-wheel steering: how far the wheel lags between the two branches at pedals neutral."""
    mask = inside_window(match.time, criterion.window)
    bands = []
    for who, branches in zip(WHO, _branches(criterion, match, mask), strict=True):
        angles = [_at(np.zeros(1), branches[d])[0] if d in branches else np.nan for d in DIRECTIONS]
        if not np.isfinite(angles).all():
            raise Invalid(f"{who} does not bring {criterion.abscissa} through neutral in both directions")
        bands.append(abs(float(angles[1] - angles[0])))
    return scalar(criterion, bands[0], bands[1], criterion.window[0])
