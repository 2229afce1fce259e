"""Model exchange of FMI 1.0, 2.0 and 3.0: FMPy's CVode integrates the states of the FMU from sample to sample."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .cosimulation import set_parameters
from .inputs import Course, Ports
from .model import Model

TOLERANCE = 1e-8
"""Relative tolerance of the integration: far below any tolerance of a test, and below the default of FMPy, 1e-5."""
NEAR = 1e-9
"""Instants of samples and events less apart than this are one: CVode refuses to integrate between times that differ by rounding. [s]"""


class Exchange:
    """One instance in model exchange; parameters as `CoSimulation`.

    FMPy's own loop applies inputs at the ends of steps only: its right-hand side never sees them change.  Here the clock of the
    solver sets them too.  No step is longer than a sample, so that a short input cannot be stepped over.
    """

    def __init__(self, model: Model, inputs: Sequence[Any], course: Course):
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
            self.instance.enterInitializationMode(**({} if self.model.version == 2 else {"startTime": 0.0, "stopTime": duration}))
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
            get_dx=fmu.getContinuousStateDerivatives if self.model.version == 3 else fmu.getDerivatives,
            get_z=fmu.getEventIndicators,
            get_nominals=fmu.getNominalContinuousStates if self.model.version == 1 else fmu.getNominalsOfContinuousStates,
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
        """Set the continuous inputs of an instant; the solver requests it before it looks for events."""
        self.continuous.put(self.course.between(t)[self.places])

    def advance(self, k: int) -> None:
        """Integrate from sample k to k + 1, through all events on the way; the inputs of k + 1 are set in the end.

        Raises
        ------
        RuntimeError
            The FMU asks to end, the integration fails, or a function of FMPy reports that a call failed.
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
        if not np.array_equal(self.course.at(k)[~self.course.continuous], self.course.at(k + 1)[~self.course.continuous]):
            self._event(self.course.at(k + 1))

    def _completed(self) -> bool:
        """Notify the FMU that a step is done; return whether it wants an event."""
        if self.model.version > 1 and not self.model.description.modelExchange.needsCompletedIntegratorStep:
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
        update = self.instance.newDiscreteStates if self.model.version == 2 else self.instance.updateDiscreteStates
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
