"""Elapsed time, distance and fuel between two events, means of segments, and turning measures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flightmech.names import lookup
from flightmech.units import FOOT, KNOT
from pom.judging.measures.control_forces import judge_dead_band
from pom.judging.signals import WHO, Comparison, crossing_time, event_time, find_event, level_at
from pom.tolerances.bands import (
    Invalid,
    Judgement,
    NotJudged,
    RowRemark,
    demand_finite,
    half_width,
    inside_window,
    judge_number,
)
from pom.tolerances.channels import channel_value_text, plain_id
from pom.tolerances.criteria import LEVELS, Criterion

SHARE = {"1.b.1": 0.8, "1.e.1": 0.8, "1.e.2": 0.8}
"""By test: the share of the run that has to be recorded.  Other tests require the whole run."""

LEAST_OF_RUN = {"h": 5000.0 * FOOT, "V_cas": 50.0 * KNOT}
"""Change of height or speed that the table requires of a segment without events. [SI]"""


@dataclass(frozen=True)
class TimedRun:
    """Start and end of a run in flight and model [s], and the remarks on it."""

    flight: tuple[float, float]
    model: tuple[float, float]
    remarks: tuple[RowRemark, ...] = ()


@dataclass(frozen=True)
class Gate:
    """End of a run: a signal passes a level in a direction; the flight passes it at a time [s]."""

    channel: str
    level: float
    direction: int
    flight: float


def judge_elapsed(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge time, distance or fuel between two events.

    The run of the model ends where its signal passes the level of the event (speed at rotation,
    height at touchdown, standstill).  Some tests require only a part of the run.  If the model has
    covered this part without reaching the end, both runs are compared up to the level that the
    model reaches.  A shorter run is invalid.
    """
    if criterion.parameter == "flare_time_tf":
        flare, touchdown = find_event(match, "flare"), find_event(match, "touchdown")
        run = TimedRun(
            flight=(flare.flight, touchdown.flight),
            model=(flare.model, touchdown.model),
            remarks=touchdown.remarks,
        )
    else:
        start = _find_start(criterion, match)
        gate = _find_gate(criterion, match, start[0])
        common = _find_common_run(match, start, gate)
        if common is None:
            return _judge_missed_gate(criterion, match, start, gate=gate)
        run = common
    flight = _amount(criterion, match, 0, ends=run.flight)
    model = _amount(criterion, match, 1, ends=run.model)
    return judge_number(criterion, flight, model, at=run.flight[1], remarks=run.remarks)


def _find_start(criterion: Criterion, match: Comparison) -> tuple[float, float]:
    """Return the start of the run in flight and model. [s]

    A segment without events starts where the model has the height or speed of the flight.
    """
    if criterion.bounds[0]:
        instant = find_event(match, criterion.bounds[0])
        return instant.flight, instant.model
    start, channel = criterion.window[0], criterion.abscissa
    if not channel or start <= match.time[1]:
        return start, start
    # height or speed of the flight at both ends of the window
    level, end = np.interp(criterion.window, match.time, match.flight[channel])
    direction = 1 if end > level else -1
    passage = crossing_time(
        match.time, match.model[channel], level=float(level), direction=direction
    )
    if passage is None:
        raise Invalid(
            f"the model does not pass {channel_value_text(channel, float(level))}, where the "
            f"segment starts"
        )
    return start, passage


def _find_gate(criterion: Criterion, match: Comparison, start: float) -> Gate:
    """Return the end of the run in flight.

    If the record stops before the event, it is the last level of the flight.
    """
    end = match.time[-1]
    if not criterion.bounds[1]:
        return _progress_gate(criterion, match)
    event = criterion.bounds[1]
    channel, direction = LEVELS[event]
    if channel not in match.flight or channel not in match.model:
        raise NotJudged(
            f"{event} is detected by {channel}, and flight and model do not both have it"
        )
    instant = event_time(match, event)
    if instant <= end + 1e-9:
        level = level_at(match, event, instant)
        time = instant
        if event == "full_stop":
            # The stated stop may be later than the passage of the speed at which the model stops.
            standstill = crossing_time(
                match.time, match.flight[channel], level, direction=direction, start=start
            )
            if standstill is not None:
                time = standstill
        return Gate(channel, level, direction=direction, flight=time)
    # The record stops before the event: the recorded share of the run must be large enough.
    required = SHARE.get(plain_id(match.case.id), 1.0)
    share = (end - start) / (instant - start)
    if share < required:
        raise Invalid(
            f"{100.0 * share:.0f} % of the run is recorded, {100.0 * required:.0f} % have to be"
        )
    last_level = float(match.flight[channel][-1])
    return Gate(channel, last_level, direction=direction, flight=float(end))


def _progress_gate(criterion: Criterion, match: Comparison) -> Gate:
    """Return the end of a segment that no event bounds: a change of height or speed."""
    channel = criterion.abscissa
    if not channel:
        raise NotJudged("the row names no event at which the run ends")
    least = LEAST_OF_RUN[channel]
    mask = inside_window(match.time, criterion.window)
    y = match.flight[channel][mask]
    demand_finite("flight", match.time[mask], y)
    covered = float(y[-1] - y[0])
    if abs(covered) < least and not match.case.shortened:
        raise Invalid(
            f"the segment covers {channel_value_text(channel, abs(covered))}; the table requires "
            f"{channel_value_text(channel, least)}: widen the window, or give the reason in "
            f"case.shortened"
        )
    direction = 1 if covered > 0.0 else -1
    return Gate(channel, float(y[-1]), direction=direction, flight=criterion.window[1])


def _find_common_run(match: Comparison, start: tuple[float, float], gate: Gate) -> TimedRun | None:
    """Return the run up to the gate, or up to the farthest level of the model.

    None if the model covers less than the required share of the run.
    """
    signal = match.model[gate.channel]
    demand_finite("the model", match.time, signal)
    passage = crossing_time(
        match.time, signal, gate.level, direction=gate.direction, start=start[1]
    )
    if passage is not None:
        text = f"to {channel_value_text(gate.channel, gate.level)}"
        return TimedRun(
            flight=(start[0], gate.flight),
            model=(start[1], passage),
            remarks=(_span_remark(gate, gate.level, text),),
        )
    # The farthest level of the model in the direction of the gate, and its time in flight.
    level = gate.direction * float(np.max(gate.direction * signal))
    flight_end = crossing_time(
        match.time, match.flight[gate.channel], level, direction=gate.direction, start=start[0]
    )
    required = SHARE.get(plain_id(match.case.id), 1.0)
    if flight_end is None or required == 1.0:
        return None
    if flight_end - start[0] < required * (gate.flight - start[0]):
        return None
    model_end = crossing_time(match.time, signal, level, direction=gate.direction, start=start[1])
    if model_end is None:
        model_end = match.time[-1]
    share = 100.0 * (flight_end - start[0]) / (gate.flight - start[0])
    text = (
        f"the model reaches {channel_value_text(gate.channel, level)}; both are compared up to "
        f"there, {share:.0f} % of the run"
    )
    return TimedRun(
        flight=(start[0], flight_end),
        model=(start[1], model_end),
        remarks=(_span_remark(gate, level, text),),
    )


def _span_remark(gate: Gate, level: float, text: str) -> RowRemark:
    unit = lookup(gate.channel).units
    return RowRemark("span", text, gate.channel, values={"level": level}, unit=unit)


def _judge_missed_gate(
    criterion: Criterion, match: Comparison, start: tuple[float, float], *, gate: Gate
) -> Judgement:
    """Judge a model that does not reach the end of the run.

    It fails if its amount already exceeds the flight by more than the tolerance.  Otherwise the
    record is too short.
    """
    flight = _amount(criterion, match, 0, ends=(start[0], gate.flight))
    so_far = _amount(criterion, match, 1, ends=(start[1], float(match.time[-1])))
    width = half_width(criterion, flight)
    text = (
        f"the model does not come to {channel_value_text(gate.channel, gate.level)} in the record"
    )
    if so_far - flight <= width[0]:
        raise Invalid(f"{text}; widen the window")
    remark = _span_remark(gate, gate.level, f"{text}; its value is what it has used so far")
    end = float(match.time[-1])
    return judge_number(criterion, flight, so_far, at=end, remarks=(remark,))


def _amount(
    criterion: Criterion, match: Comparison, run: int, *, ends: tuple[float, float]
) -> float:
    """Return time, distance or fuel of a run (0 flight, 1 model) between its ends. [SI]"""
    signals, time = (match.flight, match.model)[run], match.time
    if criterion.channel == "time":
        return ends[1] - ends[0]
    same_engines = set(match.flight.fuel_flow) == set(match.model.fuel_flow)
    if criterion.channel == "fuel_used" and not same_engines:
        raise NotJudged("flight and model do not report the fuel flow of the same engines")
    is_between = (time >= ends[0] - 1e-9) & (time <= ends[1] + 1e-9)
    demand_finite(WHO[run], time[is_between], signals[criterion.channel][is_between])
    first, last = np.interp(ends, time, signals[criterion.channel])
    # The channel `fuel` is the fuel on board, which decreases; all others increase.
    if criterion.channel == "fuel":
        return float(first - last)
    return float(last - first)


LEAST = {"1.c.1": 1000.0, "1.c.2": 1000.0, "1.c.4": 1000.0, "1.d.4": 1000.0, "1.d.5": 3000.0}
"""By test: the least change of height of a segment. [ft]"""


def segment_mean(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge the mean speed of a climb or descent, or its mean rate: height change over time.

    A rate of descent counts positive downwards, as the table prints it.
    """
    remarks = demand_height(criterion, match)
    if criterion.channel == "hdot":
        time, *heights = match.both(criterion, "h")
        sign = -1.0 if criterion.parameter == "descent_rate" else 1.0
        values = [sign * float(h[-1] - h[0]) / float(time[-1] - time[0]) for h in heights]
    else:
        # mean over time: integral over duration
        time, *speeds = match.both(criterion)
        values = [float(np.trapezoid(V, time) / (time[-1] - time[0])) for V in speeds]
    return judge_number(criterion, values[0], values[1], at=float(time[-1]), remarks=remarks)


def demand_height(criterion: Criterion, match: Comparison) -> tuple[RowRemark, ...]:
    """Return a remark on the change of height in flight.

    Raises
    ------
    Invalid
        The change is smaller than the table requires, and the case gives no reason.
    """
    required = LEAST.get(plain_id(match.case.id), 0.0)
    if "h" not in match.flight:
        return ()
    _, flight, _ = match.both(criterion, "h")
    covered = abs(float(flight[-1] - flight[0])) / FOOT
    text = f"segment of {covered:.0f} ft"
    if covered < required and not match.case.shortened:
        raise Invalid(
            f"{text}; the table requires {required:.0f} ft or more: widen the window, or "
            f"give the reason in case.shortened"
        )
    if covered < required:
        text = f"{text} of {required:.0f} ft required"
    values = {"covered": covered, "required": required}
    return (RowRemark("span", text, "h", values=values, unit="ft"),)


def certified_gradient(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge the climb gradient of the model; it fails below the certified gradient.

    The gradient is the gained height over the horizontal distance through the air, so that wind
    does not count.  The ratio of the outcome is the certified gradient over the gradient of the
    model.
    """
    certified = match.case.certified.get(criterion.parameter)
    if certified is None:
        raise NotJudged(f"give the certified {criterion.parameter} in [certified]")
    flight, model = (_climb_gradient(criterion, match, run) for run in range(2))
    verdict: str = "pass"
    remarks: tuple[RowRemark, ...] = ()
    if model < certified:
        verdict = "fail"
        text, values = "below the certified gradient", {"certified": certified}
        remarks = (RowRemark("certified", text, values=values, unit="1"),)
    # a model that does not climb has no finite ratio
    ratio = float("inf")
    if model > 0.0:
        ratio = certified / model
    return Judgement(
        verdict=verdict,
        worst=model - certified,
        worst_ratio=ratio,
        at=criterion.window[1],
        remarks=remarks,
        flight=flight,
        model=model,
        applied=f"not below {100.0 * certified:.4g} %",
    )


def _climb_gradient(criterion: Criterion, match: Comparison, run: int) -> float:
    """Return the climb gradient of a run, 0 flight, 1 model. [1]"""
    time, *heights = match.both(criterion, "h")
    _, *speeds = match.both(criterion, "V")
    h, V = heights[run], speeds[run]
    # Horizontal airspeed: sqrt(V^2 - h'^2); noise may make the difference negative.
    horizontal = np.sqrt(np.maximum(V**2 - np.gradient(h, time) ** 2, 0.0))
    return float(h[-1] - h[0]) / float(np.trapezoid(horizontal, time))


# [rad] A smaller change of heading does not determine a radius; our choice.
LEAST_TURN = np.radians(90.0)
# Shares of the travel of a trim surface between which its rate is measured.
_RATE_START, _RATE_END = 0.1, 0.9


def judge_turning_number(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge a number of a whole manoeuvre: turn radius, trim rate or steering dead band."""
    if criterion.parameter == "nosewheel_deadband":
        return judge_dead_band(criterion, match)
    flight, model = _RADIUS_OR_RATE[criterion.parameter](criterion, match)
    return judge_number(criterion, flight, model, at=criterion.window[0])


def _turn_radii(criterion: Criterion, match: Comparison) -> list[float]:
    """Return the radii of the paths of the c.g.: ground distance over change of heading. [m]"""
    _, *distances = match.both(criterion, "distance")
    _, *headings = match.both(criterion, "psi")
    radii = []
    for who, distance, psi in zip(WHO, distances, headings, strict=True):
        continuous = np.unwrap(psi)
        turn = abs(float(continuous[-1] - continuous[0]))
        if turn < LEAST_TURN:
            raise Invalid(
                f"{who} turns by {np.degrees(turn):.0f} deg; at least "
                f"{np.degrees(LEAST_TURN):.0f} deg determine a radius"
            )
        radii.append(float(distance[-1] - distance[0]) / turn)
    return radii


def _trim_rates(criterion: Criterion, match: Comparison) -> list[float]:
    """Return the mean rates of a trim surface between 10 and 90 % of its travel. [rad s-1]"""
    time, *surfaces = match.both(criterion, criterion.abscissa)
    rates = []
    for who, y in zip(WHO, surfaces, strict=True):
        first, travel = float(y[0]), float(y[-1] - y[0])
        direction = 1 if travel > 0.0 else -1
        start = crossing_time(time, y, first + _RATE_START * travel, direction=direction)
        end = crossing_time(time, y, first + _RATE_END * travel, direction=direction)
        if travel == 0.0 or start is None or end is None:
            raise Invalid(f"{who} does not move {criterion.abscissa}")
        # 0.8: share of the travel between the two levels
        rates.append(0.8 * travel / (end - start))
    return rates


_RADIUS_OR_RATE = {"turn_radius": _turn_radii, "trim_rate": _trim_rates}
