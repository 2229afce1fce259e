"""Result of a case from the flight and the outputs of its models."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from flightmech.names import WRAPPED, lookup
from flightmech.support.console import to_json_types
from pom.cases.case import PomCase
from pom.cases.case_file import SHOWN
from pom.cases.job import STATED, ReplayJob, initial_configuration, stated_only
from pom.cases.reference_states import CALIBRATION
from pom.judging.air_checks import air_remarks
from pom.judging.conditions.report_conditions import VALUES, report_values
from pom.judging.conditions.row_conditions import condition_remarks
from pom.judging.departures import case_departures, record_departures
from pom.judging.event_checks import event_remarks
from pom.judging.motion_checks import motion_remarks
from pom.judging.signals import Comparison, RunSignals, signals_of_run, traces_of
from pom.judging.verdict import band_widths, formed_channels, judge_match, verdict_row
from pom.judging.watched_channels import watch_channels, watch_track
from pom.judging.window_checks import input_end_remarks, window_remarks
from pom.replaying.replay_channels import (
    Traces,
    moved_controls,
    sampled_channels,
    shown_channels,
    unwrapped_near,
)
from pom.replaying.run_remarks import PILOT, pilot_activity_rows
from pom.replaying.trim import beyond_limits, trim_limits, trim_table
from pom.result import PomResult, make_verdict_table
from pom.tolerances.bands import Judgement, RowRemark
from pom.tolerances.criteria import Criterion


def assemble_result(
    case: PomCase,
    states: xr.Dataset,
    job: ReplayJob,
    outputs_by_run: Mapping[str, Mapping[str, np.ndarray]],
    failures: Mapping[str, str],
    attrs: Mapping[str, str] | None = None,
    more: Mapping[str, tuple[RowRemark, ...]] | None = None,
) -> PomResult:
    """Return the result of a case from the outputs of its models.

    Parameters
    ----------
    case, states, job
        As in `ReplayPlan`.
    outputs_by_run : mapping of model to mapping of output to array (time,)
    failures : mapping of model to text
        Empty texts for models that ran.
    attrs : mapping of str to str, optional
        Provenance, stored as attributes of the signals.
    more : mapping of model to tuple of RowRemark, optional
        Remarks on the models: distance from the flight evidence, tables left.
    """
    flight = signals_of_run(case, sampled_channels(states), job.time)
    attributes: dict[str, Any] = {}
    if CALIBRATION in states.attrs:
        attributes[CALIBRATION] = states.attrs[CALIBRATION]
    condition_values = report_values(case, flight)
    if condition_values:
        attributes[VALUES] = condition_values
    stated = stated_only(case, states)
    if stated:
        attributes[STATED] = " ".join(stated)
    # The corrections of the math pilot are outputs less inputs, before the applied positions.
    if job.pilot:
        attributes[PILOT] = json.dumps(to_json_types(_pilot_rows(job, outputs_by_run)))
    applied = {}
    for run, outputs in outputs_by_run.items():
        applied[run] = _use_applied_controls(job, outputs)
    channels = [*shown_channels(case, states), *formed_channels(case, flight)]
    signals = _join_signals(channels, flight, applied)
    # What depends on the flight alone is computed once for all models.
    match = Comparison(case, job.time, flight, flight)
    departures = (
        *case_departures(case),
        *record_departures(case, states),
        *condition_remarks(case, flight),
        *input_end_remarks(case, flight),
        *event_remarks(case, flight),
        *motion_remarks(case, flight),
        *window_remarks(states),
        *air_remarks(case, states),
    )
    rows: list[dict[str, Any]] = []
    for name, outputs in applied.items():
        rows += _verdict_rows(
            match,
            name,
            outputs,
            signals=signals,
            failure=failures.get(name, ""),
            more=(*departures, *(more or {}).get(name, ())),
        )
    return PomResult(
        case=case,
        conditions=dict(initial_configuration(case, job)),
        signals=signals.assign_attrs({**attributes, **(attrs or {})}),
        tolerance=band_widths(case, job.time, flight),
        inputs=_input_channels(job),
        trim=trim_table(flight, applied),
        verdict=make_verdict_table(rows),
        failure="; ".join(f"{name}: {text}" for name, text in failures.items() if text),
    )


def _verdict_rows(
    match: Comparison,
    run: str,
    outputs: Traces,
    *,
    signals: xr.Dataset,
    failure: str,
    more: tuple[RowRemark, ...],
) -> list[dict[str, Any]]:
    """Return the rows of one model, one per criterion.

    `match` compares the flight with itself; `failure` states why the run failed.
    """
    case, time = match.case, match.time
    limits = trim_limits(case, match.flight)
    started = outputs
    if failure:
        # A run that failed before its first sample has no trim, which its failure states.
        started = {name: values for name, values in outputs.items() if np.isfinite(values[0])}
    beyond_default = beyond_limits(limits, started, demanded=False)
    # A run has no judgement if it failed, or if its trim is beyond a limit of the case file.
    if failure:
        reasons: tuple[RowRemark, ...] = (RowRemark("failure", failure),)
        watched: tuple[RowRemark, ...] = ()
    else:
        reasons = beyond_limits(limits, outputs, demanded=True)
        # A channel that the case does not show is watched, too.
        flown = {**_usual_traces(match.flight), **traces_of(signals, "flight")}
        answer = {**_usual_traces(match.against(outputs).model), **traces_of(signals, run)}
        watched = (
            *watch_channels(case, time, flown, answer),
            *watch_track(case, time, match.flight, outputs),
        )
    remarks = (*beyond_default, *watched, *more)
    outcomes = judge_match(match.against(outputs))
    rows = []
    for criterion in case.criteria:
        outcome = _outcome_unless_invalid(criterion, reasons, outcomes[criterion.name])
        row = verdict_row(run, criterion, outcome)
        rows.append({**row, "remarks": (*row["remarks"], *remarks)})
    return rows


def _usual_traces(signals: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the channels that a case shows unless it states others, as far as a run has them."""
    traces = {}
    for name in SHOWN:
        if name in signals:
            traces[name] = np.asarray(signals[name], float)
    return traces


def _outcome_unless_invalid(
    criterion: Criterion, reasons: tuple[RowRemark, ...], outcome: Judgement
) -> Judgement:
    """Return an outcome; ``invalid`` if there are reasons against a judgement of the run."""
    if reasons and criterion.applies:
        return Judgement("invalid", remarks=reasons)
    return outcome


def _pilot_rows(job: ReplayJob, outputs_by_run: Mapping[str, Traces]) -> list[dict[str, Any]]:
    """Return the rows on the activity of the math pilot in each run."""
    controls = dict.fromkeys(loop.control for loop in job.pilot)
    rows: list[dict[str, Any]] = []
    for run, outputs in outputs_by_run.items():
        # Correction = position of the control less the recorded one.
        corrections = {}
        for control in controls:
            if control in outputs:
                corrections[control] = outputs[control] - job.inputs[control]
        rows += pilot_activity_rows(
            run,
            job.pilot,
            time=job.time,
            moved=corrections,
            targets=job.targets,
            outputs=outputs,
        )
    return rows


def _use_applied_controls(job: ReplayJob, outputs: Traces) -> Traces:
    """Return outputs in which a moved control has its applied position, if the model reports it.

    The applied position includes the bias of the trim.
    """
    controls = moved_controls(job)
    if not controls:
        return outputs
    applied = {}
    for name in controls:
        if f"applied.{name}" in outputs:
            applied[name] = outputs[f"applied.{name}"]
    return {**outputs, **applied}


def _join_signals(
    names: list[str], flight: RunSignals, outputs_by_run: Mapping[str, Traces]
) -> xr.Dataset:
    """Return the channels of flight and models (run, time); NaN for a channel that a run lacks."""
    time = flight.time
    runs = {"flight": flight}
    for run, outputs in outputs_by_run.items():
        runs[run] = RunSignals(outputs, time, flight.wheel_radius)
    data = {}
    for name in dict.fromkeys(names):
        traces: list[np.ndarray] = []
        for signals in runs.values():
            if name in signals:
                traces.append(np.asarray(signals[name], float))
            else:
                traces.append(np.full(time.size, np.nan))
        # Angles of all runs start within half a turn of the flight.
        if name in WRAPPED:
            traces = [unwrapped_near(trace, traces[0]) for trace in traces]
        quantity = lookup(name)
        attributes = {"units": quantity.units, "long_name": quantity.long_name}
        data[name] = (("run", "time"), np.stack(traces), attributes)
    return xr.Dataset(data, coords={"run": list(runs), "time": time})


def _input_channels(job: ReplayJob) -> xr.Dataset:
    """Return the inputs of the models over time, with their units."""
    data = {}
    for name, values in job.inputs.items():
        # An input such as ``engine1.thrust_drive`` is a thrust.
        units = lookup(name.removesuffix("_drive")).units
        data[name] = ("time", values, {"units": units})
    return xr.Dataset(data, coords={"time": job.time})
