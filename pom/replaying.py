"""Replay of a case: recorded inputs through every model, its outputs against the flight."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import SchemaError
from flightmech.names import lookup

from .case import PomCase
from .channels import WRAPPED
from .child import child
from .drive import Job, configuration, job_of
from .flight import flight_states
from .fmus import Fmu, check, read_fmu
from .result import PomResult, verdict_table
from .tolerance import Outcome
from .verdict import bands, channels, judge, row, unjudged

# What the trim table shows: the state at the start, the controls, what the trim found and what it left.
STATE = ("V", "V_cas", "alpha", "beta", "gamma", "phi", "theta", "psi", "p", "q", "r", "h", "delta_e", "delta_a", "delta_r")
FOUND = ("trim.delta_e", "trim.delta_a", "trim.delta_r", "trim.thrust", "trim.throttle")
LEFT = ("trim.u_dot", "trim.v_dot", "trim.w_dot", "trim.p_dot", "trim.q_dot", "trim.r_dot")
OBSERVED = (*STATE, *(f"applied.{name}" for name in STATE if name.startswith("delta_")), *FOUND, *LEFT, "out_of_range")
SURFACES = ("trim.delta_e", "trim.delta_a", "trim.delta_r")
LARGEST_BIAS = np.radians(1.0)
"""A larger bias of a surface is remarked: what a longitudinal trim allows the elevator (2.c.5, 14 CFR 60 App. A)."""


def replay(case: PomCase, runs: Mapping[str, str | Path], path: Any = None, timeout: float = 60.0) -> PomResult:
    """Replay a case by FMUs, each in a child process, and judge it.

    Parameters
    ----------
    case : PomCase
        From `read_case`.
    runs : mapping of str to path
        Name of a model to its FMU, in the order of the report.
    path : Path of flighttest.reconstruct or Dataset (time), optional
        Reconstructed path of the record; without it the record is read and reconstructed.
    timeout : float
        Wall time allowed per model. [s]

    Returns
    -------
    PomResult
        A model that crashed, hung or refused has ``invalid`` rows and a text in ``failure``.

    Raises
    ------
    SchemaError
        A model lacks an input, output or parameter that the case needs, or declares another unit.
    OutOfRange
        The window is not inside the record, or an input holds a NaN.
    """
    fmus = {name: read_fmu(file) for name, file in runs.items()}
    states = flight_states(case, path)
    job = job_of(case, states)
    judged, shown = judged_channels(case), shown_channels(case, states)
    for fmu in fmus.values():
        inputs = _taken(job.inputs, fmu.inputs, job.needed_inputs)
        check(fmu, inputs, _taken(shown, fmu.outputs, judged), _taken(job.parameters, fmu.parameters, job.needed_parameters))
    found, failures = {}, {}
    for name, fmu in fmus.items():
        found[name], failures[name] = _fly(fmu, job, {*shown, *OBSERVED}, timeout)
    attrs = {f"model.{name}": f"{fmu.path.name}, FMI {fmu.version}, sha256 {fmu.sha256}" for name, fmu in fmus.items()}
    return assemble(case, states, job, found, failures, attrs)


def judged_channels(case: PomCase) -> list[str]:
    """Return the channels that the criteria of a case are computed from."""
    names = [name for c in case.criteria if c.applies and not unjudged(case, c) for name in channels(c)]
    return list(dict.fromkeys(names))


def shown_channels(case: PomCase, states: xr.Dataset) -> list[str]:
    """Return every channel of the result: judged, asked for, and the thrust of each engine."""
    engines = sorted(str(name) for name in states.data_vars if str(name).startswith("engine") and str(name).endswith(".thrust"))
    return list(dict.fromkeys([*judged_channels(case), *case.show, *engines]))


def _taken(given: Iterable[str], offered: Container[str], needed: Container[str]) -> list[str]:
    """Return the names that are needed, or given and offered."""
    return [name for name in given if name in offered or name in needed]


def _fly(fmu: Fmu, job: Job, wanted: Container[str], timeout: float) -> tuple[dict[str, np.ndarray], str]:
    outputs = [name for name in fmu.outputs if name in wanted]
    reply = child(fmu.path).run(
        job.time,
        {name: values for name, values in job.inputs.items() if name in fmu.inputs},
        {name: value for name, value in job.parameters.items() if name in fmu.parameters},
        outputs,
        timeout,
    )
    return dict(zip(outputs, reply.outputs.T, strict=True)), reply.error


def assemble(
    case: PomCase,
    states: xr.Dataset,
    job: Job,
    found: Mapping[str, Mapping[str, np.ndarray]],
    failures: Mapping[str, str],
    attrs: Mapping[str, str] | None = None,
) -> PomResult:
    """Return the result of a case from the outputs of its models.

    Parameters
    ----------
    found : mapping of model to mapping of output to array (time,)
    failures : mapping of model to text
        Empty texts for models that ran.
    attrs : mapping of str to str, optional
        Provenance, kept as attributes of the signals.
    """
    flight = {str(name): np.broadcast_to(item.values, job.time.size) for name, item in states.data_vars.items() if item.ndim < 2}
    rows = []
    for name, outputs in found.items():
        remark = _remark(outputs)
        for criterion in case.criteria:
            if failures.get(name) and criterion.applies:
                outcome = Outcome("invalid", note=failures[name])
            else:
                outcome = judge(case, criterion, job.time, flight, outputs)
            rows.append(row(name, criterion, outcome))
            rows[-1]["note"] = "; ".join(text for text in (rows[-1]["note"], remark) if text)
    return PomResult(
        case=case,
        conditions=dict(configuration(case, job)),
        signals=_signals(shown_channels(case, states), job.time, flight, found).assign_attrs(attrs or {}),
        tolerance=bands(case, job.time, flight),
        inputs=_inputs(job),
        trim=_trim(flight, found),
        verdict=verdict_table(rows),
        failure="; ".join(f"{name}: {text}" for name, text in failures.items() if text),
    )


def _remark(outputs: Mapping[str, np.ndarray]) -> str:
    """Return what a reader must know of a run beside its verdicts: trim beyond limits, tables left."""
    said = []
    for name in SURFACES:
        bias = float(outputs[name][0]) if name in outputs else 0.0
        if abs(bias) > LARGEST_BIAS:
            said.append(f"{name} {np.degrees(bias):+.2f} deg is beyond {np.degrees(LARGEST_BIAS):g} deg")
    steps = float(np.nanmax(outputs["out_of_range"])) if "out_of_range" in outputs and np.isfinite(outputs["out_of_range"]).any() else 0.0
    if steps:
        said.append(f"tables left in {steps:.0f} internal steps")
    return ", ".join(said)


def _signals(
    names: list[str], time: np.ndarray, flight: Mapping[str, np.ndarray], found: Mapping[str, Mapping[str, np.ndarray]]
) -> xr.Dataset:
    runs = {"flight": flight, **found}
    data = {}
    for name in names:
        traces = [np.asarray(run[name], float) if name in run else np.full(time.size, np.nan) for run in runs.values()]
        if name in WRAPPED:
            traces = [_beside(trace, traces[0]) for trace in traces]
        data[name] = (("run", "time"), np.stack(traces), {"units": lookup(name).units, "long_name": lookup(name).long_name})
    return xr.Dataset(data, coords={"run": list(runs), "time": time})


def _beside(angle: np.ndarray, flight: np.ndarray) -> np.ndarray:
    """Return a wrapped angle without jumps, starting less than half a turn from the flight."""
    if not np.isfinite(angle).all() or not np.isfinite(flight[0]):
        return angle
    smooth = np.unwrap(angle)
    return smooth - 2.0 * np.pi * np.round((smooth[0] - flight[0]) / (2.0 * np.pi))


def _inputs(job: Job) -> xr.Dataset:
    units = {name: lookup("thrust" if name.endswith("thrust_drive") else name).units for name in job.inputs}
    data = {name: ("time", values, {"units": units[name]}) for name, values in job.inputs.items()}
    return xr.Dataset(data, coords={"time": job.time})


def _trim(flight: Mapping[str, np.ndarray], found: Mapping[str, Mapping[str, np.ndarray]]) -> pd.DataFrame:
    """Return the first sample of flight and models; controls of a model are what it applied, bias included."""
    columns = {"flight": {name: float(flight[name][0]) for name in STATE if name in flight}}
    for run, outputs in found.items():
        values = {}
        for name in (*STATE, *FOUND, *LEFT):
            source = f"applied.{name}" if name.startswith("delta_") else name
            if source in outputs:
                values[name] = float(outputs[source][0])
        columns[run] = values
    table = pd.DataFrame(columns, index=pd.Index([*STATE, *FOUND, *LEFT], name="quantity"), dtype=float)
    return table.dropna(how="all")


def names_of_runs(models: tuple[str, ...]) -> dict[str, Path]:
    """Return the models of command-line words ``name=file.fmu``.

    Raises
    ------
    SchemaError
        Words without a name, with a name that came before, or ``flight``, which is taken; all of them.
    """
    runs: dict[str, Path] = {}
    problems = []
    for word in models:
        name, _, file = word.partition("=")
        if not name or not file:
            problems.append(f"{word!r}: write name=file.fmu, such as final=out/final.fmu")
        elif name in (*runs, "flight"):
            problems.append(f"{word!r}: the name {name!r} is taken; give every model its own")
        runs[name] = Path(file)
    if problems:
        raise SchemaError("--model", problems)
    return runs
