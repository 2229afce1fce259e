"""Elapsed time, distance and fuel between two events, each found the same way in both records."""

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
"""Part of the run that has to be recorded; of the others all."""

LEAST_OF_RUN = {"h": 5000.0 * FOOT, "V_cas": 50.0 * KNOT}
"""Change of height or speed that the table requires of a segment without events. [SI]"""


@dataclass(frozen=True)
class TimedRun:
    """Start and end of the run in both records, and the remark on it. [s]"""

    flight: tuple[float, float]
    model: tuple[float, float]
    remarks: tuple[RowRemark, ...] = ()


@dataclass(frozen=True)
class Gate:
    """The end of a run: the level of a signal, the direction in which it is passed, and when the
    flight does.
    """

    channel: str
    level: float
    direction: int
    flight: float


def judge_elapsed(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge time, distance or fuel between two events.

    The model's run ends where its own signal passes the level of the event (speed at rotation,
    height at touchdown, standstill).  Where a test allows a part of the run to be recorded and the
    model has not come to its end, both are compared up to the level that it has reached; less than
    the part required is invalid.
    """
    if criterion.parameter == "flare_time_tf":
        flare, touchdown = find_event(match, "flare"), find_event(match, "touchdown")
        span = TimedRun(
            (flare.flight, touchdown.flight), (flare.model, touchdown.model), touchdown.remarks
        )
    else:
        start = _start(criterion, match)
        gate = _gate(criterion, match, start[0])
        common = _span(criterion, match, start, gate)
        if common is None:
            return _never(criterion, match, start, gate)
        span = common
    amounts = [
        _amount(criterion, match, i, ends) for i, ends in enumerate((span.flight, span.model))
    ]
    return judge_number(criterion, amounts[0], amounts[1], span.flight[1], span.remarks)


def _start(criterion: Criterion, match: Comparison) -> tuple[float, float]:
    """Return when the run starts in flight and model; a segment without events where both have the
    same height or speed. [s]
    """
    if criterion.bounds[0]:
        found = find_event(match, criterion.bounds[0])
        return found.flight, found.model
    start, channel = criterion.window[0], criterion.abscissa
    if not channel or start <= match.time[1]:
        return start, start
    level, end = np.interp(criterion.window, match.time, match.flight[channel])
    reached = crossing_time(
        match.time, match.model[channel], float(level), 1 if end > level else -1
    )
    if reached is None:
        raise Invalid(
            f"the model does not pass {channel_value_text(channel, float(level))}, where the "
            f"segment starts"
        )
    return start, reached


def _gate(criterion: Criterion, match: Comparison, start: float) -> Gate:
    """Return the end of the run as the flight has it; where its record stops early, what the flight
    has come to.
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
        stood = (
            crossing_time(match.time, match.flight[channel], level, direction, start)
            if event == "full_stop"
            else None
        )
        return Gate(channel, level, direction, instant if stood is None else stood)
    required = SHARE.get(plain_id(match.case.id), 1.0)
    share = (end - start) / (instant - start)
    if share < required:
        raise Invalid(
            f"{100.0 * share:.0f} % of the run is recorded, {100.0 * required:.0f} % have to be"
        )
    return Gate(channel, float(match.flight[channel][-1]), direction, float(end))


def _progress_gate(criterion: Criterion, match: Comparison) -> Gate:
    """Return the end of a segment that no event bounds: a change of height or speed."""
    channel = criterion.abscissa
    if not channel:
        raise NotJudged("the row names no event at which the run ends")
    least = LEAST_OF_RUN[channel]
    mask = inside_window(match.time, criterion.window)
    demand_finite("flight", match.time[mask], y := match.flight[channel][mask])
    covered = float(y[-1] - y[0])
    if abs(covered) < least and not match.case.shortened:
        raise Invalid(
            f"the segment covers {channel_value_text(channel, abs(covered))}; the table requires "
            f"{channel_value_text(channel, least)}: "
            "widen the window, or give the reason in case.shortened"
        )
    return Gate(channel, float(y[-1]), 1 if covered > 0.0 else -1, criterion.window[1])


def _span(
    criterion: Criterion, match: Comparison, start: tuple[float, float], gate: Gate
) -> TimedRun | None:
    """Return the run up to the gate, or up to what the model has reached; None when it never comes
    near enough.
    """
    signal = match.model[gate.channel]
    demand_finite("the model", match.time, signal)
    reached = crossing_time(match.time, signal, gate.level, gate.direction, start[1])
    if reached is not None:
        return TimedRun(
            (start[0], gate.flight),
            (start[1], reached),
            (_span_remark(gate, gate.level, f"to {channel_value_text(gate.channel, gate.level)}"),),
        )
    level = gate.direction * float(np.max(gate.direction * signal))
    there = crossing_time(match.time, match.flight[gate.channel], level, gate.direction, start[0])
    required = SHARE.get(plain_id(match.case.id), 1.0)
    if there is None or required == 1.0 or there - start[0] < required * (gate.flight - start[0]):
        return None
    own = crossing_time(match.time, signal, level, gate.direction, start[1])
    share = 100.0 * (there - start[0]) / (gate.flight - start[0])
    text = (
        f"the model reaches {channel_value_text(gate.channel, level)}; both are compared up to "
        f"there, {share:.0f} % of the run"
    )
    return TimedRun(
        (start[0], there),
        (start[1], match.time[-1] if own is None else own),
        (_span_remark(gate, level, text),),
    )


def _span_remark(gate: Gate, level: float, text: str) -> RowRemark:
    return RowRemark("span", text, gate.channel, {"level": level}, lookup(gate.channel).units)


def _never(
    criterion: Criterion, match: Comparison, start: tuple[float, float], gate: Gate
) -> Judgement:
    """Judge a model that does not come to the end: a failure when it is late by more than the
    tolerance, else too short a record.
    """
    flight = _amount(criterion, match, 0, (start[0], gate.flight))
    so_far = _amount(criterion, match, 1, (start[1], float(match.time[-1])))
    width = half_width(criterion, flight)
    text = (
        f"the model does not come to {channel_value_text(gate.channel, gate.level)} in the record"
    )
    if so_far - flight <= width[0]:
        raise Invalid(f"{text}; widen the window")
    remark = _span_remark(gate, gate.level, f"{text}; its value is what it has used so far")
    return judge_number(criterion, flight, so_far, float(match.time[-1]), (remark,))


def _amount(
    criterion: Criterion, match: Comparison, which: int, ends: tuple[float, float]
) -> float:
    """Return what a run takes between its ends. [SI]"""
    signals, time = (match.flight, match.model)[which], match.time
    if criterion.channel == "time":
        return ends[1] - ends[0]
    if criterion.channel == "fuel_used" and set(match.flight.fuel_flow) != set(
        match.model.fuel_flow
    ):
        raise NotJudged("flight and model do not report the fuel flow of the same engines")
    part = (time >= ends[0] - 1e-9) & (time <= ends[1] + 1e-9)
    demand_finite(WHO[which], time[part], signals[criterion.channel][part])
    low, high = np.interp(ends, time, signals[criterion.channel])
    return float(low - high if criterion.channel == "fuel" else high - low)


LEAST = {"1.c.1": 1000.0, "1.c.2": 1000.0, "1.c.4": 1000.0, "1.d.4": 1000.0, "1.d.5": 3000.0}
"""Height that the segment of a test has to cover. [ft]"""


def segment_mean(criterion: Criterion, match: Comparison) -> Judgement:
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
    return judge_number(criterion, values[0], values[1], float(time[-1]), remarks)


def demand_height(criterion: Criterion, match: Comparison) -> tuple[RowRemark, ...]:
    """Return a remark on the height that the flight covers; less than the table requires is invalid
    without a reason in the case.
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
    text = text if covered >= required else f"{text} of {required:.0f} ft required"
    return (RowRemark("span", text, "h", {"covered": covered, "required": required}, "ft"),)


def certified_gradient(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge the gradient of the model's climb against the certified one, below which it fails even
    inside its band.

    Gradient is height gained over horizontal distance through the air, so that wind does not count.
    The ratio of the outcome is the certified gradient over that of the model.
    """
    certified = match.case.certified.get(criterion.parameter)
    if certified is None:
        raise NotJudged(f"give the certified {criterion.parameter} in [certified]")
    gradients = [_gradient(criterion, match, which) for which in range(2)]
    short = gradients[1] < certified
    return Judgement(
        verdict="fail" if short else "pass",
        worst=gradients[1] - certified,
        worst_ratio=certified / gradients[1] if gradients[1] > 0.0 else float("inf"),
        at=criterion.window[1],
        remarks=(
            RowRemark(
                "certified",
                "below the certified gradient",
                values={"certified": certified},
                unit="1",
            ),
        )
        if short
        else (),
        flight=gradients[0],
        model=gradients[1],
        applied=f"not below {100.0 * certified:.4g} %",
    )


def _gradient(criterion: Criterion, match: Comparison, which: int) -> float:
    time, *height = match.both(criterion, "h")
    _, *speed = match.both(criterion, "V")
    h, V = height[which], speed[which]
    along = np.sqrt(np.maximum(V**2 - np.gradient(h, time) ** 2, 0.0))
    return float(h[-1] - h[0]) / float(np.trapezoid(along, time))


LEAST_TURN = np.radians(90.0)  # ours: less does not determine a radius


def judge_turning_number(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge a number that a whole manoeuvre gives."""
    if criterion.parameter == "nosewheel_deadband":
        return judge_dead_band(criterion, match)
    values = _RADIUS_OR_RATE[criterion.parameter](criterion, match)
    return judge_number(criterion, values[0], values[1], criterion.window[0])


def _radii(criterion: Criterion, match: Comparison) -> list[float]:
    """Return the radii of the paths of the c.g.: distance over the ground per change of heading.
    [m]
    """
    _, *distances = match.both(criterion, "distance")
    _, *headings = match.both(criterion, "psi")
    radii = []
    for who, distance, psi in zip(WHO, distances, headings, strict=True):
        smooth = np.unwrap(psi)
        turned = abs(float(smooth[-1] - smooth[0]))
        if turned < LEAST_TURN:
            raise Invalid(
                f"{who} turns by {np.degrees(turned):.0f} deg; at least "
                f"{np.degrees(LEAST_TURN):.0f} deg determine a radius"
            )
        radii.append(float(distance[-1] - distance[0]) / turned)
    return radii


def _rates(criterion: Criterion, match: Comparison) -> list[float]:
    """Return the mean rates of a trim surface between 10 and 90 % of its travel. [rad s-1]"""
    time, *surfaces = match.both(criterion, criterion.abscissa)
    rates = []
    for who, y in zip(WHO, surfaces, strict=True):
        travel = float(y[-1] - y[0])
        direction = 1 if travel > 0.0 else -1
        passed = [
            crossing_time(time, y, float(y[0]) + share * travel, direction) for share in (0.1, 0.9)
        ]
        if travel == 0.0 or passed[0] is None or passed[1] is None:
            raise Invalid(f"{who} does not move {criterion.abscissa}")
        rates.append(0.8 * travel / (passed[1] - passed[0]))
    return rates


_RADIUS_OR_RATE = {"turn_radius": _radii, "trim_rate": _rates}
