"""Co-simulation of FMI 1.0, 2.0 and 3.0: the FMU steps itself from sample to sample.

The inputs are set so that the FMU sees what was recorded, linear between samples: exactly by input derivatives where it takes
them (FMI 1.0 and 2.0), else by the value at the middle of the step, whose error is of second order.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .inputs import Course, Ports
from .model import Model


class CoSimulation:
    """One instance in co-simulation.

    Parameters
    ----------
    model : Model
    inputs : sequence
        Variables of the columns of `course`.
    course : Course
    """

    def __init__(self, model: Model, inputs: Sequence[Any], course: Course):
        self.model, self.course = model, course
        self.instance = model.open()
        self.inputs = Ports(self.instance, model.version, inputs)
        self.sloped = [i for i in range(len(inputs)) if course.continuous[i]]
        self.references = [inputs[i].valueReference for i in self.sloped]
        interpolates = model.version < 3 and model.description.coSimulation.canInterpolateInputs
        self.derivatives = bool(interpolates and self.sloped)

    def start(self, parameters: Sequence[tuple[Any, float]]) -> None:
        """Set parameters and first inputs and leave initialisation; time counts from zero."""
        duration = float(self.course.time[-1])
        if self.model.version == 2:
            self.instance.setupExperiment(startTime=0.0, stopTime=duration)
        set_parameters(self.instance, self.model.version, parameters)
        if self.model.version == 1:
            self.inputs.put(self.course.at(0))
            self.instance.initialize(tStart=0.0, stopTime=duration)
            return
        if self.model.version == 2:
            self.instance.enterInitializationMode()
        else:
            self.instance.enterInitializationMode(startTime=0.0, stopTime=duration)
        self.inputs.put(self.course.at(0))
        self.instance.exitInitializationMode()

    def advance(self, k: int) -> None:
        """Step from sample k to k + 1, whose inputs are set in the end.

        Raises
        ------
        RuntimeError
            The FMU requests the end, or a function of FMPy reports that a call failed.
        """
        t = self.course.time
        if self.derivatives:
            self.inputs.put(self.course.at(k))
            self._slopes(self.course.slope(k)[self.sloped].tolist())
        else:
            self.inputs.put(self.course.middle(k))
        end = self.instance.doStep(float(t[k]), float(t[k + 1] - t[k]))
        if end and end[1]:
            raise RuntimeError("the FMU asked to end the simulation")
        self.inputs.put(self.course.at(k + 1))

    def _slopes(self, slopes: list[float]) -> None:
        if self.model.version == 2:
            self.instance.setRealInputDerivatives(self.references, [1] * len(slopes), slopes)
            return
        from ctypes import c_double, c_int, c_uint

        n = len(slopes)  # FMPy 0.3 calls fmiInitializeSlave where it means fmiSetRealInputDerivatives
        arguments = (c_uint * n)(*self.references), n, (c_int * n)(*[1] * n), (c_double * n)(*slopes)
        self.instance._call("fmi1SetRealInputDerivatives", self.instance.component, *arguments)

    def close(self) -> None:
        """End the instance."""
        self.instance.terminate()
        self.instance.freeInstance()


def set_parameters(instance: Any, version: int, parameters: Sequence[tuple[Any, float]]) -> None:
    """Set variables to values before initialisation."""
    Ports(instance, version, [variable for variable, _ in parameters]).put([value for _, value in parameters])
