"""Criteria against signals: the verdict table and the bands to draw."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from flightmech.names import VOCABULARY, lookup
from flightmech.units import parse

from .case import PomCase, driven
from .channels import factor, si_unit
from .criteria import Criterion
from .tolerance import Invalid, NotJudged, Outcome, half_width, trace

Signals = Mapping[str, np.ndarray]


def judge(case: PomCase, criterion: Criterion, time: np.ndarray, flight: Signals, model: Signals) -> Outcome:
    """Judge one criterion on one model.

    Returns
    -------
    Outcome
        ``not_tested`` or ``invalid`` with the reason as its note when it cannot be judged; never an exception for data.
    """
    reason = unjudged(case, criterion)
    if reason:
        return Outcome("not_tested", note=reason)
    for who, signals in (("flight record", flight), ("model", model)):
        missing = [name for name in channels(criterion) if name not in signals]
        if missing:
            return Outcome("not_tested", note=f"the {who} has no {', '.join(missing)}")
    try:
        return _measure(case, criterion, time, flight, model)
    except NotJudged as error:
        return Outcome("not_tested", note=str(error))
    except Invalid as error:
        return Outcome("invalid", note=str(error))


def unjudged(case: PomCase, criterion: Criterion) -> str:
    """Return why a criterion is not judged in this case; empty when it is."""
    if criterion.reason:
        return criterion.reason
    if criterion.channel in driven(case):
        return f"{criterion.channel} is driven by the record; what drives a model cannot be judged"
    if criterion.channel.startswith("F_") and case.drive.level == "recorded":
        return "the surfaces are driven, so pilot forces have no meaning"
    return ""


def channels(criterion: Criterion) -> tuple[str, ...]:
    """Return the channels a criterion is computed from."""
    return ("phi", "beta") if criterion.measure == "peak_lag" else (criterion.channel,)


def _measure(case: PomCase, criterion: Criterion, time: np.ndarray, flight: Signals, model: Signals) -> Outcome:
    from . import measures, modes

    match criterion.measure:
        case "trace":
            return trace(criterion, time, flight[criterion.channel], model[criterion.channel])
        case "steady":
            return measures.steady(criterion, time, flight, model, case.events["capture"])
        case "end_value":
            return measures.end_value(criterion, time, flight, model)
        case "trend":
            return measures.trend(criterion, time, flight, model)
        case "response_initial" | "response_total":
            return measures.response(criterion, time, flight, model)
        case "peak_lag":
            return modes.peak_lag(criterion, time, flight, model)
        case _:
            return modes.modal(criterion, time, flight, model, case.id)


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


def display_unit(criterion: Criterion) -> str:
    """Return the unit of the printed absolute limit, else the one in which people read the quantity."""
    for limit in criterion.band.limits:
        if limit.quantity == "absolute":
            return "1" if limit.unit == "-" else limit.unit
    if not criterion.channel:
        return "1"
    own = si_unit(criterion.measure, criterion.channel)
    shown = lookup(criterion.channel).display_units
    return shown if own == lookup(criterion.channel).units and shown in _LINEAR else own


_LINEAR = {row.display_units for row in VOCABULARY.values() if parse(row.display_units)[2] == 0.0}


def bands(case: PomCase, time: np.ndarray, flight: Signals) -> xr.Dataset:
    """Return the half width over time of every judged time history, NaN outside its window. [SI]"""
    found: dict[str, np.ndarray] = {}
    for criterion in case.criteria:
        if criterion.measure != "trace" or not criterion.applies or unjudged(case, criterion) or criterion.channel not in flight:
            continue
        mask = (time >= criterion.window[0] - 1e-9) & (time <= criterion.window[1] + 1e-9)
        width = np.full(time.size, np.nan)
        try:
            width[mask] = half_width(criterion, flight[criterion.channel][mask])
        except (NotJudged, ValueError):
            continue
        found[criterion.channel] = np.fmin(width, found.get(criterion.channel, np.full(time.size, np.nan)))
    attrs = {name: {"units": lookup(name).units} for name in found}
    return xr.Dataset({name: ("time", width, attrs[name]) for name, width in found.items()}, coords={"time": time})
