"""Free motion of a control after its release (2.b.1-2.b.3): P0, Pn, An, number of overshoots, time
of an overdamped one.

The steady (neutral) values of the two records are overlaid first, each being subtracted from its
own record; then everything is measured in fractions of the first displacement Ad.  Overshoots
within 5 % of Ad are not significant.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pom.judging.signals import WHO, Comparison, event_time
from pom.tolerances.bands import (
    NAN,
    ROUNDING,
    Invalid,
    Judgement,
    RowRemark,
    applied_tolerance,
    band_ratios,
    demand_finite,
    half_width,
    inside_window,
    judge_number,
)
from pom.tolerances.criteria import Criterion

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
        """Return for how long two branches of the same direction run at the same time; negative
        when they do not. [s]
        """
        if self.direction != other.direction:
            return -np.inf
        return float(min(self.time[-1], other.time[-1]) - max(self.time[0], other.time[0]))


def judge_curve(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge y over x of a slow sweep: at every flight sample, the model at equal x on the same
    branch.

    A percentage is of the flight value at that x.
    """
    mask = inside_window(match.time, criterion.window)
    return _compare(criterion, *_branches(criterion, match, mask))


def force_increment(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge the force of a moderate or rapid sweep above that of the slow one, at equal position
    and direction.

    The slow (static) sweep lies between the events ``static_sweep_start`` and ``static_sweep_end``.
    """
    mask = inside_window(match.time, criterion.window)
    slow = inside_window(
        match.time, (event_time(match, "static_sweep_start"), event_time(match, "static_sweep_end"))
    )
    runs = zip(_branches(criterion, match, mask), _branches(criterion, match, slow), strict=True)
    flight, model = (_above(rapid, static) for rapid, static in runs)
    return _compare(criterion, flight, model)


def _branches(
    criterion: Criterion, match: Comparison, mask: np.ndarray
) -> tuple[list[Branch], list[Branch]]:
    """Return the branches of flight and model, without the samples next to a turn."""
    time, *xs = match.over(mask, criterion.abscissa)
    _, *ys = match.over(mask, criterion.channel)
    found = []
    for who, x, y in zip(WHO, xs, ys, strict=True):
        travel = float(np.ptp(x))
        if travel <= 0.0:
            raise Invalid(f"{who} does not move {criterion.abscissa}")
        way = motion_directions(x, TURN * travel)
        parts = np.split(np.arange(x.size), np.flatnonzero(np.diff(way)) + 1)
        kept = [
            part[_progress(int(way[part[0]]) * (x[part] - x[part[0]]), SLACK * travel)]
            for part in parts
        ]
        found.append([Branch(int(way[k[0]]), time[k], x[k], y[k]) for k in kept if k.size > 1])
    return found[0], found[1]


def _progress(moved: np.ndarray, slack: float) -> np.ndarray:
    """Return the samples beyond `slack` that go further than all before; while a control stands
    still its force may be any.
    """
    before = np.maximum.accumulate(np.concatenate([[0.0], moved[:-1]]))
    return (moved > slack) & (moved > before)


def motion_directions(x: np.ndarray, least: float) -> np.ndarray:
    """Return 1 where x is on its way up, -1 on its way down; it turns at an extreme from which it
    moves back by `least`.
    """
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
        increment = (
            branch.y
            - np.array(levels)[np.argmax(np.isfinite(levels), axis=0), np.arange(branch.x.size)]
        )
        there = np.isfinite(increment)
        if there.sum() > 1:
            found.append(
                Branch(branch.direction, branch.time[there], branch.x[there], increment[there])
            )
    return found


def _compare(criterion: Criterion, flight: list[Branch], model: list[Branch]) -> Judgement:
    times, widths, errors, values = [], [], [], []
    for branch in flight:
        partner = max(model, key=branch.together, default=None)
        if partner is None or branch.together(partner) <= 0.0:
            raise Invalid(
                f"the model does not move {criterion.abscissa} as the flight does, "
                f"{DIRECTIONS[branch.direction]}"
            )
        theirs = partner.at(branch.x)
        there = np.isfinite(theirs)
        share = np.ptp(branch.x[there]) / np.ptp(branch.x) if there.any() else 0.0
        if share < COVER:
            way = DIRECTIONS[branch.direction]
            raise Invalid(
                f"the model comes through {100.0 * share:.0f} % of the flight's {way} travel "
                f"of {criterion.abscissa}"
            )
        times.append(branch.time[there])
        values.append(branch.y[there])
        widths.append(half_width(criterion, branch.y[there]))
        errors.append(theirs[there] - branch.y[there])
    if not times:
        raise Invalid(f"the flight has no sweep of {criterion.abscissa} in the window")
    time, width, error, value = (np.concatenate(parts) for parts in (times, widths, errors, values))
    ratio = band_ratios(error, width)
    out, worst = ratio > 1.0 + ROUNDING, int(np.argmax(ratio))
    return Judgement(
        verdict="fail" if out.any() else "pass",
        width=float(width.min()),
        worst=float(error[worst]),
        worst_ratio=float(ratio[worst]),
        at=float(time[worst]),
        first_exit=float(time[out].min()) if out.any() else NAN,
        inside=float(1.0 - out.mean()),
        remarks=(_branch_remark(len(times), criterion.abscissa),),
        applied=applied_tolerance(criterion, width, value),
        rms=float(np.sqrt(np.mean(np.square(ratio)))),
    )


def _branch_remark(count: int, abscissa: str) -> RowRemark:
    text = f"{count} branch{'es' if count > 1 else ''} at equal {abscissa}"
    return RowRemark("method", text, abscissa, {"branches": float(count)}, "1")


def judge_breakout(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge the force at the first movement from the position at the start, in both directions
    where the sweep has both.
    """
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
        remark = RowRemark(
            "values", text, criterion.channel, {"flight": flight, "model": model}, "N"
        )
        judged.append(judge_number(criterion, flight, model, float(time[0]), (remark,)))
    if not judged:
        raise Invalid(f"the flight does not move {criterion.abscissa}")
    worst = max(judged, key=lambda outcome: outcome.worst_ratio)
    return replace(worst, remarks=tuple(remark for outcome in judged for remark in outcome.remarks))


def _first_force(x: np.ndarray, force: np.ndarray, direction: int, least: float) -> float | None:
    """Return the force when the control first leaves its start by `least` in a direction; None when
    it does not.
    """
    away = direction * (x - x[0])
    if not (away > least).any():
        return None
    k = int(np.argmax(away > least))
    return float(np.interp(least, away[k - 1 : k + 1], force[k - 1 : k + 1]))


def judge_dead_band(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge the dead band of the nose-wheel steering: how far the wheel lags between the two
    branches at pedals neutral.
    """
    mask = inside_window(match.time, criterion.window)
    bands = []
    for who, branches in zip(WHO, _branches(criterion, match, mask), strict=True):
        angles = {
            branch.direction: angle
            for branch in branches
            if np.isfinite(angle := float(branch.at(np.zeros(1))[0]))
        }
        if len(angles) < 2:
            raise Invalid(
                f"{who} does not bring {criterion.abscissa} through neutral in both directions"
            )
        bands.append(abs(angles[-1] - angles[1]))
    return judge_number(criterion, bands[0], bands[1], criterion.window[0])


RESIDUAL = 0.05  # of Ad: the residual band; smaller overshoots are not significant
FROM, TO = 0.9, 0.1  # of Ad
# half cycles: a crossing in the residual band that comes later belongs to a drift, not to the
# oscillation; ours
LATE = 1.5
NEUTRAL = 0.5  # [s] at the end of the window, over which the neutral value is the mean; ours
SETTLED = 0.02  # of Ad: standard deviation over that time within which a control stands still; ours


@dataclass(frozen=True)
class FreeMotion:
    """What is measured of a control after its release.

    Attributes
    ----------
    time : array (time,)
        From the release. [s]
    y : array (time,)
        Displacement from neutral over Ad; starts at 1.
    Ad : float
        First displacement from neutral. [SI]
    crossings : array (crossing,)
        Times at which it passes neutral: once between two excursions beyond the residual band, and
        after the last while it oscillates on. [s]
    overshoots : array (overshoot,)
        Sizes of the significant overshoots over Ad.
    """

    time: np.ndarray
    y: np.ndarray
    Ad: float
    crossings: np.ndarray
    overshoots: np.ndarray

    def falls_to(self, level: float) -> float | None:
        """Return when the displacement first comes down to a fraction of Ad; None when it does not.
        [s]
        """
        below = self.y <= level
        if not below.any() or below[0]:
            return None
        k = int(np.argmax(below))
        return float(
            self.time[k - 1]
            + (self.y[k - 1] - level)
            / (self.y[k - 1] - self.y[k])
            * (self.time[k] - self.time[k - 1])
        )

    @property
    def p0(self) -> float | None:
        """Time from 0.9 Ad to the first crossing of neutral. [s]"""
        start = self.falls_to(FROM)
        return (
            None if start is None or not self.crossings.size else float(self.crossings[0]) - start
        )

    def overshoot(self, n: int) -> float:
        """Return the size of the n-th overshoot, significant or not; zero when there is none. [SI]"""
        if n <= self.overshoots.size:
            return float(self.overshoots[n - 1]) * abs(self.Ad)
        if n > self.crossings.size:
            return 0.0
        end = self.crossings[n] if n < self.crossings.size else np.inf
        excursion = (self.time > self.crossings[n - 1]) & (self.time < end)
        return float(np.abs(self.y[excursion]).max(initial=0.0)) * abs(self.Ad)

    def period(self, n: int) -> float | None:
        """Return the n-th full cycle after the first crossing; None when the record does not hold
        it. [s]
        """
        last = 2 * n
        return (
            float(self.crossings[last] - self.crossings[last - 2])
            if last < self.crossings.size
            else None
        )


def measure_free_motion(
    criterion: Criterion, time: np.ndarray, x: np.ndarray, who: str = "flight"
) -> FreeMotion:
    """Measure the motion of a control from its release at the start of the window.

    Parameters
    ----------
    criterion : Criterion
        Its window begins at the release and ends when the control stands still.
    time, x : array (time,)
        [s], [SI]

    Raises
    ------
    Invalid
        Samples are missing, the control is not released, or does not come to rest.
    """
    mask = inside_window(time, criterion.window)
    t, x = time[mask] - time[mask][0], x[mask]
    demand_finite(who, time[mask], x)
    rest = t >= t[-1] - NEUTRAL
    neutral = float(x[rest].mean())
    Ad = float(x[0] - neutral)
    if abs(Ad) < 1e-9 or np.std(x[rest]) > SETTLED * abs(Ad):
        raise Invalid(
            f"{who}: the control is not displaced at the start of the window, or not at rest "
            f"in its last {NEUTRAL:g} s"
        )
    y = (x - neutral) / Ad
    crossings, overshoots = _excursions(t, y)
    return FreeMotion(t, y, Ad, crossings, overshoots)


def _excursions(t: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the crossings of neutral and the sizes of the overshoots.

    Between two excursions beyond the residual band noise may pass neutral several times; the
    crossing is in the middle.
    """
    side = np.where(y > RESIDUAL, 1, np.where(y < -RESIDUAL, -1, 0))
    outside = np.flatnonzero(side)
    turns = np.flatnonzero(
        np.diff(side[outside])
    )  # last sample of an excursion before one on the other side
    starts, stops = outside[turns], outside[turns + 1]
    crossings = [_middle(t, y, a, b) for a, b in zip(starts, stops, strict=True)]
    ends = [*outside[turns[1:]], outside[-1]] if turns.size else []
    overshoots = [float(np.abs(y[a : b + 1]).max()) for a, b in zip(stops, ends, strict=True)]
    crossings += _residual_crossings(crossings, _zeros(t, y, int(outside[-1]), t.size - 1))
    return np.array(crossings), np.array(overshoots)


def _residual_crossings(crossings: list[float], after: np.ndarray) -> list[float]:
    """Return the crossings after the last excursion that still belong to the oscillation; one that
    comes late is a creep to neutral.
    """
    if not crossings:
        return [float(time) for time in after]
    half = crossings[-1] - crossings[-2] if len(crossings) > 1 else 2.0 * crossings[-1]
    kept, last = [], crossings[-1]
    for time in after:
        if time - last > LATE * half:
            break
        kept.append(float(time))
        last = time
    return kept


def _zeros(t: np.ndarray, y: np.ndarray, a: int, b: int) -> np.ndarray:
    """Return the times at which y passes zero between two samples, linear. [s]"""
    k = a + np.flatnonzero((y[a:b] > 0.0) != (y[a + 1 : b + 1] > 0.0))
    return t[k] - y[k] * (t[k + 1] - t[k]) / (y[k + 1] - y[k])


def _middle(t: np.ndarray, y: np.ndarray, a: int, b: int) -> float:
    zeros = _zeros(t, y, a, b)
    return 0.5 * float(zeros[0] + zeros[-1])


def _motions(criterion: Criterion, match: Comparison) -> tuple[FreeMotion, FreeMotion]:
    flight, model = (
        measure_free_motion(criterion, match.time, signals[criterion.channel], who)
        for who, signals in zip(WHO, (match.flight, match.model), strict=True)
    )
    return flight, model


def first_zero_crossing(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge P0, the time from 0.9 Ad to the first crossing of neutral."""
    flight, model = _motions(criterion, match)
    if flight.p0 is None:
        raise Invalid("the flight does not cross neutral")
    if model.p0 is None:
        return _lacking(criterion, flight.p0, "the model does not cross neutral")
    return judge_number(criterion, flight.p0, model.p0, criterion.window[0])


def time_90_to_10(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge the time from 0.9 Ad to 0.1 Ad of an overdamped control."""
    times = []
    for who, motion in zip(WHO, _motions(criterion, match), strict=True):
        ends = [motion.falls_to(level) for level in (FROM, TO)]
        if ends[0] is None or ends[1] is None:
            raise Invalid(f"{who} does not come from 0.9 to 0.1 of its first displacement")
        times.append(ends[1] - ends[0])
    return judge_number(criterion, times[0], times[1], criterion.window[0])


def period_n(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge every full cycle alone against the same cycle in flight; the n-th has n + 1 times the
    printed percentage.

    Cycles count while both their overshoots are significant in flight.
    """
    flight, model = _motions(criterion, match)
    judged = []
    for n in range(1, flight.overshoots.size // 2 + 1):
        ours, theirs = flight.period(n), model.period(n)
        if ours is None:
            continue
        if theirs is None:
            judged.append(_lacking(criterion, ours, f"P{n}: the model has no such cycle", n))
        else:
            text = f"P{n}: {ours:.3f} s in flight, {theirs:.3f} s in the model"
            remark = RowRemark("values", text, f"P{n}", {"flight": ours, "model": theirs}, "s")
            judged.append(
                judge_number(criterion, ours, theirs, criterion.window[0], (remark,), cycle=n)
            )
    return _worst(judged, "the flight has no full cycle beyond 5 % of its first displacement")


def overshoot_n(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge the size of every significant overshoot of the flight.

    The percentage is of the first overshoot where the row states so (FAA), else of each overshoot;
    ``a1`` is the first alone, ``an`` with a base of its own the second and later (CCAR-60).
    """
    flight, model = _motions(criterion, match)
    of_first = criterion.band.base == "first_overshoot"
    first = 1 if of_first or criterion.parameter == "a1" else 2
    last = 1 if criterion.parameter == "a1" else flight.overshoots.size
    judged = []
    for n in range(first, min(last, flight.overshoots.size) + 1):
        ours, theirs = flight.overshoot(n), model.overshoot(n)
        base = flight.overshoot(1) if of_first else ours
        shares = {"flight": ours / abs(flight.Ad), "model": theirs / abs(model.Ad)}
        text = f"A{n}: {shares['flight']:.3f} of Ad in flight, {shares['model']:.3f} in the model"
        remark = RowRemark("values", text, f"A{n}", shares, "1")
        judged.append(judge_number(criterion, ours, theirs, criterion.window[0], (remark,), base))
    return _worst(judged, "the flight has no such overshoot beyond 5 % of its first displacement")


def overshoot_count(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge the number of significant overshoots; the first one of the flight has to be there
    whatever the width.
    """
    flight, model = _motions(criterion, match)
    outcome = judge_number(
        criterion, float(flight.overshoots.size), float(model.overshoots.size), criterion.window[0]
    )
    if flight.overshoots.size and not model.overshoots.size:
        return replace(
            outcome,
            verdict="fail",
            remarks=(RowRemark("lacking", "the model lacks the first overshoot"),),
        )
    return outcome


def _lacking(criterion: Criterion, flight: float, text: str, cycle: int = 0) -> Judgement:
    width = float(half_width(criterion, flight, cycle)[0])
    return Judgement(
        "fail",
        width=width,
        at=criterion.window[0],
        remarks=(RowRemark("lacking", text),),
        flight=flight,
    )


def _worst(judged: list[Judgement], nothing: str) -> Judgement:
    """Return the outcome that decides: one without a number, else the largest ratio; with the
    remarks of all.
    """
    if not judged:
        raise Invalid(nothing)
    lacking = [outcome for outcome in judged if np.isnan(outcome.worst_ratio)]
    worst = lacking[0] if lacking else max(judged, key=lambda outcome: outcome.worst_ratio)
    return replace(worst, remarks=tuple(remark for outcome in judged for remark in outcome.remarks))
