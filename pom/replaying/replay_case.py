"""Replay of a case: recorded inputs through every model, its outputs against the flight."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import AeromatchError, OutOfRange, SchemaError
from flighttest.reconstruction.dynamics.propeller_loads import with_engine_channels
from pom.cases.case import PomCase
from pom.cases.case_file import SHOWN
from pom.cases.fact_agreement import check_record_facts
from pom.cases.job import ReplayJob, job_of, with_stated_inputs
from pom.cases.reference_states import flight_states, refusal_of, whole_states
from pom.fmu.description import check_interface
from pom.fmu.models import FmuModel, Models
from pom.fmu.run_cache import KeptFlights
from pom.fmu.simulate import check_law, fly_job
from pom.judging.applicability import settle_case
from pom.judging.beyond_the_bands import Evidence, evidence_remarks
from pom.judging.conditions.stall_checks import reach_remarks
from pom.judging.envelope_remarks import AXIS, REGION, envelope_remarks
from pom.judging.watched_channels import GROUND_VELOCITY
from pom.judging.window_checks import with_window_check
from pom.probing.aircraft_identity import aircraft_remarks, demand_own_evidence
from pom.probing.control_doubts import size_remarks
from pom.probing.flight_consistency import on_wheels
from pom.probing.input_probe import SIZES
from pom.probing.model_probes import probe_models, tables_of, with_run_remarks
from pom.probing.record_leak import find_leaks
from pom.probing.temperature_effect import weigh_temperature
from pom.probing.thrust_bias import THRUST, recorded_thrust_remarks, thrust_bias_remarks
from pom.probing.wind_effect import weigh_wind
from pom.replaying.idle_devices import idle_remarks
from pom.replaying.kernel_replay import fly_once
from pom.replaying.replay_channels import (
    judged_channels,
    moved_controls,
    sampled_channels,
    shown_channels,
)
from pom.replaying.result_assembly import assemble_result
from pom.replaying.run_remarks import below_runway, table_ranges, tables_left
from pom.replaying.table_agreement import compare_model_tables, shows_own_tables
from pom.replaying.trim import OBSERVED, solve_trim_surfaces
from pom.result import PomResult
from pom.status import PASSED
from pom.tolerances.bands import RowRemark
from pom.tolerances.channels import output_of


@dataclass(frozen=True)
class ReplayPlan:
    """A case, ready to be flown by any model.

    Attributes
    ----------
    case : PomCase
    states : Dataset (time)
        The flight over the window.
    job : Job
        Inputs, parameters and start of the models.
    refusal : str
        Why no model can fly the case (`refusal_of`); empty if models can.
    """

    case: PomCase
    states: xr.Dataset
    job: ReplayJob
    refusal: str = ""

    def demand(self) -> ReplayPlan:
        """Return the plan itself.

        Raises
        ------
        OutOfRange
            No model can fly the case.
        """
        if self.refusal:
            raise OutOfRange(f"case {self.case.name}: {self.refusal}")
        return self


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
        Name of a model to the table of its names, units and signs, if they are not the SI names
        (`docs/explanation/proof-of-match/replay.md`). It has priority over the table of the case
        file.
    evidence : DataTree, optional
        An identified database with standard errors. Every run then states the distance of the
        terms of its model from this database (`pom.judging.beyond_the_bands`).

    Returns
    -------
    PomResult
        A model that crashed, hung or refused has ``invalid`` rows and a text in ``failure``.

    Raises
    ------
    SchemaError
        A model lacks an input, output or parameter that the case needs, declares another unit, or
        its table of names does not fit.  Or the evidence is of another aeroplane.
    OutOfRange
        The window is not inside the record, or an input holds a NaN.
    """
    demand_own_evidence(evidence, [case])
    models = Models(runs, names).of(case)
    plan = plan_of(case, path)
    for model in models.values():
        check_plan(plan, model)
    return perform_plan(plan, models, timeout, evidence=evidence)


def plan_of(case: PomCase, path: Any = None) -> ReplayPlan:
    """Return the plan for `perform_plan`; parameters and errors as `replay`."""
    record = whole_states(case, path)
    states = flight_states(case, record)
    # of the whole record, because the input may go on after the window
    states = with_window_check(states, case, record)
    check_record_facts(case, states)
    job = job_of(case, states)
    settled = settle_case(case, job.time, sampled_channels(states))
    return ReplayPlan(settled, states, job, refusal_of(case, record))


def check_plan(plan: ReplayPlan, model: FmuModel) -> None:
    """Check that a model offers all that a case needs.

    A judged channel that the flight record lacks as well is not an error: its verdict states that
    it is missing.

    Raises
    ------
    SchemaError
        With every name that is missing and every unit that does not fit.
    """
    job, links = plan.job, model.links
    # A table of names can waive an input, but not a control that is moved during the run.
    controls = moved_controls(job)
    needed_inputs = {*job.needed_inputs, *controls} - ({*links.waived} - controls)
    inputs = _needed_or_offered(job.inputs, links.inputs, needed_inputs)
    reported = _output_names(shown_channels(plan.case, plan.states), links.outputs)
    judged = _output_names(judged_channels(plan.case), links.outputs)
    # A judged channel is needed only if the record has it.
    recorded = {*map(str, plan.states.data_vars)}
    needed = {name for name in judged if output_of(name, recorded) in recorded}
    outputs = _needed_or_offered(
        [*reported, *job.targets], links.outputs, needed={*needed, *job.targets}
    )
    parameters = _needed_or_offered(
        job.parameters, links.parameters, needed={*job.needed_parameters} - {*links.waived}
    )
    check_law(model, job)
    check_interface(
        model.fmu, links, inputs=inputs, outputs=dict.fromkeys(outputs), parameters=parameters
    )


def perform_plan(
    plan: ReplayPlan,
    models: Mapping[str, FmuModel],
    timeout: float,
    store: KeptFlights | None = None,
    evidence: xr.DataTree | None = None,
) -> PomResult:
    """Fly a checked plan by every model and judge it; parameters as `replay` and `fly_job`.

    A plan with a refusal gives ``invalid`` rows with its text.
    """
    if plan.refusal:
        return _refused_result(plan, models)
    outputs_by_run: dict[str, dict[str, np.ndarray]] = {}
    jobs: dict[str, ReplayJob] = {}
    failures: dict[str, str] = {}
    remarks: dict[str, tuple[RowRemark, ...]] = {}
    channels = shown_channels(plan.case, plan.states)
    recorded = sampled_channels(plan.states)
    rolling = on_wheels(plan.states)
    for name, model in models.items():
        ranges = table_ranges(model.fmu.path, model.fmu.sha256)
        # The variables of the tables show where a run left them.
        axes = [item.variable for item in ranges]
        # The velocity over the ground shows the track, which no row judges.
        names = [*channels, *axes, *GROUND_VELOCITY]
        # Probes and watched channels do not depend on what a case shows.
        names += SHOWN
        requested = {*_output_names(names, model.links.outputs), *OBSERVED, *SIZES, REGION, AXIS}
        # what the trim adds to a thrust is compared with it
        requested |= {output for output in model.links.outputs if THRUST.match(output)}
        job, trim_remarks, refused = solve_trim_surfaces(
            plan.job,
            plan.case.drive.trim_surfaces,
            model=model,
            timeout=timeout,
            store=store,
        )
        outputs, failure = fly_job(model, job, requested, timeout=timeout, store=store)
        outputs_by_run[name], jobs[name] = outputs, job
        failures[name] = refused or failure
        remarks[name] = (
            *trim_remarks,
            *tables_left(plan.job.time, outputs, ranges),
            *envelope_remarks(plan.job.time, outputs, rolling),
            *_reach_remarks(plan, outputs, model),
            *below_runway(plan.job.time, outputs, job.parameters),
            *thrust_bias_remarks(job, outputs, recorded),
            *recorded_thrust_remarks(job, outputs, recorded),
            *find_leaks(plan.case, plan.states, model.fmu.path, model.fmu.sha256),
        )
    distances = _compare_with_evidence(evidence, plan, models)
    # Further remarks follow those of the run.
    for name, model in models.items():
        tables = tables_of(model)
        if tables is not None:
            remarks[name] += idle_remarks(plan.case, plan.states, tables.variables)
        remarks[name] += tuple(aircraft_remarks(plan.case, tables))
        remarks[name] += (*distances.get(name, ()), *_waiver_remarks(plan.job, model))
    result = assemble_result(
        plan.case,
        plan.states,
        job=plan.job,
        outputs_by_run=outputs_by_run,
        failures=failures,
        attrs=_describe_models(models),
        more=remarks,
    )
    return _probe_passing(
        result,
        models,
        jobs,
        outputs=outputs_by_run,
        states=plan.states,
        timeout=timeout,
        store=store,
    )


def _refused_result(plan: ReplayPlan, models: Mapping[str, FmuModel]) -> PomResult:
    """Return the result of a plan that no model can fly: every row is invalid."""
    silent: dict[str, dict[str, np.ndarray]] = {name: {} for name in models}
    result = assemble_result(
        plan.case,
        plan.states,
        job=plan.job,
        outputs_by_run=silent,
        failures=dict.fromkeys(models, plan.refusal),
        attrs=_describe_models(models),
    )
    # one reason for all models
    return replace(result, failure=plan.refusal)


def _probe_passing(
    result: PomResult,
    models: Mapping[str, FmuModel],
    jobs: Mapping[str, ReplayJob],
    outputs: Mapping[str, Mapping[str, np.ndarray]],
    states: xr.Dataset,
    timeout: float,
    store: KeptFlights | None,
) -> PomResult:
    """Return a result with the remarks of all probes on the models that pass."""
    agreements, own_flights = {}, {}
    for name, model in models.items():
        if result.status(name) not in PASSED:
            continue
        agreements[name] = _table_agreement(model, jobs[name], outputs[name])
        # A model whose answer is that of its tables is flown by the kernel.
        tables = tables_of(model)
        if tables is not None and shows_own_tables(agreements[name]):
            own_flights[name] = partial(fly_once, tables)
    found = probe_models(
        result,
        models,
        jobs,
        outputs=outputs,
        states=states,
        timeout=timeout,
        store=store,
        own_flights=own_flights,
    )
    for name, agreement in agreements.items():
        probed = found.get(name, ())
        # A model that its inputs do not drive has no effect of temperature or wind.
        if any(remark.kind == "not_driven" for remark in probed):
            continue
        job, flown = jobs[name], outputs[name]
        weighed = weigh_temperature(
            result,
            name,
            model=models[name],
            job=job,
            outputs=flown,
            timeout=timeout,
            store=store,
        )
        fly = own_flights.get(name)
        if fly is None or job.law is not None:
            fly = partial(fly_job, models[name], timeout=timeout, store=store)
        found[name] = (*probed, *agreement, *weighed, *weigh_wind(result, name, job, flown, fly))
    return with_run_remarks(result, found)


def _table_agreement(
    model: FmuModel, job: ReplayJob, outputs: Mapping[str, np.ndarray]
) -> tuple[RowRemark, ...]:
    """Return the remark on the tables inside an FMU; none for an FMU of another program."""
    tables = tables_of(model)
    if tables is None:
        return ()
    return compare_model_tables(model, tables, job, outputs)


def _describe_models(models: Mapping[str, FmuModel]) -> dict[str, str]:
    """Return the provenance of the models, of their control law and of their tables of names."""
    attrs = {f"model.{name}": model.origin() for name, model in models.items()}
    # All models of a case have the control law of the case.
    for model in models.values():
        if model.law is not None:
            attrs["control_law"] = model.law.origin()
    for name, model in models.items():
        if model.links.table:
            attrs[f"names.{name}"] = model.links.table
    return attrs


def _reach_remarks(
    plan: ReplayPlan, outputs: Mapping[str, np.ndarray], model: FmuModel
) -> tuple[RowRemark, ...]:
    """Return the remark on a model that is not valid beyond the stall of the flight."""
    alpha = None
    if "alpha" in plan.states:
        alpha = np.interp(plan.job.time, plan.states["time"], plan.states["alpha"])
    return reach_remarks(plan.case, plan.job.time, alpha, outputs, str(model.fmu.path))


def _waiver_remarks(job: ReplayJob, model: FmuModel) -> tuple[RowRemark, ...]:
    """Return the remark on the needed names that the table of names of a model waives."""
    needed = (*job.needed_inputs, *job.needed_parameters)
    waived = [name for name in needed if name in model.links.waived]
    if not waived:
        return ()
    text = f"flown without {', '.join(waived)}, waived by the table of names"
    return (RowRemark("waived", text),)


def _compare_with_evidence(
    evidence: xr.DataTree | None, plan: ReplayPlan, models: Mapping[str, FmuModel]
) -> dict[str, tuple[RowRemark, ...]]:
    """Return the remarks on the distance of every model from the flight evidence."""
    if evidence is None:
        return {}
    try:
        states = with_stated_inputs(plan.case, plan.states)
        if plan.case.aircraft:
            # terms over CT or J of a propeller aircraft whose record has no thrust
            states = with_engine_channels(states, read_aircraft(plan.case.aircraft))
        comparison = Evidence(evidence, states, hinges=plan.case.drive.level != "recorded")
    except AeromatchError as error:
        text = f"not compared with the flight evidence: {error}"
        return dict.fromkeys(models, (RowRemark("no_evidence", text),))
    # The same recorded control drives all models.
    doubts = size_remarks(evidence, plan.case, states)
    remarks = {}
    for name, model in models.items():
        remarks[name] = (*evidence_remarks(comparison, model.fmu.path), *doubts)
    return remarks


def _output_names(channels: Iterable[str], offered: Container[str]) -> list[str]:
    """Return the outputs of a model that hold channels."""
    return [output_of(channel, offered) for channel in channels]


def _needed_or_offered(
    names: Iterable[str], offered: Container[str], needed: Container[str]
) -> list[str]:
    """Return the names that a case needs, or that a model offers."""
    return [name for name in names if name in offered or name in needed]


def files_by_name(option: str, words: tuple[str, ...], example: str) -> dict[str, Path]:
    """Return the files of command-line words ``name=file``.

    Parameters
    ----------
    option : str
        The option of the words, for the text of an error.
    words : tuple of str
    example : str
        An example of a word.

    Raises
    ------
    SchemaError
        With all words that have no name or no file, repeat a name, or have the reserved name
        ``flight``.
    """
    files: dict[str, Path] = {}
    problems = []
    for word in words:
        name, _, file = word.partition("=")
        if not name or not file:
            form = f"name=file{Path(example).suffix}"
            problems.append(f"{word!r}: write {form}, such as {example}")
        elif name in (*files, "flight"):
            problems.append(f"{word!r}: the name {name!r} is taken; give every model its own")
        files[name] = Path(file)
    if problems:
        raise SchemaError(option, problems)
    return files
