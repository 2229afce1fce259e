"""One replay on one instance, from the job of the parent to its reply.

Before outputs are read the inputs of that instant are set, so a direct feed-through is not one step
late.  The math pilot is called once per sample, with the outputs of that sample; what it adds stays
until the next.

A control law is a second FMU, coupled sample by sample: over a step it sees the outputs of the
model at its beginning, and what it gives at its end drives the model over the next step.  The
feedback is one step late.
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
        (names); with a math pilot ``pilot``: its ``loops`` and ``targets``, ``sense`` (channel to
        column of the outputs, factor and offset to SI) and ``move`` (control to column of the
        inputs and factor to SI).  With a control law ``law``: its ``fmu``, its ``inputs`` (names)
        with their recorded ``values`` (time, input), ``start`` (input,) and ``parameters``;
        ``feedback``, rows (input, column of the outputs, factor, offset); ``outputs`` (names), and
        ``moves``, by control (column of the inputs, factor and offset to the model, factor and
        offset to SI).

    Returns
    -------
    dict
        ``outputs`` (time, output), NaN behind a failure; ``moved``, what the pilot added and where
        the law moved (control to array, SI); ``error``, empty when all went well.
    """
    model.messages.clear()
    if model.takes_records and len(job["time"]) > 1 and not job.get("pilot") and not job.get("law"):
        return _in_one_step(model, job)
    return _step_by_step(model, job)


def _in_one_step(model: UnpackedFmu, job: dict[str, Any]) -> dict[str, Any]:
    nothing = np.full((len(job["time"]), len(job["outputs"])), np.nan)
    try:
        record = ArrayRun(model, job)
    except Exception as error:
        return _reply(nothing, _text("instantiation", error, model))
    place = "initialisation"
    try:
        record.start()
        place = "the replay"
        record.fly()
    except Exception as error:
        return _reply(
            record.read() if place == "the replay" else nothing, _text(place, error, model)
        )
    found = record.read()
    record.close()
    return _reply(found, "")


def _step_by_step(model: UnpackedFmu, job: dict[str, Any]) -> dict[str, Any]:
    time = np.asarray(job["time"], float)
    variables = [model.variables[name] for name in job["inputs"]]
    course = course_of(time, list(job["inputs"].values()), variables)
    pilot = _Hand(job, course) if job.get("pilot") else None
    found = np.full((len(time), len(job["outputs"])), np.nan)
    law = None
    try:
        law = _LawFmu(job, course, model.folder, model.most) if job.get("law") else None
        flown = (Exchange if model.exchange else CoSimulation)(model, variables, course)
        outputs = Ports(
            flown.instance, model.version, [model.variables[name] for name in job["outputs"]]
        )
    except Exception as error:
        return _reply(found, _text("instantiation", error, model))
    place = "initialisation"
    try:
        if law:
            law.start()
        flown.start([(model.variables[name], value) for name, value in job["parameters"].items()])
        found[0] = outputs.get()
        for k in range(len(time) - 1):
            place = f"the step to t = {time[k + 1]:g} s"
            if pilot:
                pilot.act(k, found[k])
            flown.advance(k)
            found[k + 1] = outputs.get()
            if law:
                law.act(k, found[k])
        if pilot:
            pilot.act(len(time) - 1, found[-1])
        place = "the end"
        flown.close()
        if law:
            law.close()
    except Exception as error:
        return _reply(found, _text(place, error, model), pilot, law)
    return _reply(found, "", pilot, law)


class _Hand:
    """The math pilot in SI, its controls and channels in the units of the FMU."""

    def __init__(self, job: dict[str, Any], course: Course):
        given = job["pilot"]
        self.pilot = Pilot(given["loops"], job["time"], given["targets"])
        self.sense, self.move, self.course = given["sense"], given["move"], course

    def act(self, k: int, outputs: np.ndarray) -> None:
        seen = {
            name: outputs[column] * factor + offset
            for name, (column, factor, offset) in self.sense.items()
        }
        added = np.zeros_like(self.course.added)
        for name, correction in self.pilot.controls(k, seen).items():
            column, factor = self.move[name]
            added[column] = correction / factor
        self.course.added = added


class _LawFmu:
    """The FMU of a control law, in its own units, and the inputs of the model that it moves.

    Everything it sees is held from sample to sample, as a computer samples it; a law in model
    exchange sees the record linear between.
    """

    def __init__(self, job: dict[str, Any], course: Course, folder: str, most: int):
        given = self.given = job["law"]
        self.model = _unpacked(given, folder, most)
        variables = [self.model.variables[name] for name in given["inputs"]]
        time, values = np.asarray(job["time"], float), np.asarray(given["values"], float)
        held = Course(time - time[0], values, np.zeros(len(variables), bool))
        self.course = course_of(time, list(values.T), variables) if self.model.exchange else held
        self.flown = (Exchange if self.model.exchange else CoSimulation)(
            self.model, variables, self.course
        )
        outputs = [self.model.variables[name] for name in given["outputs"]]
        self.outputs, self.driven = Ports(self.flown.instance, self.model.version, outputs), course
        self.moved = {name: np.full(len(time), np.nan) for name in given["moves"]}

    def start(self) -> None:
        """Initialise with the record at the first sample, and set what the law gives there."""
        self.course.added = np.asarray(self.given["start"], float) - self.course.values[0]
        self.flown.start(
            [
                (self.model.variables[name], value)
                for name, value in self.given["parameters"].items()
            ]
        )
        self._put(0)

    def act(self, k: int, outputs: np.ndarray) -> None:
        """Step from sample k to k + 1 with the outputs of the model at k, and set what the law
        gives in the end.
        """
        added = np.zeros(self.course.values.shape[1])
        for place, column, factor, offset in self.given["feedback"]:
            added[place] = factor * outputs[column] + offset
        self.course.added = added
        self.flown.advance(k)
        self._put(k + 1)

    def _put(self, k: int) -> None:
        added = self.driven.added.copy()
        for (name, (column, factor, offset, to_si, origin)), value in zip(
            self.given["moves"].items(), self.outputs.get(), strict=True
        ):
            added[column] = factor * value + offset
            self.moved[name][k] = to_si * value + origin
        self.driven.added = added

    def close(self) -> None:
        """End the instance."""
        self.flown.close()


_LAWS: dict[str, UnpackedFmu] = {}


def _unpacked(law: dict[str, Any], folder: str, most: int) -> UnpackedFmu:
    """Return the FMU of a control law, unpacked once per process next to the model."""
    key = f"{law['sha256']} {law['fmu']}"
    if key not in _LAWS:
        place = Path(folder) / f"law{len(_LAWS)}"
        place.mkdir()
        _LAWS[key] = UnpackedFmu(law["fmu"], str(place), most)
    return _LAWS[key]


def _reply(
    outputs: np.ndarray, error: str, pilot: _Hand | None = None, law: _LawFmu | None = None
) -> dict[str, Any]:
    moved = {**(pilot.pilot.moved if pilot else {}), **(law.moved if law else {})}
    return {"outputs": outputs, "moved": moved, "error": error}


def _text(place: str, error: Exception, model: UnpackedFmu) -> str:
    messages = f"; the FMU reports: {' | '.join(model.messages)}" if model.messages else ""
    return f"{place} failed: {str(error) or type(error).__name__}{messages}"
