"""Findings on the controls: surfaces of wrong sign, unit or time, and controls nothing follows."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.units import DEGREE
from flighttest.reconstruction.quality.checks.control_response import (
    EQUATIONS,
    FLOW,
    FOLLOWS,
    MOVED,
    SHORTEST,
    SIGNIFICANT,
    is_displaced,
    lowpass_channel,
    relative_pressure,
    remove_trim,
)
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.checks.surface_timing import (
    LONGEST,
    SurfaceTiming,
    regress_last_column,
    surface_timing,
)
from flighttest.reconstruction.quality.finding import (
    Finding,
    add_delay_line,
    iterate_rows,
    map_entry,
)

_LOWEST_R2 = 0.15  # of an equation whose signs count
_CERTAIN = 3.0 * SIGNIFICANT  # the same for a surface that hardly moves
_SMALL = 0.6 * DEGREE  # total movement below which an effect must not be large
_LEAST_SLIP = 0.5 * DEGREE  # standard deviation of sideslip that determines the side force
# 1/s2 per radian at the mean speed of the record: larger effects are angles in the wrong unit
_STRONGEST = {"delta_e": 100.0, "delta_a": 100.0, "delta_r": 20.0}
_WORDS = {
    "delta_e": "pitches the nose up (convention: trailing edge down is positive and pitches down)",
    "delta_a": "rolls to the right (convention: right aileron down is positive and rolls left)",
    "delta_r": "yaws to the right (convention: trailing edge left is positive and yaws left)",
}


def answer_findings(
    table: pd.DataFrame,
    followed: pd.DataFrame,
    signals: ResampledChannels,
    record: xr.DataTree,
    late: Collection[str] = (),
) -> list[Finding]:
    """Return the findings on surfaces, on controls of the pilot and on the side force.

    Parameters
    ----------
    table : DataFrame
        Result of `control_responses`.
    followed : DataFrame
        Result of `pilot_to_surface`.
    signals : ResampledChannels
    record : DataTree
        The record; its channels carry their entries of the name map.
    late : collection of str
        Channels that are late themselves. An equation with one of them, or without its flow angle,
        does not show the time of a surface.
    """
    findings = []
    for row in iterate_rows(table):
        others = set(_other_inputs(row.surface))
        punctual = not others & set(late)
        complete = not (others & FLOW) - set(signals.values)
        significant = row.R2 >= _LOWEST_R2 and abs(row.ratio) >= SIGNIFICANT
        wrong: list[Finding] = []
        if significant:
            wrong = _surface_findings(row, record, punctual)
        findings += wrong
        timed = complete and punctual and row.flow_late == 0.0
        if timed and all(finding.kind == "sign" for finding in wrong):
            # one line of the name map corrects the sign and the time
            slope = -1.0 if wrong else 1.0
            findings += _timing_findings(row, record, slope)
    for row in iterate_rows(followed):
        findings += _pilot_findings(row, record)
    return findings + _side_force_findings(signals)


def _other_inputs(surface: str) -> tuple[str, ...]:
    return next(equation.others for equation in EQUATIONS if equation.surface == surface)


def _surface_findings(row, record: xr.DataTree, punctual: bool) -> list[Finding]:
    """Return the finding on sign or unit of a surface.

    If a delay explains as much as a sign, the finding names both.
    """
    name = row.surface
    measured = (
        f"{row.rate}_dot = {row.effect:+.3g} 1/s2 per rad of {name}, {abs(row.ratio):.0f} "
        f"standard errors"
    )
    moved = row.movement > MOVED
    if row.effect > 0.0 and row.flow_late > 0.0 and moved:
        return [_late_flow_finding(row, record, measured)]
    if row.effect > 0.0 and row.sign > 0 and not moved and row.ratio < _CERTAIN:
        return [_small_movement_finding(row, measured)]
    if row.effect > _STRONGEST[name] and row.sign > 0 and row.movement < _SMALL:
        text = (
            f"{name} has the wrong sign, and is in rad and was taken as deg: it moves by "
            f"{row.movement / DEGREE:.2g} deg in all, and {measured}"
        )
        return [_wrong_entry(row, "unit", text, map_entry(record, name, -1.0 / DEGREE))]
    if row.effect > 0.0 and row.sign > 0:
        text = (
            f"{name} has the wrong sign: positive {name} {_WORDS[name]}; {measured}; "
            f"no delay up to {LONGEST:g} s explains as much"
        )
        return [_wrong_entry(row, "sign", text, map_entry(record, name, -1.0))]
    if row.effect > 0.0 and row.sign == 0 and punctual and moved:
        return [_undecided_finding(row, measured)]
    if row.effect < 0.0 and row.movement < _SMALL and abs(row.effect) > _STRONGEST[name]:
        text = (
            f"{name} is in rad and was taken as deg: it moves by {row.movement / DEGREE:.2g} "
            f"deg in all, and {measured}"
        )
        return [_wrong_entry(row, "unit", text, map_entry(record, name, 1.0 / DEGREE))]
    return []


def _small_movement_finding(row, measured: str) -> Finding:
    """Return the finding that a surface moves too little for its sign to be certain.

    The rudder of a real flight with a movement of 0.06 deg follows the yaw rate (float, yaw damper,
    stretch of the cables): the motion moves it, and its slope has the wrong sign.
    """
    text = (
        f"{row.surface} may have the wrong sign, or the motion moves it: {measured}, but it moves "
        f"by {row.movement / DEGREE:.2g} deg in all"
    )
    remedy = (
        f"check the sign of {row.surface} on a record in which it moves by more than "
        f"{MOVED / DEGREE:g} deg"
    )
    channels = (row.surface, row.rate)
    evidence = _effect_evidence(row)
    return Finding("warning", "undecided", channels, text, remedy=remedy, evidence=evidence)


def _effect_evidence(row) -> dict[str, float]:
    return {"effect": row.effect, "stderr": row.stderr, "R2": row.R2}


def _wrong_entry(row, kind: str, text: str, remedy: str) -> Finding:
    """Return the error of a surface that a line of the name map corrects."""
    channels = (row.surface, row.rate)
    return Finding("error", kind, channels, text, remedy=remedy, evidence=_effect_evidence(row))


def _late_flow_finding(row, record: xr.DataTree, measured: str) -> Finding:
    """Return the finding that the flow angle is late, or the surface reversed."""
    name = row.surface
    flow = next((name for name in _other_inputs(row.surface) if name in FLOW), "")
    late = f"{1e3 * row.flow_late:.0f} ms"
    text = (
        f"{flow} is recorded about {late} late, or {name} has the wrong sign: with that "
        f"delay {name} moves the aeroplane as the "
        f"convention states and more of {row.rate}_dot is explained than at any other "
        f"time of {name}; without it {measured}"
    )
    remedy = (
        f"compare {flow} with attitude and climb, or with another record; "
        f"{add_delay_line(record, flow, delay=row.flow_late)}"
    )
    channels = (flow, name, row.rate)
    evidence = {**_effect_evidence(row), "flow_late": row.flow_late}
    return Finding("warning", "lag", channels, text, remedy=remedy, evidence=evidence)


def _undecided_finding(row, measured: str) -> Finding:
    """Return the finding that two leads of opposite signs explain the motion equally well."""
    name = row.surface
    first, second = sorted((row.lead, row.other), key=abs)
    text = (
        f"{name} has the wrong sign or is recorded at another time: {measured}; recorded "
        f"{_format_lead(first)} with one sign or "
        f"{_format_lead(second)} with the other it explains the motion equally well"
    )
    remedy = (
        f"compare {name} with the pilot's control or with a record that holds a "
        f"3-2-1-1, then correct sign or delay in the name map"
    )
    channels = (name, row.rate)
    evidence = {**_effect_evidence(row), "lead": row.lead, "other": row.other}
    return Finding("warning", "undecided", channels, text, remedy=remedy, evidence=evidence)


def _format_lead(lead: float) -> str:
    side = "early" if lead > 0.0 else "late"
    return f"{1e3 * abs(lead):.0f} ms {side}"


def _timing_findings(row, record: xr.DataTree, slope: float) -> list[Finding]:
    """Return the finding that a surface was not recorded when it acted.

    `slope` is -1 if the same line of the name map corrects the sign.
    """
    timing = SurfaceTiming(
        lead=row.lead,
        stderr=row.lead_stderr,
        gained=row.gained,
        explained=row.explained,
        bound=row.bound,
        sign=row.sign,
        other=row.other,
    )
    if not is_displaced(timing, row.movement):
        return []
    name = row.surface
    # a command leads its surface by the lag of the actuator; a late clock is a pure delay
    if row.lead > 0.0:
        order, correction, cause = "before", "lag", "a command, whose actuator lags"
    else:
        order, correction, cause = "after", "delay", "a clock that is late"
    line = ""
    if row.bound:
        measured = f"at least {1e3 * abs(row.lead):.0f} ms"
        end = f"; longer times than {LONGEST:g} s were not tried"
    else:
        error = f"standard error {1e3 * row.lead_stderr:.0f} ms"
        measured, end = f"{1e3 * abs(row.lead):.0f} ms ({error})", ""
        line = add_delay_line(record, name, **{correction: -row.lead}, slope=slope)
    text = (
        f"{name} is recorded {measured} {order} it acts on {row.rate}_dot "
        f"(that time gains {row.gained:.2f} of R2, which is then {row.explained:.2f}{end})"
    )
    remedy = f"{cause}: find the time between and put it into the name map"
    if line:
        remedy = f"{line}, if it is {cause}"
    evidence = {
        "lead": row.lead,
        "stderr": None if row.bound else row.lead_stderr,
        "gained": row.gained,
        "bound": bool(row.bound),
    }
    channels = (name, row.rate)
    return [Finding("warning", "lag", channels, text, remedy=remedy, evidence=evidence)]


def _pilot_findings(row, record: xr.DataTree) -> list[Finding]:
    """Return the finding on a control of the pilot that its surface does not follow."""
    channels = (row.control, row.surface)
    evidence = {"correlation": row.correlation, "delay": row.delay}
    detail = f"(correlation {row.correlation:+.2f}, {1e3 * row.delay:+.0f} ms)"
    if row.expected * row.correlation < -FOLLOWS:
        text = (
            f"{row.control} has the wrong sign: it moves with {row.surface} instead of "
            f"against it {detail}"
        )
        remedy = map_entry(record, row.control, -1.0)
        return [Finding("error", "sign", channels, text, remedy=remedy, evidence=evidence)]
    if row.position and abs(row.correlation) < FOLLOWS:
        text = f"{row.surface} moves and {row.control} does not go with it {detail}"
        remedy = "check the pick-up; do not use the channel"
        return [Finding("warning", "stuck", channels, text, remedy=remedy, evidence=evidence)]
    return []


def _side_force_findings(signals: ResampledChannels) -> list[Finding]:
    """Return the error of a side force that does not oppose sideslip."""
    channels = ("ay_imu", "beta_vane")
    if not set(channels) <= set(signals.values):
        return []
    mask = signals.mask(channels)
    short = mask.sum() * signals.step < SHORTEST
    if short or np.std(signals["beta_vane"][mask]) < _LEAST_SLIP:
        return []
    scale = relative_pressure(signals, mask)
    others = []
    for name in ("p", "r", "delta_r"):
        if name in signals:
            others.append(remove_trim(lowpass_channel(signals, name), signals)[mask])
    y = remove_trim(signals["ay_imu"] / scale, signals)[mask]
    slip = remove_trim(signals["beta_vane"], signals)
    fit = regress_last_column(y, [*others, slip[mask]], mask=mask, step=signals.step)
    if fit is None:
        return []
    effect, stderr, R2 = fit
    if R2 < _LOWEST_R2 or effect / stderr < SIGNIFICANT:
        return []
    # a late vane looks reversed
    if surface_timing(y, others, surface=slip, time=signals.time, mask=mask).sign <= 0:
        return []
    detail = f"{effect:+.3g} m/s2 per rad, {effect / stderr:.0f} standard errors"
    text = f"ay_imu grows with beta_vane ({detail}): side force must oppose sideslip"
    remedy = "sign = -1 on one of the two; the check of kinematics shows which"
    evidence = {"effect": effect, "stderr": stderr, "R2": R2}
    return [Finding("error", "sign", channels, text, remedy=remedy, evidence=evidence)]
