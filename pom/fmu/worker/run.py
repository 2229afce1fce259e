"""Replay of one job on one instance of an FMU, sample by sample or in one step.

The inputs of an instant are set before its outputs are read, so that a direct feed-through is not
one step late. The math pilot is called once per sample with the outputs of that sample. Its
correction is in force until the next sample.

A control law is a second FMU, coupled sample by sample. Over a step it has the outputs of the model
at the begin of the step. Its outputs at the end of the step drive the model over the next step. The
feedback is therefore one step late.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pom.cases.pilot import Pilot
from pom.fmu.worker.messages import Course, Ports, course_of
from pom.fmu.worker.model import UnpackedFmu
from pom.fmu.worker.stepping import ArrayRun, CoSimulation, Exchange


def replay_job(model: UnpackedFmu, job: dict[str, Any]) -> dict[str, Any]:
    """Fly a job; names, units and signs are those of the FMU.

    Parameters
    ----------
    model : Model
    job : dict
        ``time`` (time,), ``inputs`` (name to array), ``parameters`` (name to number), ``outputs``
        (names). With a math pilot ``pilot``: its ``loops`` and ``targets``, ``sense`` (channel to
        column of the outputs, factor and offset to SI) and ``move`` (control to column of the
        inputs and factor to SI). With a control law ``law``: its ``fmu``, its ``inputs`` (names)
        with their recorded ``values`` (time, input), ``start`` (input,) and ``parameters``;
        ``feedback``, rows (input, column of the outputs, factor, offset); ``outputs`` (names), and
        ``moves``, by control (column of the inputs, factor and offset to the model, factor and
        offset to SI).

    Returns
    -------
    dict
        ``outputs`` (time, output), NaN after a failure; ``moved``, the corrections of the pilot and
        the positions of the law (control to array, SI); ``error``, empty without a failure.
    """
    model.messages.clear()
    is_coupled = bool(job.get("pilot") or job.get("law"))
    if model.takes_records and len(job["time"]) > 1 and not is_coupled:
        return _replay_in_one_step(model, job)
    return _replay_by_samples(model, job)


def _replay_in_one_step(model: UnpackedFmu, job: dict[str, Any]) -> dict[str, Any]:
    nan = np.full((len(job["time"]), len(job["outputs"])), np.nan)
    # Any error of a foreign FMU is a failure of the job, not of the child process.
    try:
        record = ArrayRun(model, job)
    except Exception as error:
        return _make_reply(nan, _failure_text("instantiation", error, model))
    try:
        record.start()
    except Exception as error:
        return _make_reply(nan, _failure_text("initialisation", error, model))
    try:
        record.fly()
    except Exception as error:
        return _make_reply(record.read(), _failure_text("the replay", error, model))
    outputs = record.read()
    record.close()
    return _make_reply(outputs, "")


def _replay_by_samples(model: UnpackedFmu, job: dict[str, Any]) -> dict[str, Any]:
    time = np.asarray(job["time"], float)
    outputs = np.full((len(time), len(job["outputs"])), np.nan)
    try:
        run = _SampledRun(model, job, time)
    except Exception as error:
        return _make_reply(outputs, _failure_text("instantiation", error, model))
    error_text = ""
    try:
        run.fly(outputs)
    except Exception as error:
        error_text = _failure_text(run.phase, error, model)
    return _make_reply(outputs, error_text, run.pilot, run.law)


class _SampledRun:
    """An instance with its math pilot or control law, stepped sample by sample.

    Attributes
    ----------
    phase : str
        Present part of the run, for the text of a failure.
    """

    def __init__(self, model: UnpackedFmu, job: dict[str, Any], time: np.ndarray):
        self.model, self.job, self.time = model, job, time
        variables = [model.variables[name] for name in job["inputs"]]
        course = course_of(time, list(job["inputs"].values()), variables)
        self.pilot: _ScaledPilot | None = None
        if job.get("pilot"):
            self.pilot = _ScaledPilot(job, course)
        self.law: _LawFmu | None = None
        if job.get("law"):
            self.law = _LawFmu(job, course, folder=model.folder, most=model.most)
        self.stepper = _make_stepper(model, variables, course)
        output_variables = [model.variables[name] for name in job["outputs"]]
        self.outputs = Ports(self.stepper.instance, model.version, output_variables)
        self.phase = "initialisation"

    def fly(self, outputs: np.ndarray) -> None:
        """Fly all samples, and write the outputs (time, output) as far as there are any."""
        if self.law:
            self.law.start()
        parameters = self.job["parameters"].items()
        self.stepper.start([(self.model.variables[name], value) for name, value in parameters])
        outputs[0] = self.outputs.get()
        for k in range(len(self.time) - 1):
            self.phase = f"the step to t = {self.time[k + 1]:g} s"
            if self.pilot:
                self.pilot.act(k, outputs[k])
            self.stepper.advance(k)
            outputs[k + 1] = self.outputs.get()
            # The law steps after the model, with the outputs at the begin of the step.
            if self.law:
                self.law.act(k, outputs[k])
        if self.pilot:
            self.pilot.act(len(self.time) - 1, outputs[-1])
        self.phase = "the end"
        self.stepper.close()
        if self.law:
            self.law.close()


def _make_stepper(
    model: UnpackedFmu, variables: list[Any], course: Course
) -> Exchange | CoSimulation:
    """Return an instance of an FMU in the kind that it offers."""
    if model.exchange:
        return Exchange(model, variables, course)
    return CoSimulation(model, variables, course)


class _ScaledPilot:
    """The math pilot in SI, with controls and channels in the units of the FMU."""

    def __init__(self, job: dict[str, Any], course: Course):
        settings = job["pilot"]
        self.pilot = Pilot(settings["loops"], job["time"], settings["targets"])
        self.sense, self.move, self.course = settings["sense"], settings["move"], course

    def act(self, k: int, outputs: np.ndarray) -> None:
        """Set the corrections from the outputs at sample k."""
        channels = {}
        for name, (column, factor, offset) in self.sense.items():
            channels[name] = outputs[column] * factor + offset
        added = np.zeros_like(self.course.added)
        for name, correction in self.pilot.controls(k, channels).items():
            column, factor = self.move[name]
            added[column] = correction / factor
        # A new array: the integrator of model exchange recognises a change by its identity.
        self.course.added = added


class _LawFmu:
    """The FMU of a control law, in its own units, and the inputs of the model that it moves.

    Its inputs are constant from sample to sample, as a computer samples them. A law in model
    exchange has inputs that are linear between samples.
    """

    def __init__(self, job: dict[str, Any], course: Course, *, folder: str, most: int):
        self.settings = settings = job["law"]
        self.model = _unpack_once(settings, folder, most)
        variables = [self.model.variables[name] for name in settings["inputs"]]
        time = np.asarray(job["time"], float)
        values = np.asarray(settings["values"], float)
        if self.model.exchange:
            self.course = course_of(time, list(values.T), variables)
        else:
            self.course = Course(time - time[0], values, np.zeros(len(variables), bool))
        self.stepper = _make_stepper(self.model, variables, self.course)
        outputs = [self.model.variables[name] for name in settings["outputs"]]
        self.outputs = Ports(self.stepper.instance, self.model.version, outputs)
        self.model_course = course
        self.moved = {name: np.full(len(time), np.nan) for name in settings["moves"]}

    def start(self) -> None:
        """Initialise with the record at the first sample, and set the outputs of the law there."""
        self.course.added = np.asarray(self.settings["start"], float) - self.course.values[0]
        parameters = self.settings["parameters"].items()
        self.stepper.start([(self.model.variables[name], value) for name, value in parameters])
        self._move_controls(0)

    def act(self, k: int, outputs: np.ndarray) -> None:
        """Step from sample k to k + 1 with the outputs of the model at k, and move its controls."""
        # Recorded inputs are in the course; the columns of feedback inputs are zero there.
        added = np.zeros(self.course.values.shape[1])
        for position, column, factor, offset in self.settings["feedback"]:
            added[position] = factor * outputs[column] + offset
        self.course.added = added
        self.stepper.advance(k)
        self._move_controls(k + 1)

    def _move_controls(self, k: int) -> None:
        """Set the inputs of the model from the outputs of the law at sample k."""
        added = self.model_course.added.copy()
        moves = zip(self.settings["moves"].items(), self.outputs.get(), strict=True)
        # The law gives a position: the course of a moved control is zero.
        for (name, (column, factor, offset, to_si, origin)), value in moves:
            added[column] = factor * value + offset
            self.moved[name][k] = to_si * value + origin
        self.model_course.added = added

    def close(self) -> None:
        """End the instance."""
        self.stepper.close()


_LAWS: dict[str, UnpackedFmu] = {}


def _unpack_once(law: dict[str, Any], folder: str, most: int) -> UnpackedFmu:
    """Return the FMU of a control law, unpacked once per process next to the model."""
    key = f"{law['sha256']} {law['fmu']}"
    if key not in _LAWS:
        law_folder = Path(folder) / f"law{len(_LAWS)}"
        law_folder.mkdir()
        _LAWS[key] = UnpackedFmu(law["fmu"], str(law_folder), most)
    return _LAWS[key]


def _make_reply(
    outputs: np.ndarray,
    error: str,
    pilot: _ScaledPilot | None = None,
    law: _LawFmu | None = None,
) -> dict[str, Any]:
    controls: dict[str, np.ndarray] = {}
    if pilot:
        controls |= pilot.pilot.moved
    if law:
        controls |= law.moved
    return {"outputs": outputs, "moved": controls, "error": error}


def _failure_text(phase: str, error: Exception, model: UnpackedFmu) -> str:
    """Return why a part of a run failed, with the last messages of the FMU."""
    text = f"{phase} failed: {str(error) or type(error).__name__}"
    if model.messages:
        text += f"; the FMU reports: {' | '.join(model.messages)}"
    return text
