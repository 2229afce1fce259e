"""Criteria against signals: the verdict table and the bands to draw."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from flightmech.names import lookup
from pom.cases.case import PomCase, driven_quantities
from pom.judging.measures import control_forces as curves
from pom.judging.measures import control_forces as release
from pom.judging.measures import modal, segments
from pom.judging.measures import segments as runs
from pom.judging.measures import segments as turning
from pom.judging.measures import values as engine
from pom.judging.measures import values as instants
from pom.judging.measures import values as levels
from pom.judging.measures import values as trends
from pom.judging.measures.control_forces import measure_free_motion
from pom.judging.signals import Comparison, Raw, RunSignals, signals_of_run
from pom.tolerances.bands import (
    Invalid,
    Judgement,
    NotJudged,
    NoValue,
    RowRemark,
    applied_band,
    half_width,
    judge_trace,
    reason_remarks,
)
from pom.tolerances.channels import (
    OTHERS,
    SOURCES,
    channel_value_text,
    display_unit,
    limit_to_si_factor,
)
from pom.tolerances.criteria import PARTS, Band, Criterion
from pom.tolerances.rows import KINDS, required_quantities, satisfies_relation


def settle_case(case: PomCase, time: np.ndarray, flight: Raw) -> PomCase:
    """Return a case whose criteria are settled on this flight: which rows apply, on which channel,
    over which part.

    Parameters
    ----------
    case : PomCase
    time : array (time,)
        Samples of the replay. [s]
    flight : mapping of str to array (time,)
        [SI]
    """
    signals = signals_of_run(case, flight, time)
    return replace(
        case, criteria=tuple(settle_criterion(case, c, time, signals) for c in case.criteria)
    )


def settle_criterion(
    case: PomCase, criterion: Criterion, time: np.ndarray, flight: RunSignals
) -> Criterion:
    """Return one criterion settled on a flight; settling twice is settling once."""
    criterion = _on_channel(criterion, flight)
    criterion = replace(
        criterion,
        fraction=case.fraction,
        largest=case.ranges.get(criterion.channel, criterion.largest),
    )
    if not criterion.applies:
        return criterion
    for word in criterion.condition.split(";"):
        if word in PARTS:
            criterion = _part(case, criterion, word)
        elif word in KINDS:
            criterion = _of_kind(case, criterion, word, time, flight)
        elif word.startswith("distance"):
            criterion = _by_distance(case, criterion, word, time, flight)
    return criterion


def _on_channel(criterion: Criterion, flight: RunSignals) -> Criterion:
    """Return the criterion on the channel that the flight has of those that a parameter may be
    judged on.
    """
    rate = criterion.parameter == "trim_rate"
    other = next((name for name in OTHERS.get(criterion.parameter, ()) if name in flight), "")
    if not other or (criterion.abscissa if rate else criterion.channel) in flight:
        return criterion
    return replace(criterion, abscissa=other) if rate else replace(criterion, channel=other)


def _part(case: PomCase, criterion: Criterion, word: str) -> Criterion:
    start, stop = criterion.window
    missing = [event for event in PARTS[word] if event and event not in case.events]
    if missing:
        return replace(
            criterion,
            reason=f"give the event {' and '.join(missing)} in [events]: the row counts only in "
            f"{word}",
        )
    first, last = (case.events.get(event) for event in PARTS[word])
    window = (
        start if first is None else max(start, first),
        stop if last is None else min(stop, last),
    )
    if window[0] >= window[1]:
        return replace(criterion, applies=False, reason=f"no part of the window is {word}")
    return replace(criterion, window=window)


def _of_kind(
    case: PomCase, criterion: Criterion, word: str, time: np.ndarray, flight: RunSignals
) -> Criterion:
    """Settle a row of control dynamics: on the kind of the motion, and on whether it has what the
    row measures.
    """
    if criterion.channel not in flight:
        return criterion
    try:
        motion = measure_free_motion(criterion, time, flight[criterion.channel])
    except Invalid:
        return criterion  # the measure reports what is wrong with the record
    kind = KINDS[0] if motion.overshoots.size else KINDS[1]
    if kind != word and word not in case.features:
        return replace(
            criterion, applies=False, reason=f"applies only {word}; the flight is {kind}"
        )
    later_only = criterion.parameter == "an" and criterion.band.base != "first_overshoot"
    cycles = motion.overshoots.size >= 2 and motion.period(1) is not None
    lacking = {"period_n": not cycles, "overshoot_n": later_only and motion.overshoots.size < 2}
    if lacking.get(criterion.measure):
        seen = (
            f"{motion.overshoots.size} overshoot{'s' if motion.overshoots.size != 1 else ''} "
            f"beyond 5 % of the first displacement"
        )
        return replace(
            criterion, applies=False, reason=f"the flight has {seen} and not what the row measures"
        )
    return criterion


def _by_distance(
    case: PomCase, criterion: Criterion, word: str, time: np.ndarray, flight: RunSignals
) -> Criterion:
    """Settle a row that counts for short or for long runs."""
    if "distance" not in flight:
        return criterion
    ends = [
        case.events.get(event, default)
        for event, default in zip(criterion.bounds, criterion.window, strict=True)
    ]
    run = float(np.diff(np.interp(ends, time, flight["distance"]))[0])
    if satisfies_relation(word, run):
        return criterion
    return replace(
        criterion,
        applies=False,
        reason=f"applies only with {word}; the flight has {channel_value_text('distance', run)}",
    )


FOOTPRINT = "a footprint: a recording without a reference has no band and no verdict"
TRIMMED = ("delta_e", "delta_a", "delta_r", "thrust", "throttle")
"""What a trim at the start finds; a snapshot judges it although the record drives it from there on."""

_STICK = ("F_column", "F_wheel", "F_rim", "F_pedal")  # forces on the controls that move surfaces

MEASURES: dict[str, Callable[[Criterion, Comparison], Judgement]] = {
    "trace": lambda criterion, match: _traced(criterion, match),
    "steady": levels.judge_steady_state,
    "change": levels.judge_change,
    "end_value": levels.end_value,
    "low_speed_end": levels.low_speed_end,
    "segment_mean": segments.segment_mean,
    "floor": segments.certified_gradient,
    "elapsed": runs.judge_elapsed,
    "event_value": instants.event_value,
    "setup": instants.check_setup,
    "response_initial": engine.judge_engine_response,
    "response_total": engine.judge_engine_response,
    "curve": curves.judge_curve,
    "force_increment": curves.force_increment,
    "breakout": curves.judge_breakout,
    "scalar": turning.judge_turning_number,
    "first_zero_crossing": release.first_zero_crossing,
    "time_90_to_10": release.time_90_to_10,
    "period_n": release.period_n,
    "overshoot_n": release.overshoot_n,
    "overshoot_count": release.overshoot_count,
    "period": modal.judge_mode,
    "t_half": modal.judge_mode,
    "damping_ratio": modal.judge_mode,
    "peak_lag": modal.peak_lag,
    "trend": trends.judge_trend,
}


def judge_criterion(
    case: PomCase, criterion: Criterion, time: np.ndarray, flight: Raw, model: Raw
) -> Judgement:
    """Judge one criterion on one model.

    Parameters
    ----------
    case : PomCase
    criterion : Criterion
        One of the case; it is settled on the flight first (`applicability.settle`).
    time : array (time,)
        Samples of the replay on the clock of the record. [s]
    flight, model : mapping of str to array (time,)
        Signals by SI name. [SI]

    Returns
    -------
    Outcome
        ``not_tested`` or ``invalid`` with the reason as a remark when it cannot be judged; never an
        exception for data.
    """
    return _judged(criterion, Comparison.of(case, time, flight, model))


def _judged(criterion: Criterion, match: Comparison) -> Judgement:
    try:
        settled, needed, reason = match.once(
            ("settled", criterion.name), lambda: _settled(criterion, match)
        )
        if not reason:
            reason = _lacking("model", needed, match.model)
        return (
            Judgement("not_tested", remarks=reason_remarks(reason))
            if reason
            else _measured(settled, match)
        )
    except NotJudged as error:
        return Judgement("not_tested", remarks=reason_remarks(str(error)))
    except NoValue as error:
        return Judgement("invalid", remarks=(RowRemark("no_value", str(error)),))
    except Invalid as error:
        return Judgement("invalid", remarks=reason_remarks(str(error)))


def _settled(criterion: Criterion, match: Comparison) -> tuple[Criterion, tuple[str, ...], str]:
    """Return a criterion settled on the flight, what it is computed from, and why it is not judged
    on any model; empty when it is.
    """
    case, flight = match.case, match.flight
    criterion = settle_criterion(case, criterion, match.time, flight)
    needed = required_quantities(criterion)
    reason = (
        criterion.reason
        or reason_not_judged(case, criterion)
        or _steered_by_record(case, criterion, flight)
    )
    return criterion, needed, reason or _lacking("flight record", needed, flight)


def _lacking(who: str, needed: tuple[str, ...], signals: RunSignals) -> str:
    """Return that signals are missing, in words; empty when none is."""
    missing = [name for name in needed if name not in signals]
    return f"the {who} has no {', '.join(missing)}" if missing else ""


def judge_all(case: PomCase, time: np.ndarray, flight: Raw, model: Raw) -> dict[str, Judgement]:
    """Judge every criterion of a case on one model; parameters as `judge_criterion`, result as of
    `judge_match`.
    """
    return judge_match(Comparison.of(case, time, flight, model))


def judge_match(match: Comparison) -> dict[str, Judgement]:
    """Judge every criterion of the case of a match.

    Returns
    -------
    dict of str to Outcome
        By criterion.  A group with a sample that is no number is ``invalid`` as a whole: what was
        not computed may be the very alternative that fails, and a model that gives no number proves
        nothing.
    """
    case = match.case
    found = {criterion.name: _judged(criterion, match) for criterion in case.criteria}
    broken: dict[str, tuple[str, str]] = {}
    for criterion in case.criteria:
        for remark in found[criterion.name].remarks:
            if remark.kind == "no_value" and criterion.applies:
                broken.setdefault(criterion.group, (criterion.name, remark.text))
    for criterion in case.criteria:
        name, text = broken.get(criterion.group, ("", ""))
        if (
            name
            and criterion.applies
            and found[criterion.name].verdict in ("pass", "fail", "advisory")
        ):
            found[criterion.name] = Judgement(
                "invalid", remarks=(RowRemark("no_value", f"its alternative {name}: {text}", name),)
            )
    return found


def _traced(criterion: Criterion, match: Comparison) -> Judgement:
    time, flight, model = match.both(criterion)
    key = ("band", criterion.name, criterion.band.base)  # `_measured` exchanges the base
    return judge_trace(
        criterion,
        time,
        flight,
        model,
        match.once(key, lambda: applied_band(criterion, time, flight)),
    )


def _measured(criterion: Criterion, match: Comparison) -> Judgement:
    measure = MEASURES[criterion.measure]
    if criterion.band.base != "range_max" or criterion.largest is not None:
        return measure(criterion, match)
    # the flight value is never above the largest in service: what passes on that base passes on any
    strict = replace(criterion, band=Band(criterion.band.limits, criterion.band.rule, "ref_scalar"))
    with suppress(
        Invalid
    ):  # not steady within a third of the narrower band; what else is wrong is found again
        outcome = measure(strict, match)
        if outcome.verdict == "pass":
            remark = RowRemark("method", "passes on the flight value, so on the largest in service")
            return replace(outcome, remarks=(*outcome.remarks, remark))
    return measure(criterion, match)


def reason_not_judged(case: PomCase, criterion: Criterion) -> str:
    """Return why a criterion is not judged in this case; empty when it is."""
    if case.reference == "footprint":
        return FOOTPRINT
    if criterion.reason:
        return criterion.reason
    judged = criterion.abscissa if criterion.parameter == "trim_rate" else criterion.channel
    if any(loop.channel == judged for loop in case.drive.pilot):
        return f"{judged} is held by the math pilot; what a controller holds cannot be judged"
    calibration = (
        criterion.abscissa == "trim_indicator"
    )  # what is judged there is the indicator that a model computes
    if (
        judged in driven_quantities(case)
        and not calibration
        and not _found_by_trim(case, criterion)
    ):
        return f"{judged} is driven by the record; what drives a model cannot be judged"
    if judged in _STICK and case.drive.level == "recorded":
        return "the surfaces are driven, so pilot forces have no meaning"
    if judged == "F_rim" and case.drive.level == "force":
        return "F_rim is driven by the record; what drives a model cannot be judged"
    return ""


def _steered_by_record(case: PomCase, criterion: Criterion, flight: RunSignals) -> str:
    """Return why a nose-wheel angle is not judged: the record gives the command of the steering
    itself.
    """
    if (
        criterion.channel != "gear.steering"
        or "delta_nw" not in flight
        or "delta_nw" in case.conditions
    ):
        return ""
    return (
        "gear.steering follows delta_nw, which the record drives; hold it by [conditions] "
        "delta_nw = 0, so that pedals or tiller steer"
    )


def _found_by_trim(case: PomCase, criterion: Criterion) -> bool:
    """Whether the trim at the start finds what a snapshot judges: recorded value plus bias is the
    model's own answer.
    """
    found = (*TRIMMED, *case.drive.trim_surfaces)
    return (
        criterion.measure in ("steady", "change")
        and case.drive.trim is True
        and criterion.channel.rpartition(".")[2] in found
    )


def formed_channels(case: PomCase, flight: RunSignals) -> list[str]:
    """Return the judged channels that are formed of signals, so that they can be shown."""
    formed = SOURCES.keys() - {"time"}
    return [
        c.channel
        for c in case.criteria
        if c.applies and c.channel in formed and c.channel in flight
    ]


def verdict_row(run: str, criterion: Criterion, outcome: Judgement) -> dict[str, Any]:
    """Return one row of the verdict table, in the unit of the table."""
    unit = display_unit(criterion)
    scale = (
        limit_to_si_factor(criterion.measure, criterion.channel, unit) if criterion.channel else 1.0
    )
    return {
        "run": run,
        "criterion": criterion.name,
        "channel": criterion.channel,
        "measure": criterion.measure,
        "group": criterion.group,
        "window_start": criterion.window[0],
        "window_stop": criterion.window[1],
        "tolerance_text": criterion.band.text,
        "applied_text": outcome.applied,
        "fraction": criterion.fraction,
        "width": outcome.width / scale,
        "unit": unit,
        "flight_value": outcome.flight / scale,
        "model_value": outcome.model / scale,
        "worst": outcome.worst / scale,
        "worst_ratio": outcome.worst_ratio,
        "at": outcome.at,
        "first_exit": outcome.first_exit,
        "inside": outcome.inside,
        "verdict": outcome.verdict,
        "remarks": (
            *outcome.remarks,
            *([RowRemark("row", criterion.note)] if criterion.note else []),
        ),
        "provenance": criterion.provenance,
    }


def band_widths(case: PomCase, time: np.ndarray, flight: Raw) -> xr.Dataset:
    """Return the half width over time of every judged time history, NaN where it does not count.
    [SI]
    """
    found: dict[str, np.ndarray] = {}
    signals = signals_of_run(case, flight, time)
    for criterion in case.criteria:
        criterion = settle_criterion(case, criterion, time, signals)
        if (
            criterion.measure != "trace"
            or not criterion.applies
            or reason_not_judged(case, criterion)
            or criterion.channel not in signals
        ):
            continue
        width = np.full(time.size, np.nan)
        try:
            mask = Comparison(case, time, signals, signals).counted(criterion)
            mask &= (time >= criterion.window[0] - 1e-9) & (time <= criterion.window[1] + 1e-9)
            width[mask] = half_width(criterion, signals[criterion.channel][mask])
        except (NotJudged, Invalid, ValueError):
            continue
        found[criterion.channel] = np.fmin(
            width, found.get(criterion.channel, np.full(time.size, np.nan))
        )
    attrs = {name: {"units": lookup(name).units} for name in found}
    return xr.Dataset(
        {name: ("time", width, attrs[name]) for name, width in found.items()}, coords={"time": time}
    )
