"""Both probes of every model of a case that passes, as remarks of its rows."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np
import xarray as xr

from flightmech.errors import AeromatchError
from flightmech.simulation.compiler import SimModel
from pom.cases.case_file import SHOWN
from pom.cases.job import ReplayJob
from pom.fmu.models import FmuModel
from pom.fmu.run_cache import KeptFlights
from pom.fmu.simulate import fly_job
from pom.judging.beyond_the_bands import SLOWEST, kept_model
from pom.judging.signals import traces_of
from pom.probing.flight_consistency import CHANNELS, compare_inputs, compare_lift, on_wheels
from pom.probing.input_probe import SIZES, changed_job, judge_input_change
from pom.probing.model_agreement import compare_aircraft, compare_controls
from pom.probing.scatter_probe import (
    RecordScatter,
    judge_difference,
    judge_scatter,
    measure_scatter,
)
from pom.result import PomResult, make_verdict_table
from pom.status import PASSED
from pom.tolerances.bands import RowRemark


def probe_models(
    result: PomResult,
    models: Mapping[str, FmuModel],
    jobs: Mapping[str, ReplayJob],
    outputs: Mapping[str, Mapping[str, np.ndarray]],
    states: xr.Dataset,
    timeout: float,
    store: KeptFlights | None = None,
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
    """
    found: dict[str, tuple[RowRemark, ...]] = {}
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
        judged = {criterion.channel for criterion in result.case.criteria if criterion.applies}
        # true and calibrated airspeed respond alike
        judged |= {"V"} if "V_cas" in judged else set()
        changed = changed_job(jobs[run], outputs[run])
        # without the law of the case: the controls that it moved are inputs
        after, failure = fly_job(
            replace(model, law=None), changed.job, [*SIZES], timeout=timeout, store=store
        )
        if failure:
            remarks = _failure_remarks(failure, closed=jobs[run].law is not None)
        else:
            time = jobs[run].time
            is_slow = result.case.drive.trim == "ground" or is_on_wheels(outputs[run])
            remarks = judge_input_change(
                time,
                outputs[run],
                after,
                judged,
                moved=changed.moved,
                on_wheels=is_slow,
                only_levers=changed.only_levers,
            )
            # wheels take a part of the forces, also at a high speed
            is_compared = changed.moved and not (is_slow or touches_ground)
            # gain and time of the inputs are those of surfaces, in which an answer is linear
            is_compared = is_compared and not changed.only_levers
            is_compared = is_compared and all(item.kind == "probe" for item in remarks)
            if is_compared and result.case.reference == "flight":
                surfaces = result.case.drive.level == "recorded"
                remarks += compare_inputs(time, outputs[run], after, flight, surfaces=surfaces)
        if result.case.reference == "flight":
            remarks += measure_scatter(result.signals, run, scatter)
            if hidden:
                remarks += _measure_hidden(hidden, outputs[run], jobs[run].time, remarks)
        if tables is not None:
            remarks += compare_aircraft(result.case, tables, jobs[run])
            remarks += compare_controls(result.case, tables)
            if result.case.reference == "flight":
                remarks += compare_lift(tables, states)
        found[run] = remarks
    return found


def _measure_hidden(
    scatter: RecordScatter,
    outputs: Mapping[str, np.ndarray],
    time: np.ndarray,
    known: tuple[RowRemark, ...],
) -> tuple[RowRemark, ...]:
    """Return what the noise of channels shows that a case does not show, unless it is known."""
    if any(item.kind == "not_driven" or item.quantity == "difference" for item in known):
        return ()
    found = judge_scatter(scatter, outputs)
    if all(item.kind == "probe" for item in found):
        found = judge_difference(time, scatter, outputs)
    return tuple(item for item in found if item.kind != "probe")


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


def _failure_remarks(failure: str, *, closed: bool) -> tuple[RowRemark, ...]:
    """Return the remark on a probe that failed; `closed`: the aeroplane has a control law."""
    text = f"not probed, the flight with changed inputs failed: {failure}"
    # An unstable aeroplane may not fly without its law.
    kind = "probe" if closed else "departure"
    return (RowRemark(kind, text),)


def with_run_remarks(result: PomResult, remarks: Mapping[str, tuple[RowRemark, ...]]) -> PomResult:
    """Return a result with further remarks on the rows of some models."""
    if not any(remarks.values()):
        return result
    rows = []
    for row in result.rows:
        rows.append({**row, "remarks": (*row["remarks"], *remarks.get(row["run"], ()))})
    return replace(result, verdict=make_verdict_table(rows))  # type: ignore[arg-type]
