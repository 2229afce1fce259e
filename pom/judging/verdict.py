"""Criteria of a case judged on a model: the verdict table and the bands to draw."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from flightmech.names import lookup
from pom.cases.case import PomCase
from pom.judging.applicability import reason_not_judged, reason_not_steered, settle_criterion
from pom.judging.measures import (
    control_forces,
    control_release,
    modal,
    segments,
    values,
    vibration,
)
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
from pom.tolerances.channels import SOURCES, display_unit, limit_to_si_factor
from pom.tolerances.criteria import Band, Criterion
from pom.tolerances.rows import required_quantities

MEASURES: dict[str, Callable[[Criterion, Comparison], Judgement]] = {
    "trace": lambda criterion, match: _judge_time_history(criterion, match),
    "steady": values.judge_steady_state,
    "change": values.judge_change,
    "end_value": values.end_value,
    "low_speed_end": values.low_speed_end,
    "segment_mean": segments.segment_mean,
    "floor": segments.certified_gradient,
    "elapsed": segments.judge_elapsed,
    "event_value": values.event_value,
    "setup": values.check_setup,
    "response_initial": values.judge_engine_response,
    "response_total": values.judge_engine_response,
    "curve": control_forces.judge_curve,
    "force_increment": control_forces.force_increment,
    "breakout": control_forces.judge_breakout,
    "scalar": segments.judge_turning_number,
    "first_zero_crossing": control_release.first_zero_crossing,
    "time_90_to_10": control_release.time_90_to_10,
    "period_n": control_release.period_n,
    "overshoot_n": control_release.overshoot_n,
    "overshoot_count": control_release.overshoot_count,
    "period": modal.judge_mode,
    "t_half": modal.judge_mode,
    "damping_ratio": modal.judge_mode,
    "peak_lag": modal.peak_lag,
    "trend": values.judge_trend,
    "demonstration": values.show_demonstration,
    "vibration": vibration.judge_vibration,
}


def judge_criterion(
    case: PomCase, criterion: Criterion, time: np.ndarray, flight: Raw, model: Raw
) -> Judgement:
    """Judge one criterion on one model.

    Parameters
    ----------
    case : PomCase
    criterion : Criterion
        Criterion of the case; it is fitted to the flight first (`applicability.settle_criterion`).
    time : array (time,)
        Samples of the replay on the clock of the record. [s]
    flight, model : mapping of str to array (time,)
        Signals by SI name. [SI]

    Returns
    -------
    Judgement
        ``not_tested`` or ``invalid`` with the reason as a remark if the criterion cannot be
        judged.  Faulty data do not raise.
    """
    return _judge_or_explain(criterion, Comparison.of(case, time, flight, model))


def _judge_or_explain(criterion: Criterion, match: Comparison) -> Judgement:
    """Return the judgement of a criterion, or one that states why it is not judged."""
    key = ("prepared", criterion.name)
    try:
        # All models of a case share the part that depends on the flight alone.
        prepared, needed, reason = match.once(key, lambda: _prepare_criterion(criterion, match))
        if not reason:
            reason = _missing_text("model", needed, match.model)
        if reason:
            return Judgement("not_tested", remarks=reason_remarks(reason))
        return _apply_measure(prepared, match)
    except NotJudged as error:
        return Judgement("not_tested", remarks=reason_remarks(str(error)))
    except NoValue as error:
        # `judge_match` makes the other alternatives of the group invalid as well.
        return Judgement("invalid", remarks=(RowRemark("no_value", str(error)),))
    except Invalid as error:
        return Judgement("invalid", remarks=reason_remarks(str(error)))


def _prepare_criterion(
    criterion: Criterion, match: Comparison
) -> tuple[Criterion, tuple[str, ...], str]:
    """Return a criterion fitted to the flight, its signals, and why it is not judged."""
    case, flight = match.case, match.flight
    criterion = settle_criterion(case, criterion, time=match.time, flight=flight)
    needed = required_quantities(criterion)
    # The first reason counts.
    reason = (
        criterion.reason
        or reason_not_judged(case, criterion)
        or reason_not_steered(case, criterion, flight)
        or _missing_text("flight record", needed, flight)
    )
    return criterion, needed, reason


def _missing_text(who: str, needed: tuple[str, ...], signals: RunSignals) -> str:
    """Return a text on the missing signals; empty if none is missing."""
    missing = [name for name in needed if name not in signals]
    if not missing:
        return ""
    return f"the {who} has no {', '.join(missing)}"


def judge_all(case: PomCase, time: np.ndarray, flight: Raw, model: Raw) -> dict[str, Judgement]:
    """Judge every criterion of a case on one model.

    Parameters are those of `judge_criterion`; the result is that of `judge_match`.
    """
    return judge_match(Comparison.of(case, time, flight, model))


def judge_match(match: Comparison) -> dict[str, Judgement]:
    """Judge every criterion of the case of a comparison.

    Returns
    -------
    dict of str to Judgement
        By criterion.  A group with a NaN or infinite sample is ``invalid`` as a whole. The
        alternative without a value could be the one that fails, and a model without values proves
        nothing.
    """
    case = match.case
    outcomes = {criterion.name: _judge_or_explain(criterion, match) for criterion in case.criteria}
    # By group: the first criterion without a value, and its remark.
    broken: dict[str, tuple[str, str]] = {}
    for criterion in case.criteria:
        for remark in outcomes[criterion.name].remarks:
            if remark.kind == "no_value" and criterion.applies:
                broken.setdefault(criterion.group, (criterion.name, remark.text))
    for criterion in case.criteria:
        if criterion.group not in broken or not criterion.applies:
            continue
        if outcomes[criterion.name].verdict not in ("pass", "fail", "advisory"):
            continue
        name, text = broken[criterion.group]
        remark = RowRemark("no_value", f"its alternative {name}: {text}", name)
        outcomes[criterion.name] = Judgement("invalid", remarks=(remark,))
    return outcomes


def _judge_time_history(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge a time history; all models share the band."""
    time, flight, model = match.both(criterion)
    # The base is part of the key, because `_apply_measure` may replace it.
    key = ("band", criterion.name, criterion.band.base)
    band = match.once(key, lambda: applied_band(criterion, time, flight))
    return judge_trace(criterion, time, flight=flight, model=model, band=band)


def _apply_measure(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge a criterion by its measure, also without the largest value in service."""
    measure = MEASURES[criterion.measure]
    if criterion.band.base != "range_max" or criterion.largest is not None:
        return measure(criterion, match)
    # The flight value does not exceed the largest value in service. A pass with a percentage of
    # the flight value is therefore a pass with a percentage of the largest value.
    strict_band = Band(criterion.band.limits, criterion.band.rule, "ref_scalar")
    strict = replace(criterion, band=strict_band)
    # A flight that is not steady within a third of the narrower band raises Invalid. Any other
    # error is raised again below.
    with suppress(Invalid):
        outcome = measure(strict, match)
        if outcome.verdict == "pass":
            remark = RowRemark("method", "passes on the flight value, so on the largest in service")
            return replace(outcome, remarks=(*outcome.remarks, remark))
    return measure(criterion, match)


def formed_channels(case: PomCase, flight: RunSignals) -> list[str]:
    """Return the judged channels that are derived from signals, so that they can be shown."""
    derived = SOURCES.keys() - {"time"}
    channels = []
    for criterion in case.criteria:
        if criterion.applies and criterion.channel in derived and criterion.channel in flight:
            channels.append(criterion.channel)
    return channels


def verdict_row(run: str, criterion: Criterion, outcome: Judgement) -> dict[str, Any]:
    """Return one row of the verdict table, in the unit of the table."""
    unit = display_unit(criterion)
    # SI per unit of the table; ratios and times are not converted
    scale = 1.0
    if criterion.channel:
        scale = limit_to_si_factor(criterion.measure, criterion.channel, unit)
    remarks = outcome.remarks
    if criterion.note:
        remarks = (*remarks, RowRemark("row", criterion.note))
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
        "remarks": remarks,
        "provenance": criterion.provenance,
    }


def band_widths(case: PomCase, time: np.ndarray, flight: Raw) -> xr.Dataset:
    """Return the half width of every judged time history (time,), NaN at other samples. [SI]"""
    widths: dict[str, np.ndarray] = {}
    signals = signals_of_run(case, flight, time)
    for criterion in case.criteria:
        criterion = settle_criterion(case, criterion, time=time, flight=signals)
        if criterion.measure != "trace" or not criterion.applies:
            continue
        if reason_not_judged(case, criterion) or criterion.channel not in signals:
            continue
        nan = np.full(time.size, np.nan)
        width = nan.copy()
        try:
            mask = Comparison(case, time, flight=signals, model=signals).counted(criterion)
            mask &= (time >= criterion.window[0] - 1e-9) & (time <= criterion.window[1] + 1e-9)
            width[mask] = half_width(criterion, signals[criterion.channel][mask])
        except (NotJudged, Invalid, ValueError):
            continue
        # The narrowest band counts if several criteria judge one channel.
        widths[criterion.channel] = np.fmin(width, widths.get(criterion.channel, nan))
    variables = {}
    for name, width in widths.items():
        variables[name] = ("time", width, {"units": lookup(name).units})
    return xr.Dataset(variables, coords={"time": time})
