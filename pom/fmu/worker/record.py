"""A whole record in one step, for an FMU that takes arrays: linear between samples without any approximation."""

from __future__ import annotations

from ctypes import POINTER, c_double, c_uint

import numpy as np

from .cosimulation import set_parameters
from .model import Model


class Record:
    """One replay in one step."""

    def __init__(self, model: Model, job: dict):
        self.model, self.slave, self.job = model, model.open(), job
        time = np.asarray(job["time"], float)
        time = np.ascontiguousarray(time - time[0])
        u = np.tile([float(v.start) for v in model.inputs], (len(time), 1))
        place = {v.name: i for i, v in enumerate(model.inputs)}
        for name, values in job["inputs"].items():
            u[:, place[name]] = values
        self.slave.enterConfigurationMode()
        self.slave.setUInt64([model.variables["replay.n"].valueReference], [len(time)])
        self.slave.exitConfigurationMode()
        self._array("fmi3SetFloat64", "replay.t", time)
        self._array("fmi3SetFloat64", "replay.u", u)
        self.duration, self.first = float(time[-1]), u[0]

    def start(self) -> None:
        """Set parameters and leave initialisation."""
        set_parameters(self.slave, 3, [(self.model.variables[name], value) for name, value in self.job["parameters"].items()])
        self.slave.enterInitializationMode(startTime=0.0, stopTime=self.duration)
        self.slave.setFloat64([v.valueReference for v in self.model.inputs], self.first.tolist())
        self.slave.exitInitializationMode()

    def fly(self) -> None:
        """Make the step."""
        self.slave.doStep(0.0, self.duration)

    def read(self) -> np.ndarray:
        """Return the outputs (time, output) as far as the record was flown."""
        y = np.full((len(self.job["time"]), len(self.model.outputs)), np.nan)
        self._array("fmi3GetFloat64", "replay.y", y)
        names = [v.name for v in self.model.outputs]
        return y[:, [names.index(name) for name in self.job["outputs"]]]

    def close(self) -> None:
        """End the instance."""
        self.slave.terminate()
        self.slave.freeInstance()

    def _array(self, function: str, name: str, values: np.ndarray) -> None:
        reference = (c_uint * 1)(self.model.variables[name].valueReference)
        getattr(self.slave, function)(self.slave.component, reference, 1, values.ctypes.data_as(POINTER(c_double)), values.size)
