"""Replay of a case by the kernel without an FMU, many times with different parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from flightmech.errors import SchemaError, SimulationError
from flightmech.simulation.batch import MOST_LOOPS, ControlLoop, fly_batch
from flightmech.simulation.kernel import Stepping
from flightmech.simulation.run import constant_inputs, initialise_run, output_indices
from pom.cases.job import ReplayJob
from pom.cases.pilot import Pilot, is_wrapped_angle

STEP = 0.01  # [s] largest internal step of a job without mode.step
_AT_ONCE = 64  # runs in one batch; it limits the memory for their outputs


def replay_choices(
    sim: Any,
    job: ReplayJob,
    choices: Sequence[Mapping[str, float]] = ({},),
    channels: Sequence[str] | None = None,
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Replay a job once for every choice of parameters.

    Parameters
    ----------
    sim : SimModel
        From `flightmech.compile`.
    job : Job
        Its inputs and parameters; the replay ignores those that the model does not have.
    choices : sequence of mapping of str to float
        Parameters that replace those of the job; every choice has the same names.  The replay
        ignores those that the model does not have.
    channels : sequence of str, optional
        Outputs to return; all without it.

    Returns
    -------
    outputs : dict of str to array (run, time)
        NaN throughout for a run that failed.
    failures : list of str
        Why each run failed; empty for a complete run.

    Raises
    ------
    SchemaError
        The case has a control law.
    """
    if job.law is not None:
        raise SchemaError(
            "control law",
            ["its FMU is not flown by the kernel alone; diagnose a case without [control_law]"],
        )
    names = list(sim.outputs)
    if channels is not None:
        names = [name for name in channels if name in sim.outputs]
    available = set(sim.parameters)
    varied = [name for name in choices[0] if name in available]
    rows = []
    for choice in choices:
        rows.append([choice[name] for name in varied])
    table = np.array(rows, float)
    # The kernel handles few loops of a math pilot itself.
    fly = _fly_in_kernel
    if len(job.pilot) > MOST_LOOPS:
        fly = _fly_with_pilot
    outputs, failures = [], []
    for k in range(0, len(choices), _AT_ONCE):
        batch, texts = fly(sim, job, varied, values=table[k : k + _AT_ONCE], names=names)
        outputs.append(batch)
        failures += texts
    values = np.concatenate(outputs)
    values[[bool(text) for text in failures]] = np.nan
    return {name: values[:, :, k] for k, name in enumerate(names)}, failures


def fly_once(
    sim: Any, job: ReplayJob, channels: Sequence[str]
) -> tuple[dict[str, np.ndarray], str]:
    """Replay a job once, as `replay_choices`; for many models with one run each.

    Returns
    -------
    outputs : dict of str to array (time,)
        Of the channels that the model has; NaN throughout for a run that failed.
    failure : str
        Why the run failed; empty for a complete run.
    """
    names = [name for name in channels if name in sim.outputs]
    parameters = _run_parameters(sim, job, {})
    try:
        if job.pilot:
            outputs = _fly_sample_by_sample(sim, job, parameters, names)
        else:
            u = _input_table(sim, job, parameters)
            run = initialise_run(sim, parameters, u[0], float(job.time[0]))
            outputs, _ = run.record(job.time, u, False, output_indices(sim, names), False)
    except SimulationError as error:
        return {name: np.full(job.time.size, np.nan) for name in names}, str(error)
    return dict(zip(names, outputs.T, strict=True)), ""


def start_untrimmed(sim: Any, job: ReplayJob) -> None:
    """Start a job without its trim, to check its parameters and first inputs.

    Raises
    ------
    SimulationError
        The model rejects a drive, a mode or a value.
    """
    parameters = _run_parameters(sim, job, {})
    if "mode.trim" in parameters:
        parameters["mode.trim"] = 0.0
    initialise_run(sim, parameters, _input_table(sim, job, parameters)[0], float(job.time[0]))


def _fly_in_kernel(
    sim: Any, job: ReplayJob, varied: list[str], *, values: np.ndarray, names: list[str]
) -> tuple[np.ndarray, list[str]]:
    """Return outputs (run, time, name) and failures; values (run, varied)."""
    parameters = _run_parameters(sim, job, {})
    loops = []
    for loop in job.pilot:
        loops.append(
            ControlLoop(
                input=loop.control,
                output=loop.channel,
                gain=loop.gain,
                integral=loop.integral,
                limit=loop.limit,
                target=job.targets[loop.channel],
                turns=is_wrapped_angle(loop.channel),
            )
        )
    y, _, failures = fly_batch(
        sim,
        job.time,
        u=_input_table(sim, job, parameters),
        varied=varied,
        values=values,
        constant=parameters,
        outputs=names,
        loops=loops,
    )
    return y, failures


def _fly_with_pilot(
    sim: Any, job: ReplayJob, varied: list[str], *, values: np.ndarray, names: list[str]
) -> tuple[np.ndarray, list[str]]:
    """Return the same as `_fly_in_kernel`; the loops are closed sample by sample."""
    outputs = np.full((len(values), job.time.size, len(names)), np.nan)
    failures = [""] * len(values)
    for run, row in enumerate(values.tolist()):
        choice = dict(zip(varied, row, strict=True))
        try:
            parameters = _run_parameters(sim, job, choice)
            outputs[run] = _fly_sample_by_sample(sim, job, parameters, names)
        except SimulationError as error:
            failures[run] = str(error)
    return outputs, failures


def _fly_sample_by_sample(
    sim: Any, job: ReplayJob, parameters: dict[str, float], names: list[str]
) -> np.ndarray:
    """Return outputs (time, name) of one run with a math pilot.

    A correction is in force from its sample to the next, as in a replayed FMU.
    """
    u = _input_table(sim, job, parameters)
    pilot = Pilot(job.pilot, job.time, job.targets)
    # Indices of the requested outputs, of the channels of the loops, and of the moved inputs.
    recorded = output_indices(sim, names)
    sensed = dict(zip(pilot.channels, output_indices(sim, pilot.channels), strict=True))
    moved_inputs = [sim.inputs.index(name) for name in pilot.moved]
    run = Stepping(initialise_run(sim, parameters, u[0], float(job.time[0])))
    before, after = run.ends  # inputs at both ends of a step
    outputs = np.empty((job.time.size, len(names)))
    times, steps = job.time.tolist(), np.diff(job.time).tolist()
    for k, time in enumerate(times):
        y = run.outputs()
        outputs[k] = y[recorded]
        # The corrections depend on the outputs at the sample, not on the next ones.
        corrections = pilot.controls(k, {name: y.item(i) for name, i in sensed.items()}).values()
        if k >= len(steps):
            continue
        run.ends[:] = u[k : k + 2]
        # A loop is faster than an index array for so few inputs.
        for i, correction in zip(moved_inputs, corrections, strict=True):
            before[i] += correction
            after[i] += correction
        run.step(time, steps[k])
    return outputs


def _input_table(sim: Any, job: ReplayJob, parameters: Mapping[str, float]) -> np.ndarray:
    """Return the inputs (time, input): recorded, else constants of the parameters or defaults."""
    u = np.tile(constant_inputs(sim, parameters), (job.time.size, 1))
    for name, values in job.inputs.items():
        if name in sim.inputs:
            u[:, sim.inputs.index(name)] = values
    return u


def _run_parameters(sim: Any, job: ReplayJob, choice: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters of a run; the choice replaces those of the job."""
    available = {name: value for name, value in job.parameters.items() if name in sim.parameters}
    return {"mode.step": STEP, **available, **choice}
