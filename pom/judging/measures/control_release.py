"""Free motion of a control after its release (2.b.1-2.b.3): periods, overshoots, decay time.

The steady (neutral) value of each record is subtracted from that record. All displacements are
then fractions of the first displacement Ad. Overshoots within 5 % of Ad are not significant.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pom.judging.signals import WHO, Comparison
from pom.tolerances.bands import (
    Invalid,
    Judgement,
    RowRemark,
    demand_finite,
    half_width,
    inside_window,
    judge_number,
)
from pom.tolerances.criteria import Criterion

RESIDUAL = 0.05  # of Ad: the residual band; smaller overshoots are not significant
FROM, TO = 0.9, 0.1  # of Ad
# The next three limits are our choice, not values of a standard.
# [half cycles] A later crossing inside the residual band belongs to a drift, not to the
# oscillation.
LATE = 1.5
NEUTRAL = 0.5  # [s] End of the window; the mean over it is the neutral value.
REST_SPREAD = (
    0.02  # of Ad: largest standard deviation at the end of the window of a control at rest
)
_LEAST_DISPLACEMENT = 1e-9  # [SI] A smaller first displacement is a rounding error.


@dataclass(frozen=True)
class FreeMotion:
    """Measured motion of a control after its release.

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
        """Return the time at which y first falls to a level; None if it does not. [s]"""
        below = self.y <= level
        if not below.any() or below[0]:
            return None
        # Linear interpolation between the last sample above and the first sample below.
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
        if start is None or not self.crossings.size:
            return None
        return float(self.crossings[0]) - start

    def overshoot(self, n: int) -> float:
        """Return the size of the n-th overshoot, significant or not; zero if there is none. [SI]"""
        if n <= self.overshoots.size:
            return float(self.overshoots[n - 1]) * abs(self.Ad)
        if n > self.crossings.size:
            return 0.0
        # An insignificant overshoot: the largest displacement up to the next crossing.
        end = np.inf
        if n < self.crossings.size:
            end = self.crossings[n]
        excursion = (self.time > self.crossings[n - 1]) & (self.time < end)
        return float(np.abs(self.y[excursion]).max(initial=0.0)) * abs(self.Ad)

    def period(self, n: int) -> float | None:
        """Return the n-th full cycle after the first crossing; None if it is not complete. [s]"""
        # a full cycle has two crossings
        last = 2 * n
        if last >= self.crossings.size:
            return None
        return float(self.crossings[last] - self.crossings[last - 2])


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
    who : str
        Name of the run in errors.

    Raises
    ------
    Invalid
        Samples are missing, the control is not released, or does not come to rest.
    """
    mask = inside_window(time, criterion.window)
    t, x = time[mask] - time[mask][0], x[mask]
    demand_finite(who, time[mask], x)
    # The control is at rest there, so its mean is the neutral value.
    end = t >= t[-1] - NEUTRAL
    neutral = float(x[end].mean())
    Ad = float(x[0] - neutral)
    if abs(Ad) < _LEAST_DISPLACEMENT or np.std(x[end]) > REST_SPREAD * abs(Ad):
        raise Invalid(
            f"{who}: the control is not displaced at the start of the window, or not at rest "
            f"in its last {NEUTRAL:g} s"
        )
    y = (x - neutral) / Ad
    crossings, overshoots = _measure_excursions(t, y)
    return FreeMotion(t, y, Ad=Ad, crossings=crossings, overshoots=overshoots)


def _measure_excursions(t: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the crossings of neutral [s] and the sizes of the overshoots.

    Noise may pass neutral several times between two excursions beyond the residual band. The
    crossing is then the middle of the first and the last pass.
    """
    side = np.where(y > RESIDUAL, 1, np.where(y < -RESIDUAL, -1, 0))
    outside = np.flatnonzero(side)
    # Last sample of each excursion that is followed by one on the other side.
    turns = np.flatnonzero(np.diff(side[outside]))
    starts, stops = outside[turns], outside[turns + 1]
    crossings = []
    for start, stop in zip(starts, stops, strict=True):
        zeros = _zero_times(t, y, start, stop)
        crossings.append(0.5 * float(zeros[0] + zeros[-1]))
    # An excursion ends at the next turn, the last one at the last sample outside the band.
    ends: list[int] = []
    if turns.size:
        ends = [*outside[turns[1:]], outside[-1]]
    overshoots = []
    for stop, end in zip(stops, ends, strict=True):
        overshoots.append(float(np.abs(y[stop : end + 1]).max()))
    late_zeros = _zero_times(t, y, int(outside[-1]), t.size - 1)
    crossings += _residual_crossings(crossings, late_zeros)
    return np.array(crossings), np.array(overshoots)


def _residual_crossings(crossings: list[float], late_zeros: np.ndarray) -> list[float]:
    """Return the zeros after the last excursion that belong to the oscillation.

    A late zero belongs to a creep to neutral, not to the oscillation.
    """
    if not crossings:
        return [float(time) for time in late_zeros]
    # From the last two crossings, or twice the time from the release to the only one.
    half_cycle = 2.0 * crossings[-1]
    if len(crossings) > 1:
        half_cycle = crossings[-1] - crossings[-2]
    residual, last = [], crossings[-1]
    for time in late_zeros:
        if time - last > LATE * half_cycle:
            break
        residual.append(float(time))
        last = time
    return residual


def _zero_times(t: np.ndarray, y: np.ndarray, start: int, stop: int) -> np.ndarray:
    """Return the times at which y passes zero between two samples, linear. [s]"""
    # Index of the last sample before each change of sign.
    k = start + np.flatnonzero((y[start:stop] > 0.0) != (y[start + 1 : stop + 1] > 0.0))
    return t[k] - y[k] * (t[k + 1] - t[k]) / (y[k + 1] - y[k])


def _measure_motions(criterion: Criterion, match: Comparison) -> tuple[FreeMotion, FreeMotion]:
    """Return the free motions of flight and model."""
    channel = criterion.channel
    flight = measure_free_motion(criterion, match.time, match.flight[channel], who=WHO[0])
    model = measure_free_motion(criterion, match.time, match.model[channel], who=WHO[1])
    return flight, model


def first_zero_crossing(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge P0, the time from 0.9 Ad to the first crossing of neutral."""
    flight, model = _measure_motions(criterion, match)
    if flight.p0 is None:
        raise Invalid("the flight does not cross neutral")
    if model.p0 is None:
        return _fail_lacking(criterion, flight.p0, "the model does not cross neutral")
    return judge_number(criterion, flight.p0, model.p0, at=criterion.window[0])


def time_90_to_10(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge the time from 0.9 Ad to 0.1 Ad of an overdamped control."""
    times = []
    for who, motion in zip(WHO, _measure_motions(criterion, match), strict=True):
        start, stop = motion.falls_to(FROM), motion.falls_to(TO)
        if start is None or stop is None:
            raise Invalid(f"{who} does not come from 0.9 to 0.1 of its first displacement")
        times.append(stop - start)
    return judge_number(criterion, times[0], times[1], at=criterion.window[0])


def period_n(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge every full cycle against the same cycle in flight.

    The n-th cycle has n + 1 times the printed percentage. Cycles count while both their
    overshoots are significant in flight.
    """
    flight, model = _measure_motions(criterion, match)
    judged = []
    for n in range(1, flight.overshoots.size // 2 + 1):
        flight_period, model_period = flight.period(n), model.period(n)
        # the last overshoot may belong to a cycle that the window cuts
        if flight_period is None:
            continue
        if model_period is None:
            text = f"P{n}: the model has no such cycle"
            judged.append(_fail_lacking(criterion, flight_period, text, cycle=n))
            continue
        text = f"P{n}: {flight_period:.3f} s in flight, {model_period:.3f} s in the model"
        values = {"flight": flight_period, "model": model_period}
        remark = RowRemark("values", text, f"P{n}", values=values, unit="s")
        judged.append(
            judge_number(
                criterion,
                flight_period,
                model_period,
                at=criterion.window[0],
                remarks=(remark,),
                cycle=n,
            )
        )
    return _worst_of(judged, "the flight has no full cycle beyond 5 % of its first displacement")


def overshoot_n(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge the size of every significant overshoot of the flight.

    The percentage is of the first overshoot where the row states so (FAA), else of each overshoot;
    ``a1`` is the first alone, ``an`` with a base of its own the second and later (CCAR-60).
    """
    flight, model = _measure_motions(criterion, match)
    # FAA: all overshoots with the base of the first one. CCAR-60: `a1` and `an` are rows.
    of_first = criterion.band.base == "first_overshoot"
    first, last = 2, flight.overshoots.size
    if of_first or criterion.parameter == "a1":
        first = 1
    if criterion.parameter == "a1":
        last = 1
    judged = []
    for n in range(first, min(last, flight.overshoots.size) + 1):
        flight_size, model_size = flight.overshoot(n), model.overshoot(n)
        base = flight_size
        if of_first:
            base = flight.overshoot(1)
        shares = {"flight": flight_size / abs(flight.Ad), "model": model_size / abs(model.Ad)}
        text = f"A{n}: {shares['flight']:.3f} of Ad in flight, {shares['model']:.3f} in the model"
        remark = RowRemark("values", text, f"A{n}", values=shares, unit="1")
        judged.append(
            judge_number(
                criterion,
                flight_size,
                model_size,
                at=criterion.window[0],
                remarks=(remark,),
                base=base,
            )
        )
    return _worst_of(
        judged, "the flight has no such overshoot beyond 5 % of its first displacement"
    )


def overshoot_count(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge the number of significant overshoots.

    A model without any overshoot fails whatever the width if the flight has one.
    """
    flight, model = _measure_motions(criterion, match)
    counts = float(flight.overshoots.size), float(model.overshoots.size)
    outcome = judge_number(criterion, *counts, at=criterion.window[0])
    if flight.overshoots.size and not model.overshoots.size:
        remark = RowRemark("lacking", "the model lacks the first overshoot")
        return replace(outcome, verdict="fail", remarks=(remark,))
    return outcome


def _fail_lacking(criterion: Criterion, flight: float, text: str, cycle: int = 0) -> Judgement:
    """Return the judgement of a model without the measured feature."""
    width = float(half_width(criterion, flight, cycle)[0])
    return Judgement(
        "fail",
        width=width,
        at=criterion.window[0],
        remarks=(RowRemark("lacking", text),),
        flight=flight,
    )


def _worst_of(judged: list[Judgement], nothing: str) -> Judgement:
    """Return the deciding judgement with the remarks of all; raise `nothing` without any.

    A judgement without a number decides, else the largest ratio.
    """
    if not judged:
        raise Invalid(nothing)
    remarks: list[RowRemark] = []
    lacking = []
    for outcome in judged:
        remarks += outcome.remarks
        if np.isnan(outcome.worst_ratio):
            lacking.append(outcome)
    if lacking:
        return replace(lacking[0], remarks=tuple(remarks))
    worst = max(judged, key=lambda outcome: outcome.worst_ratio)
    return replace(worst, remarks=tuple(remarks))
