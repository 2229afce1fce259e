"""Free motion of a control after its release (2.b.1-2.b.3): P0, Pn, An, number of overshoots, time of an overdamped one.

The steady (neutral) values of the two records are overlaid first, each being subtracted from its own record; then
everything is measured in fractions of the first displacement Ad.  Overshoots within 5 % of Ad are not significant.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...tolerances.bands import Invalid, Outcome, demand_finite, half_width, inside_window, scalar
from ...tolerances.criteria import Criterion
from ...tolerances.remarks import RowRemark
from ..comparison import WHO, Match

RESIDUAL = 0.05  # of Ad: the residual band; smaller overshoots are not significant
FROM, TO = 0.9, 0.1  # of Ad
LATE = 1.5  # half cycles: a crossing in the residual band that comes later belongs to a drift, not to the oscillation; ours
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
        Times at which it passes neutral: once between two excursions beyond the residual band, and after the last while it
        oscillates on. [s]
    overshoots : array (overshoot,)
        Sizes of the significant overshoots over Ad.
    """

    time: np.ndarray
    y: np.ndarray
    Ad: float
    crossings: np.ndarray
    overshoots: np.ndarray

    def falls_to(self, level: float) -> float | None:
        """Return when the displacement first comes down to a fraction of Ad; None when it does not. [s]"""
        below = self.y <= level
        if not below.any() or below[0]:
            return None
        k = int(np.argmax(below))
        return float(self.time[k - 1] + (self.y[k - 1] - level) / (self.y[k - 1] - self.y[k]) * (self.time[k] - self.time[k - 1]))

    @property
    def p0(self) -> float | None:
        """Time from 0.9 Ad to the first crossing of neutral. [s]"""
        start = self.falls_to(FROM)
        return None if start is None or not self.crossings.size else float(self.crossings[0]) - start

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
        """Return the n-th full cycle after the first crossing; None when the record does not hold it. [s]"""
        last = 2 * n
        return float(self.crossings[last] - self.crossings[last - 2]) if last < self.crossings.size else None


def free_motion(criterion: Criterion, time: np.ndarray, x: np.ndarray, who: str = "flight") -> FreeMotion:
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
        raise Invalid(f"{who}: the control is not displaced at the start of the window, or not at rest in its last {NEUTRAL:g} s")
    y = (x - neutral) / Ad
    crossings, overshoots = _excursions(t, y)
    return FreeMotion(t, y, Ad, crossings, overshoots)


def _excursions(t: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the crossings of neutral and the sizes of the overshoots.

    Between two excursions beyond the residual band noise may pass neutral several times; the crossing is in the middle.
    """
    side = np.where(y > RESIDUAL, 1, np.where(y < -RESIDUAL, -1, 0))
    outside = np.flatnonzero(side)
    turns = np.flatnonzero(np.diff(side[outside]))  # last sample of an excursion before one on the other side
    starts, stops = outside[turns], outside[turns + 1]
    crossings = [_middle(t, y, a, b) for a, b in zip(starts, stops, strict=True)]
    ends = [*outside[turns[1:]], outside[-1]] if turns.size else []
    overshoots = [float(np.abs(y[a : b + 1]).max()) for a, b in zip(stops, ends, strict=True)]
    crossings += _residual_crossings(crossings, _zeros(t, y, int(outside[-1]), t.size - 1))
    return np.array(crossings), np.array(overshoots)


def _residual_crossings(crossings: list[float], after: np.ndarray) -> list[float]:
    """Return the crossings after the last excursion that still belong to the oscillation; one that comes late is a creep to neutral."""
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


def _motions(criterion: Criterion, match: Match) -> tuple[FreeMotion, FreeMotion]:
    flight, model = (
        free_motion(criterion, match.time, signals[criterion.channel], who)
        for who, signals in zip(WHO, (match.flight, match.model), strict=True)
    )
    return flight, model


def first_zero_crossing(criterion: Criterion, match: Match) -> Outcome:
    """Judge P0, the time from 0.9 Ad to the first crossing of neutral."""
    flight, model = _motions(criterion, match)
    if flight.p0 is None:
        raise Invalid("the flight does not cross neutral")
    if model.p0 is None:
        return _lacking(criterion, flight.p0, "the model does not cross neutral")
    return scalar(criterion, flight.p0, model.p0, criterion.window[0])


def time_90_to_10(criterion: Criterion, match: Match) -> Outcome:
    """Judge the time from 0.9 Ad to 0.1 Ad of an overdamped control."""
    times = []
    for who, motion in zip(WHO, _motions(criterion, match), strict=True):
        ends = [motion.falls_to(level) for level in (FROM, TO)]
        if ends[0] is None or ends[1] is None:
            raise Invalid(f"{who} does not come from 0.9 to 0.1 of its first displacement")
        times.append(ends[1] - ends[0])
    return scalar(criterion, times[0], times[1], criterion.window[0])


def period_n(criterion: Criterion, match: Match) -> Outcome:
    """Judge every full cycle alone against the same cycle in flight; the n-th has n + 1 times the printed percentage.

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
            judged.append(scalar(criterion, ours, theirs, criterion.window[0], (remark,), cycle=n))
    return _worst(judged, "the flight has no full cycle beyond 5 % of its first displacement")


def overshoot_n(criterion: Criterion, match: Match) -> Outcome:
    """Judge the size of every significant overshoot of the flight.

    The percentage is of the first overshoot where the row states so (FAA), else of each overshoot; ``a1`` is the first
    alone, ``an`` with a base of its own the second and later (CCAR-60).
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
        judged.append(scalar(criterion, ours, theirs, criterion.window[0], (remark,), base))
    return _worst(judged, "the flight has no such overshoot beyond 5 % of its first displacement")


def overshoot_count(criterion: Criterion, match: Match) -> Outcome:
    """Judge the number of significant overshoots; the first one of the flight has to be there whatever the width."""
    flight, model = _motions(criterion, match)
    outcome = scalar(criterion, float(flight.overshoots.size), float(model.overshoots.size), criterion.window[0])
    if flight.overshoots.size and not model.overshoots.size:
        return replace(outcome, verdict="fail", remarks=(RowRemark("lacking", "the model lacks the first overshoot"),))
    return outcome


def _lacking(criterion: Criterion, flight: float, text: str, cycle: int = 0) -> Outcome:
    width = float(half_width(criterion, flight, cycle)[0])
    return Outcome("fail", width=width, at=criterion.window[0], remarks=(RowRemark("lacking", text),), flight=flight)


def _worst(judged: list[Outcome], nothing: str) -> Outcome:
    """Return the outcome that decides: one without a number, else the largest ratio; with the remarks of all."""
    if not judged:
        raise Invalid(nothing)
    lacking = [outcome for outcome in judged if np.isnan(outcome.worst_ratio)]
    worst = lacking[0] if lacking else max(judged, key=lambda outcome: outcome.worst_ratio)
    return replace(worst, remarks=tuple(remark for outcome in judged for remark in outcome.remarks))
