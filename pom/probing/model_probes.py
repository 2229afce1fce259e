"""Both probes of every model of a case that passes, as remarks of its rows."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from math import inf

import numpy as np
import xarray as xr

from flightmech.errors import AeromatchError
from flightmech.simulation.compiler import SimModel
from pom.cases.case import PomCase
from pom.cases.case_file import SHOWN
from pom.cases.job import ReplayJob
from pom.fmu.models import FmuModel
from pom.fmu.run_cache import KeptFlights
from pom.fmu.simulate import fly_job
from pom.judging.beyond_the_bands import kept_model
from pom.judging.signals import traces_of
from pom.judging.watched_channels import SLOWEST
from pom.probing.flight_consistency import (
    CHANNELS,
    INPUTS_PROBE,
    LEAST_EFFECT,
    compare_inputs,
    compare_lift,
    largest_input_effect,
    lift_not_checked,
    on_wheels,
)
from pom.probing.input_probe import (
    JUMP_PROBE,
    NEAR,
    SHARE_PROBE,
    SIZES,
    changed_job,
    judge_input_change,
    judge_jump,
)
from pom.probing.late_probe import PROBE as LATE_PROBE
from pom.probing.late_probe import judge_late, late_job
from pom.probing.model_agreement import AIRCRAFT_PROBE, compare_aircraft, compare_controls
from pom.probing.scatter_probe import (
    DIFFERENCE,
    NOISE_PROBE,
    RecordScatter,
    judge_difference,
    judge_scatter,
    measure_scatter,
    noise_of_inputs,
)
from pom.result import PomResult, make_verdict_table
from pom.status import PASSED, UNPROBED, unprobed_remark
from pom.tolerances.bands import RowRemark
from pom.tolerances.channels import plain_id

STALL_TEST = "2.c.8"
STALLED = ("stall_warning", "initial_buffet", "stall")
"""Events of a stall from the first of which on an aeroplane is not linear in its inputs."""

Traces = Mapping[str, np.ndarray]
OwnFlight = Callable[[ReplayJob, Sequence[str]], tuple[Mapping[str, np.ndarray], str]]
"""Flight of a job that returns outputs (time,) by name, and why it failed or an empty text."""


_ON_WHEELS = "a wheel touches the ground in a part of the window"
_NO_CONTROL = "no control moves"
_NO_FLIGHT = "the reference is not a flight"
# The manifold pressure of the tutorial's engine hardly changes between 25 and 30 % of its lever.
_LEVERS_ONLY = "the power of an engine is not linear in its lever"


def probe_models(
    result: PomResult,
    models: Mapping[str, FmuModel],
    jobs: Mapping[str, ReplayJob],
    outputs: Mapping[str, Mapping[str, np.ndarray]],
    states: xr.Dataset,
    timeout: float,
    store: KeptFlights | None = None,
    own_flights: Mapping[str, OwnFlight] | None = None,
) -> dict[str, tuple[RowRemark, ...]]:
    """Return the remarks of the probes on every model that passes, by model.

    A model that does not pass proves nothing, so it is not flown again.

    Parameters
    ----------
    result : PomResult
    models, jobs, outputs : mapping by model
        The model, its job, and its outputs (time,) by name.
    states : Dataset (time)
        Of the flight.
    timeout, store
        As `pom.fmu.simulate.fly_job`.
    own_flights : mapping of str to callable, optional
        By model whose answer is that of its tables: the flight of a job by the tables.  Tables over
        flight condition and controls cannot hold a flight, so only size and time of the inputs are
        probed, where the difference of flight and model can show them.
    """
    found: dict[str, tuple[RowRemark, ...]] = {}
    own_flights = own_flights or {}
    # What depends on the flight alone is computed once for all models.
    flight = flight_traces(states, CHANNELS)
    touches_ground = bool(on_wheels(states).any())
    scatter = RecordScatter(traces_of(result.signals, "flight"))
    hidden = None
    if not set(SHOWN) <= set(result.case.show):
        # A case that shows few channels would leave the probes of the noise out.
        hidden = RecordScatter(flight_traces(states, (*SHOWN, "V")))
    for run, model in models.items():
        if result.status(run) not in PASSED or result.case.reference == "footprint":
            continue
        tables = tables_of(model)
        is_slow = result.case.drive.trim == "ground" or is_on_wheels(outputs[run])
        # wheels take a part of the forces, also at a high speed
        uncompared = _ON_WHEELS if is_slow or touches_ground else ""
        if result.case.reference != "flight":
            uncompared = _NO_FLIGHT
        own = own_flights.get(run)
        if own is not None and jobs[run].law is None:
            remarks = _probe_tables(
                result.case,
                jobs[run],
                outputs[run],
                flight,
                own,
                uncompared=uncompared,
                on_wheels=is_slow,
            )
        else:
            remarks = _probe_inputs(
                result.case,
                jobs[run],
                outputs[run],
                flight,
                # without the law of the case: the controls that it moved are inputs
                partial(fly_job, replace(model, law=None), timeout=timeout, store=store),
                uncompared=uncompared,
                on_wheels=is_slow,
            )
        if result.case.reference == "flight":
            remarks += measure_scatter(result.signals, run, scatter)
            if hidden:
                remarks = _measure_hidden(hidden, outputs[run], jobs[run].time, remarks)
        else:
            remarks += (unprobed_remark(NOISE_PROBE, _NO_FLIGHT),)
        if own is not None:
            remarks = noise_of_inputs(remarks)
        if tables is not None:
            remarks += compare_aircraft(result.case, tables, jobs[run])
            remarks += compare_controls(result.case, tables)
            if result.case.reference == "flight":
                remarks += compare_lift(tables, states)
        else:
            text = "the FMU holds no tables of this program"
            remarks += (*lift_not_checked(text), unprobed_remark(AIRCRAFT_PROBE, text))
        found[run] = remarks
    return found


def _probe_inputs(
    case: PomCase,
    job: ReplayJob,
    outputs: Traces,
    flight: Traces,
    fly: OwnFlight,
    *,
    uncompared: str,
    on_wheels: bool,
) -> tuple[RowRemark, ...]:
    """Return the remarks on further flights of any model with changed inputs.

    `uncompared` states why `flight` does not show size and time of the inputs.
    """
    judged = {criterion.channel for criterion in case.criteria if criterion.applies}
    # true and calibrated airspeed respond alike
    judged |= {"V"} if "V_cas" in judged else set()
    changed = changed_job(job, outputs)
    after, failure = fly(changed.job, [*SIZES])
    if failure:
        return _failure_remarks(SHARE_PROBE, failure, closed=job.law is not None)
    remarks = judge_input_change(
        job.time,
        outputs,
        after,
        judged,
        moved_at=changed.moved_at,
        on_wheels=on_wheels,
        linear_end=_linear_end(case),
        uncompared=_LEVERS_ONLY if changed.only_levers else "",
    )
    if any(item.kind == "not_driven" for item in remarks):
        # what the inputs do not drive needs no further word
        return remarks
    still = "" if changed.moved else _NO_CONTROL
    reason = still or (_ON_WHEELS if on_wheels else "")
    if reason:
        remarks += (unprobed_remark(JUMP_PROBE, reason),)
    else:
        near, failure = fly(changed_job(job, outputs, NEAR).job, [*SIZES])
        remarks += (
            _failure_remarks(JUMP_PROBE, failure, closed=job.law is not None)
            if failure
            else judge_jump(outputs, near, after)
        )
    reason = still or uncompared
    if job.pilot or job.law is not None:
        # the loop moves its control from the start on
        reason = reason or "a loop is closed around the model"
    if reason:
        remarks += (unprobed_remark(LATE_PROBE, reason),)
    else:
        late, failure = fly(late_job(job), [*SIZES])
        remarks += (
            _failure_remarks(LATE_PROBE, failure, closed=False)
            if failure
            else judge_late(job.time, outputs, late, changed.moved_at)
        )
    reason = still or uncompared
    if changed.only_levers:
        # gain and time of the inputs are those of surfaces, in which an answer is linear
        reason = reason or _LEVERS_ONLY
    if reason:
        return (*remarks, unprobed_remark(INPUTS_PROBE, reason))
    surfaces = case.drive.level == "recorded"
    return (
        *remarks,
        *compare_inputs(job.time, outputs, after, flight, surfaces=surfaces),
    )


def _linear_end(case: PomCase) -> float:
    """Return the instant from which on a stall is not linear in the inputs; else infinity. [s]"""
    if not plain_id(case.id).startswith(STALL_TEST):
        return inf
    return min((case.events[name] for name in STALLED if name in case.events), default=inf)


def _probe_tables(
    case: PomCase,
    job: ReplayJob,
    outputs: Traces,
    flight: Traces,
    fly: OwnFlight,
    *,
    uncompared: str = "",
    on_wheels: bool = False,
) -> tuple[RowRemark, ...]:
    """Return the remarks on a model that answers by its tables.

    They state whether the inputs have an effect, and size and time of the inputs.
    """
    changed = changed_job(job, outputs)
    after, failure = fly(changed.job, [*SIZES])
    if failure:
        return _failure_remarks(SHARE_PROBE, failure, closed=False)
    # tables without an effect of the controls hold no flight, and are not driven either
    remarks = judge_input_change(
        job.time,
        outputs,
        after,
        (),
        moved_at=changed.moved_at,
        on_wheels=on_wheels,
        uncompared="the answer is that of the tables",
    )
    if any(item.kind == "not_driven" for item in remarks):
        return remarks
    text = "driven by the inputs: the answer is that of the tables in the FMU"
    if uncompared:
        return (RowRemark("probe", text), unprobed_remark(INPUTS_PROBE, uncompared))
    most = largest_input_effect(job.time, outputs, flight)
    if most < LEAST_EFFECT:
        text += (
            f"; size and time of the inputs are not compared: flight and model differ by "
            f"{most:.2f} of the sizes of the probe, less than the {LEAST_EFFECT:g} that are named"
        )
        return (RowRemark("probe", text),)
    reason = _LEVERS_ONLY if changed.only_levers else ""
    if not changed.moved:
        reason = _NO_CONTROL
    if reason:
        return (RowRemark("probe", text), unprobed_remark(INPUTS_PROBE, reason))
    surfaces = case.drive.level == "recorded"
    compared = compare_inputs(job.time, outputs, after, flight, surfaces=surfaces)
    return (RowRemark("probe", text), *compared)


def _measure_hidden(
    scatter: RecordScatter,
    outputs: Mapping[str, np.ndarray],
    time: np.ndarray,
    known: tuple[RowRemark, ...],
) -> tuple[RowRemark, ...]:
    """Return the remarks with those on the noise of channels that a case does not show.

    A finding that is known is not repeated.  What the hidden channels show was not left out.
    """
    if any(item.kind == "not_driven" for item in known):
        return known
    if any(item.kind == "departure" and item.quantity == DIFFERENCE for item in known):
        return known
    found = judge_scatter(scatter, outputs)
    if all(item.kind != "not_driven" for item in found):
        found += judge_difference(time, scatter, outputs)
    made = {item.quantity for item in found if item.kind != UNPROBED}
    kept = []
    for item in known:
        if item.kind != UNPROBED or item.quantity not in made:
            kept.append(item)
    return (*kept, *(item for item in found if item.kind not in ("probe", UNPROBED)))


def is_on_wheels(outputs: Mapping[str, np.ndarray]) -> bool:
    """Return whether the aeroplane stands or rolls slowly in a part of the window."""
    return "V" in outputs and bool(np.nanmin(outputs["V"]) < SLOWEST)


def flight_traces(
    states: xr.Dataset, names: Collection[str] | None = None
) -> dict[str, np.ndarray]:
    """Return the channels of a flight that have a value per sample (time,), by default all. [SI]"""
    traces = {}
    for name, item in states.variables.items():
        is_wanted = name in states.data_vars if names is None else name in names
        if is_wanted and item.dims == ("time",) and item.dtype.kind == "f":
            traces[str(name)] = item.values.astype(float)
    return traces


def tables_of(model: FmuModel) -> SimModel | None:
    """Return the tables inside the FMU of a model; None for an FMU of another program."""
    try:
        return kept_model(model.fmu.path, model.fmu.sha256)
    except AeromatchError:
        return None


def _failure_remarks(probe: str, failure: str, *, closed: bool) -> tuple[RowRemark, ...]:
    """Return the remark on a probe that failed; `closed`: the aeroplane has a control law."""
    remark = unprobed_remark(probe, f"the flight with changed inputs failed: {failure}")
    # An unstable aeroplane may not fly without its law.
    return (remark if closed else replace(remark, kind="departure"),)


def with_run_remarks(result: PomResult, remarks: Mapping[str, tuple[RowRemark, ...]]) -> PomResult:
    """Return a result with further remarks on the rows of some models."""
    if not any(remarks.values()):
        return result
    rows = []
    for row in result.rows:
        rows.append({**row, "remarks": (*row["remarks"], *remarks.get(row["run"], ()))})
    return replace(result, verdict=make_verdict_table(rows))  # type: ignore[arg-type]
