"""Model exchange of FMI 1.0, 2.0 and 3.0: FMPy's CVode integrates the states of the FMU from sample
to sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from ctypes import POINTER, c_double, c_uint
from typing import Any

import numpy as np

from pom.fmu.worker.messages import Course, Ports
from pom.fmu.worker.model import UnpackedFmu


class CoSimulation:
    """One instance in co-simulation.

    Parameters
    ----------
    model : Model
    inputs : sequence
        Variables of the columns of `course`.
    course : Course
    """

    def __init__(self, model: UnpackedFmu, inputs: Sequence[Any], course: Course):
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

        n = len(
            slopes
        )  # FMPy 0.3 calls fmiInitializeSlave where it means fmiSetRealInputDerivatives
        arguments = (
            (c_uint * n)(*self.references),
            n,
            (c_int * n)(*[1] * n),
            (c_double * n)(*slopes),
        )
        self.instance._call("fmi1SetRealInputDerivatives", self.instance.component, *arguments)

    def close(self) -> None:
        """End the instance."""
        self.instance.terminate()
        self.instance.freeInstance()


def set_parameters(instance: Any, version: int, parameters: Sequence[tuple[Any, float]]) -> None:
    """Set variables to values before initialisation."""
    Ports(instance, version, [variable for variable, _ in parameters]).put(
        [value for _, value in parameters]
    )


TOLERANCE = 1e-8
"""Relative tolerance of the integration: far below any tolerance of a test, and below the default of FMPy, 1e-5."""
NEAR = 1e-9
"""Instants of samples and events less apart than this are one: CVode refuses to integrate between times that differ by rounding. [s]"""


class Exchange:
    """One instance in model exchange; parameters as `CoSimulation`.

    FMPy's own loop applies inputs at the ends of steps only: its right-hand side never sees them
    change.  Here the clock of the solver sets them too.  No step is longer than a sample, so that a
    short input cannot be stepped over.
    """

    def __init__(self, model: UnpackedFmu, inputs: Sequence[Any], course: Course):
        self.model, self.course = model, course
        self.instance = model.open()
        self.inputs = Ports(self.instance, model.version, inputs)
        self.places = np.flatnonzero(course.continuous).tolist()
        self.continuous = Ports(self.instance, model.version, [inputs[i] for i in self.places])
        self.time, self.next_event = 0.0, np.inf
        self.solver: Any = None
        self.added = course.added

    def start(self, parameters: Sequence[tuple[Any, float]]) -> None:
        """Set parameters and first inputs and leave initialisation; time counts from zero."""
        duration = float(self.course.time[-1])
        if self.model.version == 1:
            self.instance.setTime(0.0)
        elif self.model.version == 2:
            self.instance.setupExperiment(startTime=0.0, stopTime=duration)
        set_parameters(self.instance, self.model.version, parameters)
        if self.model.version == 1:
            self.inputs.put(self.course.at(0))
            self._heed(self.instance.initialize()[3:])
        else:
            self.instance.enterInitializationMode(
                **({} if self.model.version == 2 else {"startTime": 0.0, "stopTime": duration})
            )
            self.inputs.put(self.course.at(0))
            self.instance.exitInitializationMode()
            self._update_discrete()
            self.instance.enterContinuousTimeMode()
        self.solver = self._solver()

    def _solver(self) -> Any:
        from fmpy.sundials import CVodeSolver

        description, fmu = self.model.description, self.instance
        return CVodeSolver(
            nx=description.numberOfContinuousStates,
            nz=description.numberOfEventIndicators,
            get_x=fmu.getContinuousStates,
            set_x=fmu.setContinuousStates,
            get_dx=fmu.getContinuousStateDerivatives
            if self.model.version == 3
            else fmu.getDerivatives,
            get_z=fmu.getEventIndicators,
            get_nominals=fmu.getNominalContinuousStates
            if self.model.version == 1
            else fmu.getNominalsOfContinuousStates,
            set_time=self._at,
            input=self,
            startTime=0.0,
            maxStep=float(np.median(np.diff(self.course.time))),
            relativeTolerance=TOLERANCE,
        )

    def _at(self, t: float) -> None:
        self.instance.setTime(t)
        self.apply(t)

    def apply(self, t: float) -> None:
        """Set the continuous inputs of an instant; the solver requests it before it looks for
        events.
        """
        self.continuous.put(self.course.between(t)[self.places])

    def advance(self, k: int) -> None:
        """Integrate from sample k to k + 1, through all events on the way; the inputs of k + 1 are
        set in the end.

        Raises
        ------
        RuntimeError
            The FMU asks to end, the integration fails, or a function of FMPy reports that a call
            failed.
        """
        goal = float(self.course.time[k + 1])
        if self.added is not self.course.added:  # the math pilot has moved
            self.added = self.course.added
            self._at(self.time)
            self.solver.reset(self.time)
        while goal - self.time > NEAR:
            until, happened = (goal if self.next_event > goal - NEAR else self.next_event), False
            if until - self.time > NEAR:
                happened, _, self.time = self.solver.step(self.time, until)
                self._at(self.time)
            due = self.next_event - self.time <= NEAR
            if due and self.next_event > self.time:
                self.time = self.next_event
                self._at(self.time)
            if self._completed() or happened or due:
                self._event()
        if not np.array_equal(
            self.course.at(k)[~self.course.continuous],
            self.course.at(k + 1)[~self.course.continuous],
        ):
            self._event(self.course.at(k + 1))

    def _completed(self) -> bool:
        """Notify the FMU that a step is done; return whether it wants an event."""
        if (
            self.model.version > 1
            and not self.model.description.modelExchange.needsCompletedIntegratorStep
        ):
            return False
        answer = self.instance.completedIntegratorStep()
        if self.model.version == 1:
            return bool(answer)
        if answer[1]:
            raise RuntimeError("the FMU asked to end the simulation")
        return bool(answer[0])

    def _event(self, inputs: np.ndarray | None = None) -> None:
        """Let the FMU settle what jumps, with new inputs where given."""
        if self.model.version > 1:
            self.instance.enterEventMode()
        if inputs is not None:
            self.inputs.put(inputs)
        if self.model.version == 1:
            converged = False
            while not converged:
                converged, *_, ends, has_next, following = self.instance.eventUpdate()
                self._heed((ends, has_next, following))
        else:
            self._update_discrete()
            self.instance.enterContinuousTimeMode()
        self.solver.reset(self.time)

    def _update_discrete(self) -> None:
        update = (
            self.instance.newDiscreteStates
            if self.model.version == 2
            else self.instance.updateDiscreteStates
        )
        again = True
        while again:
            again, ends, _, _, has_next, following = update()
            self._heed((ends, has_next, following))

    def _heed(self, answer: tuple[bool, bool, float]) -> None:
        ends, has_next, following = answer
        if ends:
            raise RuntimeError("the FMU asked to end the simulation")
        self.next_event = following if has_next else np.inf

    def close(self) -> None:
        """End the instance."""
        self.solver = None
        self.instance.terminate()
        self.instance.freeInstance()


class ArrayRun:
    """One replay in one step."""

    def __init__(self, model: UnpackedFmu, job: dict):
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
        set_parameters(
            self.slave,
            3,
            [(self.model.variables[name], value) for name, value in self.job["parameters"].items()],
        )
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
        getattr(self.slave, function)(
            self.slave.component,
            reference,
            1,
            values.ctypes.data_as(POINTER(c_double)),
            values.size,
        )
