"""Child process that runs one FMU: jobs come on stdin, replies leave on a private copy of stdout.

Run as a script, ``python worker.py MODEL.fmu FOLDER``; it imports nothing of this package, so that the child starts
fast and a foreign library cannot reach the parent.  What the FMU prints goes to stderr.

The loop sets the inputs so that the FMU sees what was recorded, linear between samples: exactly by input derivatives
where FMI 2.0 offers them, else by the value at the middle of the step, whose error is of second order.  Before outputs
are read the inputs of that instant are set, so a direct feed-through is not one step late.

An FMI 3.0 model with the arrays ``replay.n replay.t replay.u replay.y``, as `flightmech.write_fmu` makes it, takes the
whole record in one step, linear between samples without any approximation.
"""

from __future__ import annotations

import os
import pickle
import shutil
import sys
from collections import deque
from ctypes import POINTER, c_double, c_uint

import numpy as np

INTEGERS = ("Integer", "Enumeration", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64")


class Model:
    """An unpacked FMU and its description."""

    def __init__(self, path: str, folder: str):
        from fmpy import extract, read_model_description

        self.description = read_model_description(path, validate=False)
        self.folder = extract(path, folder)
        self.variables = {v.name: v for v in self.description.modelVariables}
        self.fmi3 = self.description.fmiVersion.startswith("3")
        self.messages: deque[str] = deque(maxlen=8)
        scalars = [v for v in self.description.modelVariables if not getattr(v, "dimensions", None)]
        self.inputs = [v for v in scalars if v.causality == "input"]
        self.outputs = [v for v in scalars if v.causality == "output"]
        self.takes_records = self.fmi3 and self._shape("replay.u") == len(self.inputs) and self._shape("replay.y") == len(self.outputs)

    def instance(self):
        """Return a new instance."""
        from fmpy import fmi2, fmi3

        arguments = {
            "guid": self.description.guid,
            "unzipDirectory": self.folder,
            "modelIdentifier": self.description.coSimulation.modelIdentifier,
            "instanceName": "model",
        }
        if self.fmi3:
            slave = fmi3.FMU3Slave(**arguments)
            slave.instantiate(loggingOn=True, logMessage=self._log3)
            return slave
        slave = fmi2.FMU2Slave(**arguments)
        callbacks = fmi2.fmi2CallbackFunctions()
        callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(self._log2)
        callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmi2.calloc)
        callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmi2.free)
        slave.instantiate(callbacks=callbacks, loggingOn=True)
        return slave

    def _shape(self, name: str) -> int:
        """Return the number of columns of an array with one row per sample of ``replay.n``; 0: there is none."""
        variable = self.variables.get(name)
        dimensions = getattr(variable, "dimensions", None) or []
        rows = dimensions[0].variable if len(dimensions) == 2 else None
        return (dimensions[1].start or 0) if rows is not None and rows.name == "replay.n" else 0

    def _log2(self, environment, name, status, category, message) -> None:
        if status > 0 and message:
            self.messages.append(message.decode("utf-8", "replace"))

    def _log3(self, environment, status, category, message) -> None:
        if status > 0 and message:
            self.messages.append(message.decode("utf-8", "replace"))


class Run:
    """One replay on one instance, the differences between FMI 2.0 and 3.0 in one place."""

    def __init__(self, model: Model, job: dict):
        self.fmi3, self.slave = model.fmi3, model.instance()
        self.time, self.job = np.asarray(job["time"], float), job
        self.inputs = [model.variables[name].valueReference for name in job["inputs"]]
        self.outputs = [model.variables[name].valueReference for name in job["outputs"]]
        self.values = np.column_stack([*job["inputs"].values()]) if job["inputs"] else np.zeros((len(self.time), 0))
        self.derivatives = bool(not model.fmi3 and model.description.coSimulation.canInterpolateInputs and self.inputs)
        self.parameters = [(model.variables[name], value) for name, value in job["parameters"].items()]

    def start(self) -> None:
        """Set parameters and first inputs and leave initialisation; time counts from zero."""
        duration = float(self.time[-1] - self.time[0])
        if not self.fmi3:
            self.slave.setupExperiment(startTime=0.0, stopTime=duration)
        for variable, value in self.parameters:
            self._set_parameter(variable, value)
        if self.fmi3:
            self.slave.enterInitializationMode(startTime=0.0, stopTime=duration)
        else:
            self.slave.enterInitializationMode()
        self._set(self.values[0])
        self.slave.exitInitializationMode()

    def step(self, k: int) -> None:
        """Advance from sample k to k + 1."""
        start, length = float(self.time[k] - self.time[0]), float(self.time[k + 1] - self.time[k])
        u0, u1 = self.values[k], self.values[k + 1]
        if self.derivatives:
            self._set(u0)
            self.slave.setRealInputDerivatives(self.inputs, [1] * len(self.inputs), ((u1 - u0) / length).tolist())
        else:
            self._set(0.5 * (u0 + u1))
        end = self.slave.doStep(start, length)
        if end and end[1]:
            raise RuntimeError("the FMU asked to end the simulation")
        self._set(u1)

    def read(self) -> list[float]:
        """Return the outputs."""
        return self.slave.getFloat64(self.outputs) if self.fmi3 else self.slave.getReal(self.outputs)

    def _set(self, values: np.ndarray) -> None:
        if self.inputs:
            (self.slave.setFloat64 if self.fmi3 else self.slave.setReal)(self.inputs, values.tolist())

    def _set_parameter(self, variable, value: float) -> None:
        reference = [variable.valueReference]
        if variable.type == "Boolean":
            self.slave.setBoolean(reference, [bool(value)])
        elif variable.type in INTEGERS:
            kind = "Int64" if variable.type == "Enumeration" else variable.type
            setter = getattr(self.slave, f"set{kind}") if self.fmi3 else self.slave.setInteger
            setter(reference, [round(value)])
        elif self.fmi3:
            getattr(self.slave, f"set{variable.type}")(reference, [value])
        else:
            self.slave.setReal(reference, [value])

    def close(self) -> None:
        """End the instance."""
        self.slave.terminate()
        self.slave.freeInstance()


class Record:
    """One replay in one step: the arrays of the FMU take the whole record."""

    def __init__(self, model: Model, job: dict):
        self.run, self.model = Run(model, job), model
        time = np.ascontiguousarray(self.run.time - self.run.time[0])
        u = np.tile([float(v.start) for v in model.inputs], (len(time), 1))
        place = {v.name: i for i, v in enumerate(model.inputs)}
        for name, values in job["inputs"].items():
            u[:, place[name]] = values
        slave = self.run.slave
        slave.enterConfigurationMode()
        slave.setUInt64([model.variables["replay.n"].valueReference], [len(time)])
        slave.exitConfigurationMode()
        self._array("fmi3SetFloat64", "replay.t", time)
        self._array("fmi3SetFloat64", "replay.u", u)
        self.duration = float(time[-1])

    def fly(self) -> None:
        """Make the step."""
        self.run.slave.doStep(0.0, self.duration)

    def read(self) -> np.ndarray:
        """Return the outputs (time, output) as far as the record was flown."""
        y = np.full((len(self.run.time), len(self.model.outputs)), np.nan)
        self._array("fmi3GetFloat64", "replay.y", y)
        names = [v.name for v in self.model.outputs]
        return y[:, [names.index(name) for name in self.run.job["outputs"]]]

    def _array(self, function: str, name: str, values: np.ndarray) -> None:
        reference = (c_uint * 1)(self.model.variables[name].valueReference)
        slave = self.run.slave
        getattr(slave, function)(slave.component, reference, 1, values.ctypes.data_as(POINTER(c_double)), values.size)


def fly_record(model: Model, job: dict) -> dict:
    """Return what `replay` returns, for a model that takes records."""
    found = np.full((len(job["time"]), len(job["outputs"])), np.nan)
    try:
        record = Record(model, job)
    except Exception as error:
        return {"outputs": found, "error": _text("instantiation", error, model)}
    place = "initialisation"
    try:
        record.run.start()
        place = "the replay"
        record.fly()
    except Exception as error:
        return {"outputs": record.read() if place == "the replay" else found, "error": _text(place, error, model)}
    found = record.read()
    record.run.close()
    return {"outputs": found, "error": ""}


def replay(model: Model, job: dict) -> dict:
    """Return ``outputs`` (time, output), NaN behind a failure, and ``error``, empty when all went well."""
    model.messages.clear()
    if model.takes_records and len(job["time"]) > 1:
        return fly_record(model, job)
    found = np.full((len(job["time"]), len(job["outputs"])), np.nan)
    try:
        run = Run(model, job)
    except Exception as error:
        return {"outputs": found, "error": _text("instantiation", error, model)}
    place = "initialisation"
    try:
        run.start()
        found[0] = run.read()
        for k in range(len(run.time) - 1):
            place = f"the step to t = {run.time[k + 1]:g} s"
            run.step(k)
            found[k + 1] = run.read()
    except Exception as error:
        return {"outputs": found, "error": _text(place, error, model)}
    run.close()
    return {"outputs": found, "error": ""}


def _text(place: str, error: Exception, model: Model) -> str:
    said = f"; the FMU says: {' | '.join(model.messages)}" if model.messages else ""
    return f"{place} failed: {str(error) or type(error).__name__}{said}"


def main(path: str, folder: str) -> None:
    """Answer jobs until stdin ends."""
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    try:
        model, fault = Model(path, folder), ""
    except Exception as error:
        model, fault = None, f"loading failed: {error}"
    while True:
        try:
            job = pickle.load(sys.stdin.buffer)
        except EOFError:
            break
        pickle.dump(replay(model, job) if model else {"outputs": None, "error": fault}, replies)
        replies.flush()
    shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main(*sys.argv[1:3])
