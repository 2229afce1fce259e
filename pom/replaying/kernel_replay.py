"""A case replayed by the kernel itself, many times with different parameters: what `replay` does
for any FMU, without one.
"""

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

STEP = 0.01  # [s] largest internal step, where the job has no mode.step
_AT_ONCE = (
    64  # runs whose outputs stand in memory together before they are thinned to the chosen channels
)


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
        Its inputs and parameters; those that the model does not have are passed over.
    choices : sequence of mapping of str to float
        Parameters that go before those of the job; every choice names the same ones.  Those that
        the model does not have are passed over.
    channels : sequence of str, optional
        Outputs to return; all without it.

    Returns
    -------
    outputs : dict of str to array (run, time)
        NaN throughout for a run that did not go to its end.
    failures : list of str
        Why a run did not; empty for one that did.

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
    names = (
        list(sim.outputs)
        if channels is None
        else [name for name in channels if name in sim.outputs]
    )
    known = set(sim.parameters)
    varied = [name for name in choices[0] if name in known]
    table = np.array([[choice[name] for name in varied] for choice in choices], float)
    flown = _piloted if len(job.pilot) > MOST_LOOPS else _batch
    parts = [
        flown(sim, job, varied, table[k : k + _AT_ONCE], names)
        for k in range(0, len(choices), _AT_ONCE)
    ]
    failures = [text for _, texts in parts for text in texts]
    values = np.concatenate([found for found, _ in parts])
    values[[bool(text) for text in failures]] = np.nan
    return {name: values[:, :, k] for k, name in enumerate(names)}, failures


def fly_once(
    sim: Any, job: ReplayJob, channels: Sequence[str]
) -> tuple[dict[str, np.ndarray], str]:
    """Replay a job once, as `replay_choices` does, without its tables of runs: for many models with one run
    each.

    Returns
    -------
    outputs : dict of str to array (time,)
        Of the channels that the model has; NaN throughout for a run that did not go to its end.
    failure : str
        Why it did not; empty for one that did.
    """
    names = [name for name in channels if name in sim.outputs]
    parameters = _parameters(sim, job, {})
    try:
        if job.pilot:
            found = _closed(sim, job, parameters, names)
        else:
            u = _input_table(sim, job, parameters)
            run = initialise_run(sim, parameters, u[0], float(job.time[0]))
            found, _ = run.record(job.time, u, False, output_indices(sim, names), False)
    except SimulationError as error:
        return {name: np.full(job.time.size, np.nan) for name in names}, str(error)
    return dict(zip(names, found.T, strict=True)), ""


def start_untrimmed(sim: Any, job: ReplayJob) -> None:
    """Start a job without its trim, to see whether the kernel takes its parameters and the first
    inputs.

    Raises
    ------
    SimulationError
        A drive, a mode or a value that the model does not take.
    """
    parameters = _parameters(sim, job, {})
    if "mode.trim" in parameters:
        parameters["mode.trim"] = 0.0
    initialise_run(sim, parameters, _input_table(sim, job, parameters)[0], float(job.time[0]))


def _batch(
    sim: Any, job: ReplayJob, varied: list[str], values: np.ndarray, names: list[str]
) -> tuple[np.ndarray, list[str]]:
    """Return outputs (run, time, name) and failures; `values` (run, varied) are those of the varied
    parameters.
    """
    parameters = _parameters(sim, job, {})
    loops = [
        ControlLoop(
            one.control,
            one.channel,
            one.gain,
            one.integral,
            one.limit,
            job.targets[one.channel],
            is_wrapped_angle(one.channel),
        )
        for one in job.pilot
    ]
    y, _, failures = fly_batch(
        sim,
        job.time,
        _input_table(sim, job, parameters),
        varied,
        values,
        parameters,
        names,
        loops=loops,
    )
    return y, failures


def _piloted(
    sim: Any, job: ReplayJob, varied: list[str], values: np.ndarray, names: list[str]
) -> tuple[np.ndarray, list[str]]:
    """Return the same as `_batch`, the loops of the math pilot closed sample by sample."""
    found = np.full((len(values), job.time.size, len(names)), np.nan)
    failures = [""] * len(values)
    for run, choice in enumerate(values.tolist()):
        try:
            found[run] = _closed(
                sim, job, _parameters(sim, job, dict(zip(varied, choice, strict=True))), names
            )
        except SimulationError as error:
            failures[run] = str(error)
    return found, failures


def _closed(sim: Any, job: ReplayJob, parameters: dict[str, float], names: list[str]) -> np.ndarray:
    """Return outputs (time, name) of one run; a correction is in force from its sample to the next,
    as in a replayed FMU.
    """
    u = _input_table(sim, job, parameters)
    pilot = Pilot(job.pilot, job.time, job.targets)
    chosen, seen = (
        output_indices(sim, names),
        dict(zip(pilot.channels, output_indices(sim, pilot.channels), strict=True)),
    )
    moved = [sim.inputs.index(name) for name in pilot.moved]
    run = Stepping(initialise_run(sim, parameters, u[0], float(job.time[0])))
    before, after = run.ends
    found = np.empty((job.time.size, len(names)))
    times, steps = job.time.tolist(), np.diff(job.time).tolist()
    for k, time in enumerate(times):
        y = run.outputs()
        found[k] = y[chosen]
        push = pilot.controls(k, {name: y.item(i) for name, i in seen.items()}).values()
        if k < len(steps):
            run.ends[:] = u[k : k + 2]
            for i, correction in zip(
                moved, push, strict=True
            ):  # one by one faster than by an index of all
                before[i] += correction
                after[i] += correction
            run.step(time, steps[k])
    return found


def _input_table(sim: Any, job: ReplayJob, parameters: Mapping[str, float]) -> np.ndarray:
    """Return the inputs (time, inputs): recorded ones, else the constant ones of the parameters,
    else their start values.
    """
    u = np.tile(constant_inputs(sim, parameters), (job.time.size, 1))
    for name, values in job.inputs.items():
        if name in sim.inputs:
            u[:, sim.inputs.index(name)] = values
    return u


def _parameters(sim: Any, job: ReplayJob, choice: Mapping[str, float]) -> dict[str, float]:
    return {
        "mode.step": STEP,
        **{name: value for name, value in job.parameters.items() if name in sim.parameters},
        **choice,
    }
