"""Replay of a case: recorded inputs through every model, its outputs against the flight."""

from __future__ import annotations

import json
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import AeromatchError, SchemaError
from flightmech.names import lookup
from flightmech.support.console import to_json_types
from pom.cases.case import PomCase
from pom.cases.job import ReplayJob, initial_configuration, job_of
from pom.cases.reference_states import CALIBRATION, flight_states
from pom.fmu.description import check_interface
from pom.fmu.run_cache import KeptFlights
from pom.fmu.simulate import FmuModel, Models, check_law, fly_job
from pom.judging.applicability import reason_not_judged, settle_case
from pom.judging.beyond_the_bands import Evidence, evidence_remarks, watch_channels
from pom.judging.signals import Comparison, RunSignals, signals_of_run, traces_of
from pom.judging.verdict import band_widths, formed_channels, judge_match, verdict_row
from pom.replaying.run_remarks import PILOT, pilot_activity_rows, table_ranges, tables_left
from pom.replaying.trim import OBSERVED, beyond_limits, solve_trim_surfaces, trim_limits, trim_table
from pom.result import PomResult, make_verdict_table
from pom.tolerances.bands import Judgement, RowRemark
from pom.tolerances.channels import WRAPPED, output_of
from pom.tolerances.criteria import Criterion
from pom.tolerances.rows import helpful_signals, required_signals

Traces = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class ReplayPlan:
    """A case, ready to be flown by any model.

    Attributes
    ----------
    case : PomCase
    states : Dataset (time)
        The flight over the window.
    job : Job
        What drives the models.
    """

    case: PomCase
    states: xr.Dataset
    job: ReplayJob


def replay(
    case: PomCase,
    runs: Mapping[str, str | Path],
    path: Any = None,
    timeout: float = 60.0,
    names: Mapping[str, str | Path] | None = None,
    evidence: xr.DataTree | None = None,
) -> PomResult:
    """Replay a case by FMUs, each in a child process, and judge it.

    Parameters
    ----------
    case : PomCase
        From `read_case`.
    runs : mapping of str to path
        Name of a model to its FMU (FMI 1.0 to 3.0, co-simulation or model exchange), in the order
        of the report.
    path : Path of flighttest.reconstruct or Dataset (time), optional
        Reconstructed path of the record; without it the record is read and reconstructed.
    timeout : float
        Wall time allowed per model. [s]
    names : mapping of str to path, optional
        Name of a model to the table of its names, units and signs, when they are not the SI names
        (`docs/explanation/proof-of-match/replay.md`); it goes before that of the case file.
    evidence : DataTree, optional
        An identified database with standard errors: what flight found.  Every run then states how
        far the terms of the flown model lie from it (`pom.judging.beyond_the_bands`).

    Returns
    -------
    PomResult
        A model that crashed, hung or refused has ``invalid`` rows and a text in ``failure``.

    Raises
    ------
    SchemaError
        A model lacks an input, output or parameter that the case needs, declares another unit, or
        its table of names does not fit.
    OutOfRange
        The window is not inside the record, or an input holds a NaN.
    """
    models = Models(runs, names).of(case)
    plan = plan_of(case, path)
    for model in models.values():
        check_plan(plan, model)
    return perform_plan(plan, models, timeout, evidence=evidence)


def plan_of(case: PomCase, path: Any = None) -> ReplayPlan:
    """Return what `perform_plan` flies; parameters and errors as `replay`."""
    states = flight_states(case, path)
    job = job_of(case, states)
    return ReplayPlan(settle_case(case, job.time, _samples(states)), states, job)


def _samples(states: xr.Dataset) -> dict[str, np.ndarray]:
    """Return what the flight holds, per sample. [SI]"""
    items = ((str(name), states.variables[name]) for name in states.data_vars)
    return {
        name: np.broadcast_to(item.values, states.sizes["time"])
        for name, item in items
        if item.ndim < 2
    }


def check_plan(plan: ReplayPlan, model: FmuModel) -> None:
    """Check that a model offers what a case needs.

    A judged channel that the flight record lacks as well is not an error: its verdict states what is
    missing.

    Raises
    ------
    SchemaError
        With every name that is missing and every unit that does not fit.
    """
    job, links = plan.job, model.links
    moved = {loop.control for loop in job.pilot}.union(job.law.moves if job.law is not None else ())
    inputs = _taken(
        job.inputs, links.inputs, {*job.needed_inputs, *moved} - ({*links.waived} - moved)
    )
    shown, judged = (
        _outputs(names, links.outputs)
        for names in (shown_channels(plan.case, plan.states), judged_channels(plan.case))
    )
    recorded = {*map(str, plan.states.data_vars)}
    needed = {name for name in judged if output_of(name, recorded) in recorded}
    outputs = _taken([*shown, *job.targets], links.outputs, {*needed, *job.targets})
    check_law(model, job)
    check_interface(
        model.fmu,
        links,
        inputs,
        dict.fromkeys(outputs),
        _taken(job.parameters, links.parameters, {*job.needed_parameters} - {*links.waived}),
    )


def perform_plan(
    plan: ReplayPlan,
    models: Mapping[str, FmuModel],
    timeout: float,
    store: KeptFlights | None = None,
    evidence: xr.DataTree | None = None,
) -> PomResult:
    """Fly a checked plan by every model and judge it; parameters as `replay` and `fly_job`."""
    shown = shown_channels(plan.case, plan.states)
    found, failures, ranges, trims = {}, {}, {}, {}
    for name, model in models.items():
        ranges[name] = table_ranges(model.fmu.path, model.fmu.sha256)
        axes = [item.variable for item in ranges[name]]
        wanted = {*_outputs([*shown, *axes], model.links.outputs), *OBSERVED}
        job, trims[name], refused = solve_trim_surfaces(
            plan.job, plan.case.drive.trim_surfaces, model, timeout, store
        )
        found[name], failures[name] = fly_job(model, job, wanted, timeout, store)
        failures[name] = refused or failures[name]
    attrs = {f"model.{name}": model.origin() for name, model in models.items()}
    laws = [model.law for model in models.values() if model.law is not None]
    attrs |= {"control_law": laws[0].origin()} if laws else {}
    attrs |= {
        f"names.{name}": model.links.table for name, model in models.items() if model.links.table
    }
    compared = _compared(evidence, plan, models)
    more = {
        name: (
            *trims[name],
            *tables_left(plan.job.time, found[name], ranges[name]),
            *compared.get(name, ()),
            *_without(plan.job, model),
        )
        for name, model in models.items()
    }
    return assemble_result(plan.case, plan.states, plan.job, found, failures, attrs, more)


def _without(job: ReplayJob, model: FmuModel) -> tuple[RowRemark, ...]:
    """Return the remark on what a case needs and a model does without, as its table of names
    allows.
    """
    needed = [
        name for name in (*job.needed_inputs, *job.needed_parameters) if name in model.links.waived
    ]
    return (
        (RowRemark("waived", f"flown without {', '.join(needed)}, waived by the table of names"),)
        if needed
        else ()
    )


def _compared(
    evidence: xr.DataTree | None, plan: ReplayPlan, models: Mapping[str, FmuModel]
) -> dict[str, tuple[RowRemark, ...]]:
    """Return the remarks of every model on its distance from the flight evidence; none without
    evidence.
    """
    if evidence is None:
        return {}
    try:
        found = Evidence(evidence, plan.states, hinges=plan.case.drive.level != "recorded")
    except AeromatchError as error:
        return dict.fromkeys(
            models, (RowRemark("evidence", f"not compared with the flight evidence: {error}"),)
        )
    return {name: evidence_remarks(found, model.fmu.path) for name, model in models.items()}


def judged_channels(case: PomCase) -> list[str]:
    """Return the channels that the criteria of a case are computed from."""
    names = [
        name
        for c in case.criteria
        if c.applies and not reason_not_judged(case, c)
        for name in required_signals(c)
    ]
    return list(dict.fromkeys(names))


def shown_channels(case: PomCase, states: xr.Dataset) -> list[str]:
    """Return every channel of the result: judged, requested, moved by the math pilot, and the
    thrust of each engine.
    """
    moved = [*(loop.control for loop in case.drive.pilot), *case.law_moves]
    engines = sorted(
        str(name)
        for name in states.data_vars
        if str(name).startswith("engine") and str(name).endswith(".thrust")
    )
    return list(
        dict.fromkeys(
            [*judged_channels(case), *case.show, *moved, *engines, *helping_channels(case)]
        )
    )


def helping_channels(case: PomCase) -> list[str]:
    """Return the signals that show the events and conditions of the criteria of a case; a model may
    have them.
    """
    return [
        name
        for c in case.criteria
        if c.applies and not reason_not_judged(case, c)
        for name in helpful_signals(c)
    ]


def _outputs(names: Iterable[str], offered: Container[str]) -> list[str]:
    """Return the outputs of a model that hold channels."""
    return [output_of(name, offered) for name in names]


def _taken(given: Iterable[str], offered: Container[str], needed: Container[str]) -> list[str]:
    """Return the names that are needed, or given and offered."""
    return [name for name in given if name in offered or name in needed]


def assemble_result(
    case: PomCase,
    states: xr.Dataset,
    job: ReplayJob,
    found: Mapping[str, Mapping[str, np.ndarray]],
    failures: Mapping[str, str],
    attrs: Mapping[str, str] | None = None,
    more: Mapping[str, tuple[RowRemark, ...]] | None = None,
) -> PomResult:
    """Return the result of a case from the outputs of its models.

    Parameters
    ----------
    found : mapping of model to mapping of output to array (time,)
    failures : mapping of model to text
        Empty texts for models that ran.
    attrs : mapping of str to str, optional
        Provenance, kept as attributes of the signals.
    more : mapping of model to tuple of RowRemark, optional
        Remarks on the flown models: distance from the flight evidence, tables left.
    """
    flight = signals_of_run(case, _samples(states), job.time)
    kept = {CALIBRATION: states.attrs[CALIBRATION]} if CALIBRATION in states.attrs else {}
    if job.pilot:
        kept[PILOT] = json.dumps(to_json_types(_pilot(job, found)))
    if job.pilot or job.law is not None:
        found = {run: _as_applied(job, outputs) for run, outputs in found.items()}
    rows, limits = [], trim_limits(case, flight)
    signals = _signals(
        [*shown_channels(case, states), *formed_channels(case, flight)], flight, found
    )
    recorded, match = traces_of(signals, "flight"), Comparison(case, job.time, flight, flight)
    for name, outputs in found.items():
        seen = (
            ()
            if failures.get(name)
            else watch_channels(case, job.time, recorded, traces_of(signals, name))
        )
        remarks = (
            *beyond_limits(limits, outputs, demanded=False),
            *seen,
            *(more or {}).get(name, ()),
        )
        failure = _failed(failures.get(name, "")) or beyond_limits(limits, outputs, demanded=True)
        outcomes = judge_match(match.against(outputs))
        for criterion in case.criteria:
            judged = verdict_row(
                name, criterion, _outcome(criterion, failure, outcomes[criterion.name])
            )
            rows.append({**judged, "remarks": (*judged["remarks"], *remarks)})
    return PomResult(
        case=case,
        conditions=dict(initial_configuration(case, job)),
        signals=signals.assign_attrs({**kept, **(attrs or {})}),
        tolerance=band_widths(case, job.time, flight),
        inputs=_inputs(job),
        trim=trim_table(flight, found),
        verdict=make_verdict_table(rows),
        failure="; ".join(f"{name}: {text}" for name, text in failures.items() if text),
    )


def _failed(text: str) -> tuple[RowRemark, ...]:
    return (RowRemark("failure", text),) if text else ()


def _outcome(criterion: Criterion, failure: tuple[RowRemark, ...], outcome: Judgement) -> Judgement:
    """Return an outcome; a run that failed, or started beyond what the case file allows the trim,
    carries no judgement.
    """
    return Judgement("invalid", remarks=failure) if failure and criterion.applies else outcome


def _pilot(job: ReplayJob, found: Mapping[str, Traces]) -> list[dict[str, Any]]:
    """Return what the math pilot did in each run."""
    rows: list[dict[str, Any]] = []
    for run, outputs in found.items():
        moved = {
            name: outputs[name] - job.inputs[name]
            for name in dict.fromkeys(loop.control for loop in job.pilot)
            if name in outputs
        }
        rows += pilot_activity_rows(run, job.pilot, job.time, moved, job.targets, outputs)
    return rows


def _as_applied(job: ReplayJob, outputs: Traces) -> dict[str, np.ndarray]:
    """Return outputs with what the math pilot moves at its true position, bias of the trim
    included, where the model reports it.
    """
    controls = {loop.control for loop in job.pilot}.union(
        job.law.moves if job.law is not None else ()
    )
    moved = {name for name in controls if f"applied.{name}" in outputs}
    return {**outputs, **{name: outputs[f"applied.{name}"] for name in moved}}


def _signals(names: list[str], flight: RunSignals, found: Mapping[str, Traces]) -> xr.Dataset:
    time = flight.time
    runs = {
        "flight": flight,
        **{run: RunSignals(outputs, time, flight.wheel_radius) for run, outputs in found.items()},
    }
    data = {}
    for name in dict.fromkeys(names):
        traces = [
            np.asarray(run[name], float) if name in run else np.full(time.size, np.nan)
            for run in runs.values()
        ]
        if name in WRAPPED:
            traces = [unwrapped_near(trace, traces[0]) for trace in traces]
        data[name] = (
            ("run", "time"),
            np.stack(traces),
            {"units": lookup(name).units, "long_name": lookup(name).long_name},
        )
    return xr.Dataset(data, coords={"run": list(runs), "time": time})


def unwrapped_near(angle: np.ndarray, flight: np.ndarray) -> np.ndarray:
    """Return a wrapped angle (time,) without jumps, starting less than half a turn from the flight.
    [rad]
    """
    if not np.isfinite(angle).all() or not np.isfinite(flight[0]):
        return angle
    smooth = np.unwrap(angle)
    return smooth - 2.0 * np.pi * np.round((smooth[0] - flight[0]) / (2.0 * np.pi))


def _inputs(job: ReplayJob) -> xr.Dataset:
    units = {
        name: lookup("thrust" if name.endswith("thrust_drive") else name).units
        for name in job.inputs
    }
    data = {name: ("time", values, {"units": units[name]}) for name, values in job.inputs.items()}
    return xr.Dataset(data, coords={"time": job.time})


def files_by_name(option: str, words: tuple[str, ...], example: str) -> dict[str, Path]:
    """Return the files of command-line words ``name=file``.

    Parameters
    ----------
    option : str
        The option that the words belong to, for the text of an error.
    words : tuple of str
    example : str
        How one is written.

    Raises
    ------
    SchemaError
        Words without a name, with a name that came before, or ``flight``, which is taken; all of
        them.
    """
    found: dict[str, Path] = {}
    problems = []
    for word in words:
        name, _, file = word.partition("=")
        if not name or not file:
            problems.append(
                f"{word!r}: write {'name=file' + Path(example).suffix}, such as {example}"
            )
        elif name in (*found, "flight"):
            problems.append(f"{word!r}: the name {name!r} is taken; give every model its own")
        found[name] = Path(file)
    if problems:
        raise SchemaError(option, problems)
    return found
