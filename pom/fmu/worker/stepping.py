"""Instances of an FMU that are stepped from sample to sample, or over a whole record at once.

FMPy's CVode integrates the states of an FMU in model exchange of FMI 1.0, 2.0 and 3.0.
"""

from __future__ import annotations

from collections.abc import Sequence
from ctypes import POINTER, c_double, c_int, c_uint
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
        # FMI 3.0 has no derivatives of inputs.
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
        """Step from sample k to k + 1. The inputs of sample k + 1 are set at the end.

        Raises
        ------
        RuntimeError
            The FMU requests the end, or a function of FMPy reports that a call failed.
        """
        t = self.course.time
        # Without derivatives the inputs are constant over the step.
        if self.derivatives:
            self.inputs.put(self.course.at(k))
            self._put_slopes(self.course.slope(k)[self.sloped].tolist())
        else:
            self.inputs.put(self.course.middle(k))
        end = self.instance.doStep(float(t[k]), float(t[k + 1] - t[k]))
        if end and end[1]:
            raise RuntimeError("the FMU asked to end the simulation")
        self.inputs.put(self.course.at(k + 1))

    def _put_slopes(self, slopes: list[float]) -> None:
        """Set the derivatives of the continuous inputs. [1/s]"""
        if self.model.version == 2:
            self.instance.setRealInputDerivatives(self.references, [1] * len(slopes), slopes)
            return
        # The method of FMPy 0.3 calls fmiInitializeSlave in place of fmiSetRealInputDerivatives.
        n = len(slopes)
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
    variables = [variable for variable, _ in parameters]
    values = [value for _, value in parameters]
    Ports(instance, version, variables).put(values)


TOLERANCE = 1e-8
"""Relative tolerance of the integration.

It is far below any tolerance of a test, and below the default of FMPy, 1e-5.
"""
NEAR = 1e-9
"""Largest distance of samples and events that count as one instant. [s]

CVode cannot integrate between times that differ by rounding.
"""


class Exchange:
    """One instance in model exchange; parameters as `CoSimulation`.

    The loop of FMPy applies inputs at the ends of steps only, so its right-hand side has constant
    inputs. Here the inputs are set with every time of the solver. No step is longer than a sample,
    so that no short input is missed.
    """

    def __init__(self, model: UnpackedFmu, inputs: Sequence[Any], course: Course):
        self.model, self.course = model, course
        self.instance = model.open()
        self.inputs = Ports(self.instance, model.version, inputs)
        self.columns = np.flatnonzero(course.continuous).tolist()
        self.continuous = Ports(self.instance, model.version, [inputs[i] for i in self.columns])
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
            self._note_event_info(self.instance.initialize()[3:])
        else:
            # FMI 2.0 has the times in setupExperiment.
            times = {}
            if self.model.version == 3:
                times = {"startTime": 0.0, "stopTime": duration}
            self.instance.enterInitializationMode(**times)
            self.inputs.put(self.course.at(0))
            self.instance.exitInitializationMode()
            self._update_discrete()
            self.instance.enterContinuousTimeMode()
        self.solver = self._make_solver()

    def _make_solver(self) -> Any:
        """Return the integrator of FMPy with the functions of the instance."""
        # not every platform has this library of FMPy
        from fmpy.sundials import CVodeSolver

        description, fmu = self.model.description, self.instance
        # The versions of FMI have different names for two of the functions.
        get_derivatives = "getDerivatives"
        if self.model.version == 3:
            get_derivatives = "getContinuousStateDerivatives"
        get_nominals = "getNominalsOfContinuousStates"
        if self.model.version == 1:
            get_nominals = "getNominalContinuousStates"
        return CVodeSolver(
            nx=description.numberOfContinuousStates,
            nz=description.numberOfEventIndicators,
            get_x=fmu.getContinuousStates,
            set_x=fmu.setContinuousStates,
            get_dx=getattr(fmu, get_derivatives),
            get_z=fmu.getEventIndicators,
            get_nominals=getattr(fmu, get_nominals),
            set_time=self._set_time,
            input=self,
            startTime=0.0,
            maxStep=float(np.median(np.diff(self.course.time))),
            relativeTolerance=TOLERANCE,
        )

    def _set_time(self, t: float) -> None:
        self.instance.setTime(t)
        self.apply(t)

    def apply(self, t: float) -> None:
        """Set the continuous inputs of an instant. The solver calls it before it searches
        events.
        """
        self.continuous.put(self.course.between(t)[self.columns])

    def advance(self, k: int) -> None:
        """Integrate from sample k to k + 1 through all events. Its inputs are set at the end.

        Raises
        ------
        RuntimeError
            The FMU requests the end, the integration fails, or a function of FMPy reports that a
            call failed.
        """
        goal = float(self.course.time[k + 1])
        # The corrections of the math pilot have changed, so the history of the solver is invalid.
        if self.added is not self.course.added:
            self.added = self.course.added
            self._set_time(self.time)
            self.solver.reset(self.time)
        while goal - self.time > NEAR:
            self._step_or_handle_event(goal)
        # Inputs that are not continuous change at the sample, which is an event.
        is_stepped = ~self.course.continuous
        before, after = self.course.at(k), self.course.at(k + 1)
        if not np.array_equal(before[is_stepped], after[is_stepped]):
            self._handle_event(after)

    def _step_or_handle_event(self, goal: float) -> None:
        """Integrate to the time `goal`, or to an event before it. [s]"""
        until = self.next_event
        if self.next_event > goal - NEAR:
            until = goal
        is_state_event = False
        if until - self.time > NEAR:
            is_state_event, _, self.time = self.solver.step(self.time, until)
            self._set_time(self.time)
        is_time_event = self.next_event - self.time <= NEAR
        # The instant of a time event is exact.
        if is_time_event and self.next_event > self.time:
            self.time = self.next_event
            self._set_time(self.time)
        if self._complete_step() or is_state_event or is_time_event:
            self._handle_event()

    def _complete_step(self) -> bool:
        """Notify the FMU that a step is complete; return whether it requires an event."""
        kind = self.model.description.modelExchange
        if self.model.version > 1 and not kind.needsCompletedIntegratorStep:
            return False
        answer = self.instance.completedIntegratorStep()
        if self.model.version == 1:
            return bool(answer)
        if answer[1]:
            raise RuntimeError("the FMU asked to end the simulation")
        return bool(answer[0])

    def _handle_event(self, inputs: np.ndarray | None = None) -> None:
        """Update the discrete states of the FMU at an event, with new inputs if there are any."""
        if self.model.version > 1:
            self.instance.enterEventMode()
        if inputs is not None:
            self.inputs.put(inputs)
        if self.model.version == 1:
            converged = False
            while not converged:
                converged, *_, ends, has_next, following = self.instance.eventUpdate()
                self._note_event_info((ends, has_next, following))
        else:
            self._update_discrete()
            self.instance.enterContinuousTimeMode()
        self.solver.reset(self.time)

    def _update_discrete(self) -> None:
        """Update the discrete states until the FMU needs no further update."""
        if self.model.version == 2:
            update = self.instance.newDiscreteStates
        else:
            update = self.instance.updateDiscreteStates
        needs_update = True
        while needs_update:
            needs_update, ends, _, _, has_next, following = update()
            self._note_event_info((ends, has_next, following))

    def _note_event_info(self, info: tuple[bool, bool, float]) -> None:
        """Store the time of the next event from the results (ends, has next event, its time)."""
        ends, has_next, following = info
        if ends:
            raise RuntimeError("the FMU asked to end the simulation")
        self.next_event = np.inf
        if has_next:
            self.next_event = following

    def close(self) -> None:
        """End the instance."""
        self.solver = None
        self.instance.terminate()
        self.instance.freeInstance()


class ArrayRun:
    """One replay in one step, through arrays of the whole record."""

    def __init__(self, model: UnpackedFmu, job: dict):
        self.model, self.slave, self.job = model, model.open(), job
        time = np.asarray(job["time"], float)
        time = np.ascontiguousarray(time - time[0])
        # Inputs that the job does not have keep their start values.
        u = np.tile([float(variable.start) for variable in model.inputs], (len(time), 1))
        names = [variable.name for variable in model.inputs]
        for name, values in job["inputs"].items():
            u[:, names.index(name)] = values
        self.slave.enterConfigurationMode()
        self.slave.setUInt64([model.variables["replay.n"].valueReference], [len(time)])
        self.slave.exitConfigurationMode()
        self._call_with_array("fmi3SetFloat64", "replay.t", time)
        self._call_with_array("fmi3SetFloat64", "replay.u", u)
        self.duration, self.first = float(time[-1]), u[0]

    def start(self) -> None:
        """Set parameters and leave initialisation."""
        parameters = self.job["parameters"].items()
        pairs = [(self.model.variables[name], value) for name, value in parameters]
        set_parameters(self.slave, version=3, parameters=pairs)
        self.slave.enterInitializationMode(startTime=0.0, stopTime=self.duration)
        references = [variable.valueReference for variable in self.model.inputs]
        self.slave.setFloat64(references, self.first.tolist())
        self.slave.exitInitializationMode()

    def fly(self) -> None:
        """Make the step."""
        self.slave.doStep(0.0, self.duration)

    def read(self) -> np.ndarray:
        """Return the outputs (time, output); NaN after the end of a failed run."""
        y = np.full((len(self.job["time"]), len(self.model.outputs)), np.nan)
        self._call_with_array("fmi3GetFloat64", "replay.y", y)
        names = [variable.name for variable in self.model.outputs]
        return y[:, [names.index(name) for name in self.job["outputs"]]]

    def close(self) -> None:
        """End the instance."""
        self.slave.terminate()
        self.slave.freeInstance()

    def _call_with_array(self, function: str, name: str, values: np.ndarray) -> None:
        """Call a function of FMI 3.0 that reads or writes all elements of an array variable."""
        reference = (c_uint * 1)(self.model.variables[name].valueReference)
        getattr(self.slave, function)(
            self.slave.component,
            reference,
            1,
            values.ctypes.data_as(POINTER(c_double)),
            values.size,
        )
