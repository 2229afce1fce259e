"""Run of one job by one FMU, with conversion between canonical names in SI and its variables."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict
from functools import cache
from importlib.metadata import version
from pathlib import Path
from platform import machine
from typing import Any

import numpy as np

from flightmech.errors import OutOfRange, SchemaError
from flightmech.names import WRAPPED
from flightmech.support.input_files import file_sha256
from flightmech.support.kept_stages.content_hashes import content_hash
from pom.cases.job import ReplayJob, is_recorded
from pom.fmu.description import check_interface
from pom.fmu.models import FmuModel
from pom.fmu.process import hire_worker
from pom.fmu.run_cache import FileState, KeptFlights
from pom.fmu.variable_map import Fmu, Links
from pom.fmu.worker.messages import list_moved_controls

Outputs = dict[str, np.ndarray]


def fly_job(
    model: FmuModel,
    job: ReplayJob,
    wanted: Collection[str],
    timeout: float,
    store: KeptFlights | None = None,
) -> tuple[Outputs, str]:
    """Fly a job by a model in its child process.

    Parameters
    ----------
    model : Model
    job : Job
    wanted : collection of str
        Canonical names of outputs; those that the model has are returned.
    timeout : float
        Wall time allowed. [s]
    store : KeptFlights, optional
        Store of flights; a stored flight is not flown again.

    Returns
    -------
    outputs : dict of str to array (time,)
        Outputs by canonical name, and the controls that the math pilot or the control law moves;
        NaN after the end of a failed run. [SI]
    failure : str
        Why the run failed; empty without a failure.
    """
    # The math pilot reads its targets, and the control law its feedback.
    needed = {*wanted, *job.targets, *feedback_outputs(model)}
    outputs = [name for name in model.links.outputs if name in needed]
    time = _communication_points(model.fmu, job.time)
    if model.law is not None:
        time = _common_points(model, model.law, time)
    task = _make_task(model, job, outputs, time=time)
    key, columns, failure = "", None, ""
    if store:
        key = content_hash(_program_text(), model.fmu.sha256, task)
        columns = store.read(key, (len(time), len(outputs) + len(list_moved_controls(task))))
    if columns is None:
        columns, failure = _run_worker(model, task, timeout)
        if store and not failure:
            store.write(key, columns)
    return _read_columns(model, job, outputs, time=time, task=task, columns=columns), failure


def _run_worker(model: FmuModel, task: Mapping[str, Any], timeout: float) -> tuple[np.ndarray, str]:
    """Return the columns of a run (time, output and moved control), and why it failed."""
    fmus = [model.fmu]
    if model.law is not None:
        fmus.append(model.law.fmu)
    before = [_state_if_unchanged(fmu) for fmu in fmus]
    with hire_worker(model.fmu.path) as child:
        reply = child.run(task, timeout, any(fmu.once for fmu in fmus))
    columns = np.column_stack([reply.outputs, *_moved_columns(task, reply.moved)])
    failure = reply.error
    # If a file changed, the run may belong to neither the read file nor the present one.
    for fmu, state in zip(fmus, before, strict=True):
        if state is None or _file_state(fmu) != state:
            columns = np.full_like(columns, np.nan)
            failure = f"{fmu.path.name} changed after it was read; run the batch again"
    return columns, failure


def _state_if_unchanged(fmu: Fmu) -> FileState | None:
    """Return the state of the file of an FMU; None if it is not the file that was read.

    On another machine of a cluster the states differ, and the hash decides.
    """
    state = _file_state(fmu)
    if state is None or state == fmu.state:
        return state
    if file_sha256(fmu.path) != fmu.sha256:
        return None
    return state


def _file_state(fmu: Fmu) -> FileState | None:
    """Return the state of the file of an FMU; None if it cannot be read."""
    try:
        return FileState.of(fmu.path)
    except OSError:
        return None


def _communication_points(fmu: Fmu, time: np.ndarray) -> np.ndarray:
    """Return the communication points: the samples, or even steps if the FMU needs them. [s]"""
    if not fmu.even:
        return time
    step = fmu.step or float(np.median(np.diff(time)))
    # The last step may end after the last sample, but a step of rounding errors is not added.
    count = int(np.ceil((time[-1] - time[0]) / step - 1e-6))
    return time[0] + step * np.arange(count + 1)


def feedback_outputs(model: FmuModel) -> list[str]:
    """Return the outputs of a model that its control law reads, by canonical name."""
    if model.law is None:
        return []
    return [name for name in seen_by(model.law) if not is_recorded(name)]


def seen_by(law: FmuModel) -> list[str]:
    """Return the inputs of a control law by canonical name, without those that its table fixes."""
    names = []
    for name, link in law.links.inputs.items():
        if link.variable not in law.links.fixed:
            names.append(name)
    return names


def check_law(model: FmuModel, job: ReplayJob) -> None:
    """Check that a control law, its model and the record fit together.

    Raises
    ------
    SchemaError
        With every name that one of them lacks and every unit that does not fit.
    OutOfRange
        An input of the law has no value in the record.
    """
    law, drive = model.law, job.law
    if law is None or drive is None:
        return
    names = seen_by(law)
    check_interface(law.fmu, law.links, names, drive.moves, ())
    problems = []
    for name in names:
        if is_recorded(name) and name not in drive.recorded:
            problems.append(
                f"input {name}: the record has no such channel; map it, or hold it by [conditions]"
            )
        elif not is_recorded(name) and name not in model.links.outputs:
            problems.append(
                f"input {name}: the model {model.fmu.path.name} has no such output, and it "
                f"is not a control that is recorded"
            )
        elif not is_recorded(name) and not np.isfinite(drive.start.get(name, np.nan)):
            problems.append(
                f"input {name}: no value at the first sample, with which the law starts; map "
                f"the channel"
            )
    if problems:
        raise SchemaError(f"control law {law.fmu.path}", problems)
    for name in names:
        if not is_recorded(name):
            continue
        bad = ~np.isfinite(drive.recorded[name])
        if bad.any():
            raise OutOfRange(
                f"control law: input {name} has no value in {int(bad.sum())} samples; repair "
                f"the record or move the window",
                bad,
            )


def _common_points(model: FmuModel, law: FmuModel, time: np.ndarray) -> np.ndarray:
    """Return the communication points of a model and its control law. [s]"""
    points = _communication_points(law.fmu, time)
    is_equal = len(points) == len(time) and np.allclose(points, time, atol=1e-9)
    if model.fmu.even and not is_equal:
        text = (
            f"it takes steps of {law.fmu.step:g} s only, the model {model.fmu.path.name} "
            f"others; export one of them with variable steps"
        )
        raise SchemaError(f"control law {law.fmu.path}", [text])
    return points


def _make_law_task(
    model: FmuModel, job: ReplayJob, outputs: list[str], inputs: list[str], at_points: Callable
) -> dict[str, Any]:
    """Return the control law as the worker reads it; all values in the units of the FMUs."""
    law, drive = model.law, job.law
    assert law is not None
    assert drive is not None
    names, links = seen_by(law), law.links
    # A fixed variable is an input with a constant, or a parameter.
    fixed: dict[str, float] = {}
    parameters: dict[str, float] = {}
    for name, value in links.fixed.items():
        if name in law.fmu.inputs:
            fixed[name] = value
        else:
            parameters[name] = value
    count = len(at_points(job.time))
    columns, start, feedback = [], [], []
    for i, name in enumerate(names):
        link = links.inputs[name]
        if is_recorded(name):
            columns.append(link.to_fmu(at_points(drive.recorded[name])))
            start.append(link.to_fmu(drive.recorded[name][0]))
            continue
        # The worker overwrites the column of a feedback input with the output of the model.
        columns.append(np.zeros(count))
        start.append(link.to_fmu(drive.start[name]))
        scale, offset = _unit_conversion(model.links.outputs[name], link)
        feedback.append((i, outputs.index(name), scale, offset))
    columns += [np.full(count, value) for value in fixed.values()]
    values = np.zeros((count, 0))
    if columns:
        values = np.column_stack(columns)
    # By moved control: from the unit of the law to that of the model, and to SI.
    moves = {}
    for name in drive.moves:
        source, target = links.outputs[name], model.links.inputs[name]
        scale, offset = _unit_conversion(source, target)
        column = inputs.index(target.variable)
        moves[name] = (column, scale, offset, source.factor, source.offset)
    return {
        "fmu": str(law.fmu.path),
        "sha256": law.fmu.sha256,
        "inputs": [*(links.inputs[name].variable for name in names), *fixed],
        "values": values,
        "start": [*map(float, start), *fixed.values()],
        "parameters": parameters,
        "feedback": feedback,
        "outputs": [links.outputs[name].variable for name in drive.moves],
        "moves": moves,
    }


def _unit_conversion(source: Any, target: Any) -> tuple[float, float]:
    """Return scale and offset from the unit of one variable to that of another, by way of SI."""
    return source.factor / target.factor, (source.offset - target.offset) / target.factor


def _make_task(
    model: FmuModel, job: ReplayJob, outputs: list[str], *, time: np.ndarray
) -> dict[str, Any]:
    """Return the job as the worker reads it, with names, units and signs of the FMU."""
    links = model.links

    def at_points(values: np.ndarray) -> np.ndarray:
        if time is job.time:
            return values
        return np.interp(time, job.time, values)

    inputs, parameters = {}, {}
    for name, values in job.inputs.items():
        if name in links.inputs:
            inputs[links.inputs[name].variable] = links.inputs[name].to_fmu(at_points(values))
    for name, value in job.parameters.items():
        if name in links.parameters:
            parameters[links.parameters[name].variable] = links.parameters[name].to_fmu(value)
    # A fixed variable is an input with a constant, or a parameter.
    for name, value in links.fixed.items():
        if name in model.fmu.inputs:
            inputs[name] = np.full(len(time), value)
        else:
            parameters[name] = value
    task = {
        "time": time,
        "inputs": inputs,
        "parameters": parameters,
        "outputs": [links.outputs[name].variable for name in outputs],
    }
    if model.law is not None and job.law is not None:
        task["law"] = _make_law_task(model, job, outputs, inputs=list(inputs), at_points=at_points)
    if job.pilot:
        targets = {name: at_points(values) for name, values in job.targets.items()}
        loops = _make_pilot_task(links, job, outputs, inputs=list(inputs))
        task["pilot"] = {"targets": targets, **loops}
    return task


def _make_pilot_task(
    links: Links, job: ReplayJob, outputs: list[str], *, inputs: list[str]
) -> dict[str, Any]:
    """Return the loops of the math pilot.

    ``sense`` holds column, factor and offset to SI of what they read, ``move`` column and factor
    to SI of what they move.
    """
    sense, move = {}, {}
    for name in job.targets:
        link = links.outputs[name]
        sense[name] = (outputs.index(name), link.factor, link.offset)
    for loop in job.pilot:
        link = links.inputs[loop.control]
        move[loop.control] = (inputs.index(link.variable), link.factor)
    return {"loops": [asdict(loop) for loop in job.pilot], "sense": sense, "move": move}


def _moved_columns(task: Mapping[str, Any], moved: Mapping[str, np.ndarray]) -> list[np.ndarray]:
    """Return the corrections of the moved controls; NaN for a control without any."""
    nan = np.full(len(task["time"]), np.nan)
    return [moved.get(name, nan) for name in list_moved_controls(task)]


def _read_columns(
    model: FmuModel,
    job: ReplayJob,
    outputs: list[str],
    *,
    time: np.ndarray,
    task: Mapping[str, Any],
    columns: np.ndarray,
) -> Outputs:
    """Return the columns of a run at the samples of the job, by canonical name and in SI."""
    traces = {}
    is_resampled = len(time) != len(job.time) or not np.array_equal(time, job.time)
    for i, name in enumerate(outputs):
        traces[name] = model.links.outputs[name].to_canonical(columns[:, i])
        if is_resampled:
            traces[name] = _at_samples(name, traces[name], time, samples=job.time)
    # A correction is in force from its communication point to the next one.
    last_point = np.clip(np.searchsorted(time, job.time + 1e-9, side="right") - 1, 0, len(time) - 1)
    for i, name in enumerate(list_moved_controls(task)):
        traces[name] = job.inputs[name] + columns[last_point, len(outputs) + i]
    return traces


def _at_samples(
    name: str, values: np.ndarray, time: np.ndarray, *, samples: np.ndarray
) -> np.ndarray:
    """Return an output at samples between the steps of its FMU, by linear interpolation."""
    if name in WRAPPED:
        # Remove jumps of angles by a full turn, and keep the gaps.
        finite = np.isfinite(values)
        values = np.where(finite, np.unwrap(np.where(finite, values, 0.0)), np.nan)
    return np.interp(samples, time, values)


@cache
def _program_text() -> str:
    """Return the program of a run: hash of its modules, version of FMPy, and kind of machine."""
    here = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for file in [here / "cases" / "pilot.py", *sorted((here / "fmu" / "worker").glob("*.py"))]:
        digest.update(file.read_bytes())
    return f"{digest.hexdigest()} {version('fmpy')} {sys.platform} {machine()}"
