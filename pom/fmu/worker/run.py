"""One replay on one instance, from the job of the parent to its reply.

Before outputs are read the inputs of that instant are set, so a direct feed-through is not one step late.  The math pilot is called
once per sample, with the outputs of that sample; what it adds stays until the next.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pom.cases.pilot import Pilot

from .cosimulation import CoSimulation
from .exchange import Exchange
from .inputs import Course, Ports, course_of
from .model import Model
from .record import Record


def replay(model: Model, job: dict[str, Any]) -> dict[str, Any]:
    """Fly a job; names, units and signs are those of the FMU.

    Parameters
    ----------
    model : Model
    job : dict
        ``time`` (time,), ``inputs`` (name to array), ``parameters`` (name to number), ``outputs`` (names); with a math pilot ``pilot``:
        its ``loops`` and ``targets``, ``sense`` (channel to column of the outputs, factor and offset to SI) and ``move`` (control to
        column of the inputs and factor to SI).

    Returns
    -------
    dict
        ``outputs`` (time, output), NaN behind a failure; ``moved``, what the pilot added (control to array, SI); ``error``, empty when
        all went well.
    """
    model.messages.clear()
    if model.takes_records and len(job["time"]) > 1 and not job.get("pilot"):
        return _in_one_step(model, job)
    return _step_by_step(model, job)


def _in_one_step(model: Model, job: dict[str, Any]) -> dict[str, Any]:
    nothing = np.full((len(job["time"]), len(job["outputs"])), np.nan)
    try:
        record = Record(model, job)
    except Exception as error:
        return _reply(nothing, _text("instantiation", error, model))
    place = "initialisation"
    try:
        record.start()
        place = "the replay"
        record.fly()
    except Exception as error:
        return _reply(record.read() if place == "the replay" else nothing, _text(place, error, model))
    found = record.read()
    record.close()
    return _reply(found, "")


def _step_by_step(model: Model, job: dict[str, Any]) -> dict[str, Any]:
    time = np.asarray(job["time"], float)
    variables = [model.variables[name] for name in job["inputs"]]
    course = course_of(time, list(job["inputs"].values()), variables)
    pilot = _Hand(job, course) if job.get("pilot") else None
    found = np.full((len(time), len(job["outputs"])), np.nan)
    try:
        flown = (Exchange if model.exchange else CoSimulation)(model, variables, course)
        outputs = Ports(flown.instance, model.version, [model.variables[name] for name in job["outputs"]])
    except Exception as error:
        return _reply(found, _text("instantiation", error, model))
    place = "initialisation"
    try:
        flown.start([(model.variables[name], value) for name, value in job["parameters"].items()])
        found[0] = outputs.get()
        for k in range(len(time) - 1):
            place = f"the step to t = {time[k + 1]:g} s"
            if pilot:
                pilot.act(k, found[k])
            flown.advance(k)
            found[k + 1] = outputs.get()
        if pilot:
            pilot.act(len(time) - 1, found[-1])
        place = "the end"
        flown.close()
    except Exception as error:
        return _reply(found, _text(place, error, model), pilot)
    return _reply(found, "", pilot)


class _Hand:
    """The math pilot in SI, its controls and channels in the units of the FMU."""

    def __init__(self, job: dict[str, Any], course: Course):
        given = job["pilot"]
        self.pilot = Pilot(given["loops"], job["time"], given["targets"])
        self.sense, self.move, self.course = given["sense"], given["move"], course

    def act(self, k: int, outputs: np.ndarray) -> None:
        seen = {name: outputs[column] * factor + offset for name, (column, factor, offset) in self.sense.items()}
        added = np.zeros_like(self.course.added)
        for name, correction in self.pilot.controls(k, seen).items():
            column, factor = self.move[name]
            added[column] = correction / factor
        self.course.added = added


def _reply(outputs: np.ndarray, error: str, pilot: _Hand | None = None) -> dict[str, Any]:
    return {"outputs": outputs, "moved": pilot.pilot.moved if pilot else {}, "error": error}


def _text(place: str, error: Exception, model: Model) -> str:
    messages = f"; the FMU reports: {' | '.join(model.messages)}" if model.messages else ""
    return f"{place} failed: {str(error) or type(error).__name__}{messages}"
