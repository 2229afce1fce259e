"""Criteria against signals: the verdict table and the bands to draw."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from flightmech.names import lookup

from . import modes
from .case import PomCase, driven
from .channels import display_unit, factor
from .conditions import settle
from .criteria import Band, Criterion
from .marks import DISCRETES, LEVELS, OF_PARAMETER
from .match import Match
from .measures import curves, engine, instants, levels, release, runs, segments, trends, turning
from .relations import asked
from .signals import SOURCES, Raw, Signals, signals_of, sources
from .tolerance import Invalid, NotJudged, Outcome, half_width, trace

FOOTPRINT = "a footprint: a recording without a reference has no band and no verdict"
TRIMMED = ("delta_e", "delta_a", "delta_r", "thrust", "throttle")
"""What a trim at the start finds; a snapshot judges it although the record drives it from there on."""

MEASURES: dict[str, Callable[[Criterion, Match], Outcome]] = {
    "trace": lambda criterion, match: trace(criterion, *match.both(criterion)),
    "steady": levels.steady,
    "change": levels.change,
    "end_value": levels.end_value,
    "low_speed_end": levels.low_speed_end,
    "segment_mean": segments.segment_mean,
    "floor": segments.floor,
    "elapsed": runs.elapsed,
    "event_value": instants.event_value,
    "setup": instants.setup,
    "response_initial": engine.response,
    "response_total": engine.response,
    "curve": curves.curve,
    "force_increment": curves.force_increment,
    "breakout": curves.breakout,
    "scalar": turning.number,
    "first_zero_crossing": release.first_zero_crossing,
    "time_90_to_10": release.time_90_to_10,
    "period_n": release.period_n,
    "overshoot_n": release.overshoot_n,
    "overshoot_count": release.overshoot_count,
    "period": modes.modal,
    "t_half": modes.modal,
    "damping_ratio": modes.modal,
    "peak_lag": modes.peak_lag,
    "trend": trends.trend,
}


def judge(case: PomCase, criterion: Criterion, time: np.ndarray, flight: Raw, model: Raw) -> Outcome:
    """Judge one criterion on one model.

    Parameters
    ----------
    case : PomCase
    criterion : Criterion
        One of the case; it is settled on the flight first (`conditions.settle`).
    time : array (time,)
        Samples of the replay on the clock of the record. [s]
    flight, model : mapping of str to array (time,)
        Signals by house name. [SI]

    Returns
    -------
    Outcome
        ``not_tested`` or ``invalid`` with the reason as its note when it cannot be judged; never an exception for data.
    """
    try:
        match = Match.of(case, time, flight, model)
        criterion = settle(case, criterion, time, match.flight)
        reason = criterion.reason or unjudged(case, criterion)
        if reason:
            return Outcome("not_tested", note=reason)
        for who, signals in (("flight record", match.flight), ("model", match.model)):
            missing = [name for name in needs(criterion) if name not in signals]
            if missing:
                return Outcome("not_tested", note=f"the {who} has no {', '.join(missing)}")
        return _measured(criterion, match)
    except NotJudged as error:
        return Outcome("not_tested", note=str(error))
    except Invalid as error:
        return Outcome("invalid", note=str(error))


def _measured(criterion: Criterion, match: Match) -> Outcome:
    measure = MEASURES[criterion.measure]
    if criterion.band.base != "range_max" or criterion.largest is not None:
        return measure(criterion, match)
    # the flight value is never above the largest in service: what passes on that base passes on any
    strict = replace(criterion, band=Band(criterion.band.limits, criterion.band.rule, "ref_scalar"))
    with suppress(Invalid):  # not steady within a third of the narrower band; what is wrong beside is found again
        outcome = measure(strict, match)
        if outcome.verdict == "pass":
            said = "passes on the flight value, so on the largest in service"
            return replace(outcome, note="; ".join(filter(None, (outcome.note, said))))
    return measure(criterion, match)


def unjudged(case: PomCase, criterion: Criterion) -> str:
    """Return why a criterion is not judged in this case; empty when it is."""
    if case.reference == "footprint":
        return FOOTPRINT
    if criterion.reason:
        return criterion.reason
    judged = criterion.channel
    if any(loop.channel == judged for loop in case.drive.pilot):
        return f"{judged} is held by the math pilot; what a controller holds cannot be judged"
    if judged in driven(case) and not _found_by_trim(case, criterion):
        return f"{judged} is driven by the record; what drives a model cannot be judged"
    if judged.startswith("F_") and case.drive.level == "recorded":
        return "the surfaces are driven, so pilot forces have no meaning"
    if judged == "F_rim" and case.drive.level == "force":
        return "F_rim is driven by the record; what drives a model cannot be judged"
    return ""


def _found_by_trim(case: PomCase, criterion: Criterion) -> bool:
    """Whether the trim at the start finds what a snapshot judges: recorded value plus bias is the model's own answer."""
    return criterion.measure in ("steady", "change") and case.drive.trim is True and criterion.channel.rpartition(".")[2] in TRIMMED


def needs(criterion: Criterion) -> tuple[str, ...]:
    """Return the quantities a criterion is computed from, formed ones among them."""
    match criterion.measure:
        case "peak_lag":
            return ("phi", "beta")
        case "segment_mean":
            return ("h",) if criterion.channel == "hdot" else (criterion.channel,)
        case "floor":
            return ("h", "V")
        case "curve" | "breakout" | "force_increment":
            return (criterion.channel, criterion.abscissa)
        case "scalar":
            return {"turn_radius": ("distance", "psi"), "trim_rate": (criterion.abscissa,)}.get(
                criterion.parameter, (criterion.channel, criterion.abscissa)
            )
        case "elapsed":
            return tuple(filter(None, (criterion.channel, criterion.abscissa, LEVELS.get(criterion.bounds[1], ("",))[0])))
    return (criterion.channel,)


def channels(criterion: Criterion) -> tuple[str, ...]:
    """Return the signals that a criterion is computed from; a model has to have them."""
    return tuple(dict.fromkeys(name for channel in needs(criterion) for name in sources(channel)))


def helpful(criterion: Criterion) -> tuple[str, ...]:
    """Return signals that tell the events and conditions of a criterion; a model may have them."""
    event = OF_PARAMETER.get(criterion.parameter, "") if criterion.measure in ("event_value", "setup") else ""
    tellers = [name for mark in (event, *criterion.bounds) for name in (*DISCRETES.get(mark, ()), *LEVELS.get(mark, ())[:1])]
    flows = [f"engine{n}.fuel_flow" for n in range(1, 5)] if criterion.channel == "fuel_used" else []
    return tuple(dict.fromkeys(name for channel in (*tellers, *asked(criterion.condition), *flows) for name in sources(channel)))


def formed_channels(case: PomCase, flight: Signals) -> list[str]:
    """Return the judged channels that are formed of signals, so that they can be shown."""
    formed = SOURCES.keys() - {"time"}
    return [c.channel for c in case.criteria if c.applies and c.channel in formed and c.channel in flight]


def row(run: str, criterion: Criterion, outcome: Outcome) -> dict[str, Any]:
    """Return one row of the verdict table, in the unit of the table."""
    unit = display_unit(criterion)
    scale = factor(criterion.measure, criterion.channel, unit) if criterion.channel else 1.0
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
        "note": "; ".join(text for text in (outcome.note, criterion.note) if text),
        "provenance": criterion.provenance,
    }


def bands(case: PomCase, time: np.ndarray, flight: Raw) -> xr.Dataset:
    """Return the half width over time of every judged time history, NaN where it does not count. [SI]"""
    found: dict[str, np.ndarray] = {}
    signals = signals_of(case, flight, time)
    for criterion in case.criteria:
        criterion = settle(case, criterion, time, signals)
        if criterion.measure != "trace" or not criterion.applies or unjudged(case, criterion) or criterion.channel not in signals:
            continue
        width = np.full(time.size, np.nan)
        try:
            mask = Match(case, time, signals, signals).counted(criterion)
            mask &= (time >= criterion.window[0] - 1e-9) & (time <= criterion.window[1] + 1e-9)
            width[mask] = half_width(criterion, signals[criterion.channel][mask])
        except (NotJudged, Invalid, ValueError):
            continue
        found[criterion.channel] = np.fmin(width, found.get(criterion.channel, np.full(time.size, np.nan)))
    attrs = {name: {"units": lookup(name).units} for name in found}
    return xr.Dataset({name: ("time", width, attrs[name]) for name, width in found.items()}, coords={"time": time})
