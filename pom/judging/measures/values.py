"""Values at instants: engine response, events, steady states, ends of records, and trends.

A trend passes only by the tick of an engineer (rule R16).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from flightmech.names import lookup
from flightmech.units import DEGREE, from_si
from pom.cases.case import PomCase
from pom.judging.signals import WHO, Comparison, Instant, crossing_time, event_time, find_event
from pom.tolerances.bands import (
    Invalid,
    Judgement,
    NotJudged,
    RowRemark,
    applied_tolerance,
    demand_finite,
    half_width,
    inside_window,
    judge_number,
    judge_trace,
    reason_remarks,
    unwrapped_difference,
)
from pom.tolerances.criteria import OF_PARAMETER, Criterion
from pom.tolerances.rows import DEMONSTRATION

LEVEL = 1.0  # [s] End of the window over which the end level is averaged; our choice.
# Of the whole change: with more in the last `LEVEL` seconds there is no end level; our choice.
SETTLED = 0.05


def judge_engine_response(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge Ti or Tt, counted from the first movement of the lever.

    Ti is the time to 10 % of the change, each record between its own levels.  Tt is the time to 90
    % of the go-around power of the *flight*, or, when power falls, to a 90 % decay of its starting
    power.  Levels: the value at the lever movement, and the mean of the last second of the window.
    """
    time, flight, model = match.both(criterion)
    movement = max(match.case.events.get("throttle_movement", float(time[0])), float(time[0]))
    after = time >= movement - 1e-9
    time, flight, model = time[after], flight[after], model[after]
    flight_end = _end_level(time, flight)
    if criterion.measure == "response_initial":
        # Ti: 10 % of the change of each record.
        flight_level = flight[0] + 0.1 * (flight_end - flight[0])
        model_level = model[0] + 0.1 * (_end_level(time, model) - model[0])
        text = "10 % of each record's own change"
    elif flight_end > flight[0]:
        flight_level = model_level = 0.9 * flight_end
        text = "90 % of the end level of the flight"
    else:
        flight_level = model_level = 0.1 * flight[0]
        text = "90 % decay of the start level of the flight"
    flight_time = _time_to_level(time, flight, level=float(flight_level))
    if flight_time is None:
        raise Invalid(f"{WHO[0]} does not reach the level in the window")
    model_time = _time_to_level(time, model, level=float(model_level))
    turns_back = (_end_level(time, model) - model[0]) * (flight_end - flight[0]) <= 0.0
    if model_time is None or turns_back:
        return _miss_level(criterion, time, flight_time, moves=not turns_back)
    values = RowRemark(
        "values",
        f"flight {flight_time:.2f} s, model {model_time:.2f} s",
        values={"flight": flight_time, "model": model_time},
        unit="s",
    )
    return judge_number(
        criterion,
        flight_time,
        model_time,
        at=float(time[0]),
        remarks=(values, RowRemark("method", text), *_end_departure(criterion, time, flight)),
    )


def _end_departure(
    criterion: Criterion, time: np.ndarray, flight: np.ndarray
) -> tuple[RowRemark, ...]:
    """Return the departure of a window that ends before the engine of the flight has settled."""
    end = _end_level(time, flight)
    earlier = time < time[-1] - LEVEL
    whole = abs(end - float(flight[0]))
    if not earlier.any() or not whole > 0.0:
        return ()
    moved = abs(end - _end_level(time[earlier], flight[earlier])) / whole
    if moved <= SETTLED:
        return ()
    text = (
        f"departure: the engine of the flight has not settled, in the last {LEVEL:g} s of the "
        f"window it changes by {100.0 * moved:.0f} % of the whole change; its end level is not "
        f"that of the power"
    )
    return (RowRemark("departure", text, criterion.measure),)


def _end_level(time: np.ndarray, y: np.ndarray) -> float:
    """Return the mean over the last second of the window. [SI]"""
    return float(y[time >= time[-1] - LEVEL].mean())


def _time_to_level(time: np.ndarray, y: np.ndarray, *, level: float) -> float | None:
    """Return the time from the first sample to the first passage of a level; None if none. [s]"""
    reached = crossing_time(time, y, level, direction=1 if y[0] < level else -1)
    return None if reached is None else reached - float(time[0])


def _miss_level(
    criterion: Criterion, time: np.ndarray, flight_time: float, *, moves: bool
) -> Judgement:
    """Return the failure of a model that misses the level; Invalid if it may still reach it."""
    width = float(half_width(criterion, flight_time)[0])
    lasts = float(time[-1] - time[0])
    text = f"{WHO[1]} does not follow the engine of the flight: it does not move its way"
    if moves:
        text = f"{WHO[1]} does not reach the level in {lasts:.2f} s"
        if lasts < flight_time + width:
            raise Invalid(
                f"{text}, and the tolerance ends at {flight_time + width:.2f} s; extend the window"
            )
    return Judgement(
        "fail",
        width=width,
        at=float(time[0]),
        remarks=(RowRemark("no_level", text, criterion.measure),),
        flight=flight_time,
        applied=applied_tolerance(criterion, np.array([width]), flight_time),
    )


def event_value(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge the value at an event: stall, buffet, touchdown, flare, minimum control speed ..."""
    instant = find_event(match, OF_PARAMETER[criterion.parameter], criterion.channel)
    flight, model = _values_at(criterion, match, instant)
    # The times are stated only where the event was detected.
    remarks = instant.remarks
    if remarks:
        remarks = (*remarks, _times_remark(instant))
    return judge_number(criterion, flight, model, at=instant.flight, remarks=remarks)


def check_setup(criterion: Criterion, match: Comparison) -> Judgement:
    """Check a precondition, for example the engine failure speed.

    A test outside its precondition is not valid. This is not a failure of the model.
    """
    instant = find_event(match, OF_PARAMETER[criterion.parameter], criterion.channel)
    flight, model = _values_at(criterion, match, instant)
    remark = RowRemark("precondition", "a precondition of the test")
    outcome = judge_number(criterion, flight, model, at=instant.flight, remarks=(remark,))
    if outcome.verdict == "pass":
        return outcome
    remark = RowRemark(
        "precondition", "a precondition of the test does not hold: the test is not valid"
    )
    return replace(outcome, verdict="invalid", remarks=(remark,))


def _values_at(criterion: Criterion, match: Comparison, instant: Instant) -> tuple[float, float]:
    """Return the values of flight and model, each at its own instant. [SI]"""
    values = []
    runs = zip(WHO, (match.flight, match.model), (instant.flight, instant.model), strict=True)
    for who, signals, time in runs:
        value = np.interp([time], match.time, signals[criterion.channel])
        demand_finite(who, np.array([time]), value)
        # A rate of descent counts positive downwards.
        if criterion.parameter.startswith("descent_rate"):
            value = -value
        values.append(value)
    error = float(unwrapped_difference(criterion.channel, *values)[0])
    return float(values[0][0]), float(values[0][0]) + error


def _times_remark(instant: Instant) -> RowRemark:
    text = f"flight at {instant.flight:.2f} s, model at {instant.model:.2f} s"
    values = {"flight": instant.flight, "model": instant.model}
    return RowRemark("event", text, values=values, unit="s")


BEFORE, AFTER = 4.0, 1.0  # [s] Steady state about the captured instant (rule R5).
STEADY = 1.0 / 3.0  # of the tolerance; our choice, the rule has no number for "steady"
SLOW_PART = 0.1  # of the speed range: the low-speed end of a record; our choice


def judge_steady_state(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge a snapshot: the means over the capture window of two steady records.

    A record is steady if over the 5 s the drift of a fitted line, and the standard deviation about
    the line, are at most one third of the tolerance.
    """
    capture = event_time(match, "capture")
    levels = _levels(match, criterion.channel, capture)
    flight, model = (level[0] for level in levels)
    remark = _demand_steady(float(half_width(criterion, flight)[0]), *levels)
    # The mean of an angle may differ by full turns.
    error = unwrapped_difference(criterion.channel, np.array([flight]), np.array([model]))
    model = flight + float(error[0])
    return judge_number(criterion, flight, model, at=capture, remarks=(remark,))


def judge_change(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge the change of a level between the events ``trim`` and ``capture``.

    An example is the elevator per load factor or speed.
    """
    start, capture = event_time(match, "trim"), event_time(match, "capture")
    trim_levels = _levels(match, criterion.channel, start)
    final_levels = _levels(match, criterion.channel, capture)
    # means of flight and model, each less its own mean at the trim
    pairs = zip(trim_levels, final_levels, strict=True)
    flight, model = (final[0] - initial[0] for initial, final in pairs)
    width = float(half_width(criterion, flight)[0])
    # both levels have to be steady; the remark states the second one
    _demand_steady(width, *trim_levels)
    remark = _demand_steady(width, *final_levels)
    return judge_number(criterion, flight, model, at=capture, remarks=(remark,))


def _levels(
    match: Comparison, channel: str, capture: float
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Return (mean, drift, spread) of flight and model around an instant. [SI]"""
    mask = inside_window(match.time, (capture - BEFORE, capture + AFTER))
    time, *runs = match.over(mask, channel)
    levels = []
    for y in runs:
        # The difference from zero unwraps an angle.
        smooth = unwrapped_difference(channel, np.zeros_like(y), y)
        line = np.polynomial.Polynomial.fit(time, smooth, 1)
        drift = abs(float(line(time[-1]) - line(time[0])))
        spread = float(np.std(smooth - line(time)))
        levels.append((float(smooth.mean()), drift, spread))
    return levels[0], levels[1]


def _demand_steady(width: float, *levels: tuple[float, float, float]) -> RowRemark:
    """Return the remark on steady records; raise if drift or spread is too large."""
    if width <= 0.0:
        raise Invalid("the tolerance is zero wide")
    shares: dict[str, float] = {}
    parts = []
    for who, (_, drift, spread) in zip(WHO, levels, strict=True):
        text = f"drift {drift / width:.2f}, spread {spread / width:.2f}"
        if max(drift, spread) > STEADY * width:
            raise Invalid(f"{who} is not steady: {text} of the tolerance (1/3 allowed)")
        shares |= {f"{who} drift": drift / width, f"{who} spread": spread / width}
        parts.append(f"{who} {text}")
    return RowRemark(
        "steady", f"steady: {'; '.join(parts)} of the tolerance", values=shares, unit="1"
    )


def end_value(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge the value at the end of the window, e.g. the bank angle 20 s after release."""
    time, flight, model = match.both(criterion)
    error = unwrapped_difference(criterion.channel, flight, model)
    return judge_number(
        criterion,
        float(flight[-1]),
        float(flight[-1] + error[-1]),
        at=float(time[-1]),
        remarks=(RowRemark("method", "judged at the end of the window"),),
    )


def low_speed_end(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge the last part of a deceleration, in the lowest tenth of the speed range."""
    speed = next((name for name in ("V_ground", "V_cas") if name in match.flight), None)
    if speed is None:
        raise NotJudged("the flight record has no speed")
    mask = inside_window(match.time, criterion.window)
    v = match.flight[speed]
    # The part starts after the last sample above the lowest tenth.
    fast = mask & (v > v[mask].min() + SLOW_PART * np.ptp(v[mask]))
    if fast.any():
        mask &= match.time > match.time[fast][-1]
    if mask.sum() < 2:
        raise Invalid("the record does not end at its lowest speed")
    outcome = judge_trace(criterion, *match.over(mask, criterion.channel))
    start = float(match.time[mask][0])
    remark = RowRemark(
        "method", f"low-speed end, from {start:.1f} s on", values={"start": start}, unit="s"
    )
    return replace(outcome, remarks=(remark, *outcome.remarks))


def show_demonstration(criterion: Criterion, match: Comparison) -> Judgement:
    """Return the verdict of a row without a tolerance: its curves are shown and not judged."""
    return Judgement("demonstration", remarks=reason_remarks(DEMONSTRATION))


# The rule has no numbers for a trend. The following ones are our choice.
CORRELATION = 0.8  # least
RATIO = (0.5, 2.0)  # amplitude of the model over that of the flight
CLEAR = 0.2  # of the range: smaller peaks do not count for the order
SCATTER = 3.0  # standard deviations of the scatter of the flight: smaller changes are not a trend
SPAN = 1.0  # [s] over which scatter is separated from motion
# Least dead band by unit: resolution of a recorded attitude or rate.
RESOLVED = {"rad": 0.1 * DEGREE, "rad s-1": 0.1 * DEGREE}


def judge_trend(criterion: Criterion, match: Comparison) -> Judgement:
    """Compare direction, order of events, shape and size of a change.

    There are four criteria.  The largest departure from the start has the same sign.  Highest and
    lowest value come in the same order.  The correlation is at least 0.8.  The amplitude ratio lies
    between 0.5 and 2.  The row fails if one of them is not met.  If all are met, the verdict is
    ``advisory``.  A tick of an engineer (``[ticks]`` of the case) makes it a pass with the name of
    the engineer.  The tick may overrule shape and size, but not the sign.

    A flight that changes by less than the dead band (`trend_dead_band`) has no trend, and any
    direction of the model is right.  The departure of the model must then be within the tolerance
    of other rows on the channel, or within twice the dead band if there is none.
    """
    time, flight, model = match.both(criterion)
    model = flight + unwrapped_difference(criterion.channel, flight, model)
    # extreme: the departure from the start with the largest magnitude, with its sign
    departures = [y - y[0] for y in (flight, model)]
    extremes = [float(d[np.argmax(np.abs(d))]) for d in departures]
    dead = match.once(
        ("dead band", criterion.name), lambda: trend_dead_band(criterion.channel, time, flight)
    )
    if abs(extremes[0]) <= dead:
        allowed = _allowed_departure(match.case, criterion.channel, flight) or RATIO[1] * dead
        met, measured, text = _check_without_trend(
            criterion.channel, extremes, dead=dead, allowed=allowed
        )
    else:
        ratio, correlation = abs(extremes[1] / extremes[0]), _correlation(flight, model)
        met = {
            "sign": extremes[0] * extremes[1] > 0.0,
            "order of peaks": _order(departures[0]) in ("", _order(departures[1])),
            "correlation": correlation >= CORRELATION,
            "amplitude": RATIO[0] <= ratio <= RATIO[1],
        }
        measured = {"amplitude_ratio": ratio, "correlation": correlation}
        text = (
            f"largest change of flight {_value_text(criterion.channel, extremes[0])}, of model "
            f"{_value_text(criterion.channel, extremes[1])}, amplitude ratio "
            f"{ratio:.2f}, correlation {correlation:.2f}"
        )
    failed = [name for name, is_met in met.items() if not is_met]
    if failed:
        text += f"; not met: {', '.join(failed)}"
    else:
        text += "; all criteria of trend are met"
    verdict, tick_text = apply_tick(match.case.ticks.get(criterion.name, ""), failed)
    return Judgement(
        verdict,
        at=float(time[0]),
        remarks=(
            RowRemark("trend", text, criterion.channel, values=measured, unit="1"),
            RowRemark("tick", tick_text),
        ),
        flight=extremes[0],
        model=extremes[1],
        applied="correct trend, no number",
    )


def _check_without_trend(
    channel: str, extremes: list[float], *, dead: float, allowed: float
) -> tuple[dict[str, bool], dict[str, float], str]:
    """Return criterion, measured share and text for a flight inside its dead band."""
    departure = abs(extremes[1])
    share = departure / allowed if allowed else 0.0
    text = (
        f"largest change of flight {_value_text(channel, extremes[0])}, within the dead band of "
        f"{_value_text(channel, dead)}: no trend; of model {_value_text(channel, extremes[1])}, "
        f"allowed {_value_text(channel, allowed)}"
    )
    return {"no trend": departure <= allowed}, {"departure": share}, text


def apply_tick(tick: str, failed: list[str]) -> tuple[str, str]:
    """Return the verdict, and a text on the effect of the tick."""
    if not tick and failed:
        return "fail", "an engineer may tick it with his reason"
    if not tick:
        return "advisory", "to be ticked by an engineer"
    # A tick overrules shape and size, but not the sign.
    if "sign" in failed:
        return "fail", f"the tick ({tick}) does not hold: the model moves the other way"
    if "no trend" in failed:
        return "fail", f"the tick ({tick}) does not hold: the flight has no trend"
    return "pass", f"ticked by {tick}"


def _allowed_departure(case: PomCase, channel: str, flight: np.ndarray) -> float:
    """Return the narrowest half width of other rows on a channel; 0 without any. [SI]"""
    widths = []
    for criterion in case.criteria:
        if criterion.channel != channel or not criterion.applies:
            continue
        if criterion.measure in ("trace", "end_value"):
            with suppress(NotJudged):
                widths.append(float(half_width(criterion, flight).min()))
    return min(widths, default=0.0)


def trend_dead_band(channel: str, time: np.ndarray, flight: np.ndarray) -> float:
    """Return the change of a flight trace below which it shows no trend. [SI]

    It is three standard deviations of the scatter about straight lines over one second, the median
    of all such stretches.  For attitudes and rates it is at least 0.1 deg or 0.1 deg/s.  The rule
    has no number; the values are our choice.
    """
    step = max(round(SPAN / float(np.median(np.diff(time)))), 3)
    scatters = []
    for start in range(0, max(time.size - step, 1), step):
        t, y = time[start : start + step + 1], flight[start : start + step + 1]
        if t.size > 2:
            scatters.append(np.std(y - np.polynomial.Polynomial.fit(t, y, 1)(t)))
    scatter = 0.0
    if scatters:
        scatter = float(np.median(scatters))
    return max(SCATTER * scatter, RESOLVED.get(lookup(channel).units, 0.0))


def _order(departure: np.ndarray) -> str:
    """Return which extreme comes first; empty if only one extreme is clear."""
    high, low = float(departure.max()), float(departure.min())
    # one extreme is the start itself, or within its noise
    if min(high, -low) < CLEAR * (high - low):
        return ""
    if int(np.argmax(departure)) < int(np.argmin(departure)):
        return "high first"
    return "low first"


def _correlation(flight: np.ndarray, model: np.ndarray) -> float:
    """Return the correlation of two traces; zero if one is constant."""
    if not (np.ptp(flight) > 0.0 and np.ptp(model) > 0.0):
        return 0.0
    return float(np.corrcoef(flight, model)[0, 1])


def _value_text(channel: str, value: float) -> str:
    """Return a value with its sign, in the display unit of its channel."""
    unit = lookup(channel).display_units
    return f"{from_si(value, unit):+.3g} {unit}"
