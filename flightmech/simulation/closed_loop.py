"""Runs of a compiled model with a control law in the loop."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from flightmech.errors import OutOfRange, UnknownName
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import INPUT
from flightmech.simulation.run import (
    RUNWAY,
    Stated,
    axes_left,
    check_hold,
    describe_below_runway,
    initialise_run,
    output_attributes,
    output_columns,
    output_indices,
    read_inputs,
    read_time,
    values_in_si,
)
from flightmech.simulation.stated_values.odd_values import warn_of_odd_values

Law = Callable[[float, Mapping[str, float], Mapping[str, float]], Mapping[str, float]]
"""``law(t, outputs, inputs)`` returns the inputs that it commands, by name. [s], [SI]"""
_CLOCK = 1e-9  # instants that are closer are one: rounding of times [s]


class _Instant(NamedTuple):
    """An instant of a run.

    `sample` is that of the record, None between samples. `is_call` is true if the law is called.
    `step` is the time to the next instant. [s]
    """

    sample: int | None
    is_call: bool
    time: float
    step: float


def simulate_closed_loop(
    sim: SimModel,
    inputs: xr.Dataset,
    law: Law,
    period: float,
    parameters: Mapping[str, Stated] | None = None,
    delay: int = 0,
    hold: str = "linear",
    step: float = 0.01,
    outputs: Sequence[str] | None = None,
) -> xr.Dataset:
    """Simulate with a control law, autopilot or stability augmentation in the loop.

    The law is called at t0, t0 + period, t0 + 2 period ... with the outputs of that instant.  The
    inputs that it returns act after `delay` periods, and are constant until the next call.  The
    mean delay is therefore half a period in addition to `delay` periods.

    Parameters
    ----------
    sim : SimModel
        The compiled model.
    inputs : Dataset (time,)
        As in `simulate`. Its samples are those of the result.  An input that the law commands is
        used at the start only, for example by a trim. [SI]
    law : callable
        ``law(t, outputs, inputs)`` returns the inputs that it commands by name, as absolute values.
        ``outputs`` are all outputs of the model under the inputs that acted until then, ``inputs``
        those of the record at t. An augmentation returns the sum of the recorded input and its
        correction. The law may have a state. It is called once per period, in order. [s, SI]
    period : float
        Sample period of the law. [s]
    parameters, hold, step, outputs
        As in `simulate`. `step` is the largest internal step. A period is a whole number of steps
        that are not longer.
    delay : int
        Periods between the call and the instant from which its inputs act, such as the computing
        time of a flight computer. 0 means no delay.

    Returns
    -------
    Dataset (time,)
        The outputs, and the inputs that the law commanded, as they act from the sample on.
        Accelerations of a sample are those with these inputs.  Attributes as those of `simulate`,
        with ``period`` and ``delay``.

    Raises
    ------
    UnknownName
        A parameter, an output or an input that the model does not have. Also an input that the law
        returns.
    OutOfRange
        The law returned a number that is not finite. The text has the time.
    SchemaError, SimulationError
        As `simulate`.
    """
    check_hold(hold)
    if not period > 0.0 or delay < 0:
        raise ValueError(
            f"period is {period!r} and delay {delay!r}; give a period in s above zero, and a "
            f"delay of whole periods, 0 or more"
        )
    time = read_time(inputs)
    values = {"mode.step": step, **values_in_si(sim, parameters)}
    u = read_inputs(sim, inputs, values, len(time))
    warn_of_odd_values(sim, values, inputs)
    chosen = output_indices(sim, outputs)
    # the record gives all inputs that the law does not command
    loop = _ControlLaw(sim, law, delay, record=_InputRecord(time, u, hold == "zero"))
    run = initialise_run(sim, values, u[0], time=float(time[0]))
    # the height is judged, also if the caller does not want it
    seen = np.append(chosen, sim.outputs.index("h"))
    y = np.empty((len(time), len(seen)))
    commands: list[dict[str, float]] = []
    for instant in _list_instants(time, period):
        # the new command acts from this instant, also on the outputs of a sample here
        if instant.is_call:
            loop.call(instant.time, run.outputs())
            run.set_inputs(loop.inputs_at(instant.time))
        if instant.sample is not None:
            y[instant.sample] = run.outputs()[seen]
            commands.append(dict(loop.acting))
        if instant.step:
            end = instant.time + instant.step
            # inputs that are constant between samples change at the next instant, not before it
            last = loop.inputs_at(end, before=True)
            run.step(instant.time, instant.step, loop.inputs_at(instant.time), u1=last)
    columns = output_columns(sim, y[:, :-1], chosen) | _command_columns(sim, commands, u)
    runway = run.parameter(sim.parameters.index(RUNWAY))
    attributes = {
        "title": sim.title,
        "step": float(values["mode.step"]),
        "hold": hold,
        "period": period,
        "delay": delay,
        "out_of_range": axes_left(sim, run),
        "below_runway": describe_below_runway(time, y[:, -1] - runway),
    }
    return xr.Dataset(columns, {"time": ("time", time, {"units": "s"})}, attributes)


def _command_columns(
    sim: SimModel, commands: Sequence[Mapping[str, float]], u: np.ndarray
) -> dict[str, Any]:
    """Return the inputs that the law commanded at any sample; the recorded ones before that."""
    rows = {row.name: row for row in sim.entries(INPUT)}
    values: dict[str, np.ndarray] = {}
    for sample, command in enumerate(commands):
        for name, value in command.items():
            if name not in values:
                values[name] = u[:, sim.inputs.index(name)].copy()
            values[name][sample] = value
    columns = {}
    for name, column in values.items():
        columns[name] = ("time", column, output_attributes(rows[name]))
    return columns


class _InputRecord:
    """Recorded inputs u (time, inputs), linear or constant between samples."""

    def __init__(self, time: np.ndarray, u: np.ndarray, is_constant: bool):
        self.time, self.u, self.is_constant = time, u, is_constant

    def read(self, t: float, before: bool = False) -> np.ndarray:
        """Return the inputs (inputs,) at a time.

        With `before`, the inputs at a sample are those up to it, if they are constant between
        samples.
        """
        if self.is_constant:
            tolerance = -_CLOCK if before else _CLOCK
            sample = int(np.searchsorted(self.time, t + tolerance, side="right")) - 1
            return self.u[max(sample, 0)].copy()
        if len(self.time) == 1:
            return self.u[0].copy()
        # linear between samples k and k + 1, constant beyond the ends
        k = max(int(np.searchsorted(self.time, t, side="right")) - 1, 0)
        k = min(k, len(self.time) - 2)
        share = min(max((t - self.time[k]) / (self.time[k + 1] - self.time[k]), 0.0), 1.0)
        return (1.0 - share) * self.u[k] + share * self.u[k + 1]


class _ControlLaw:
    """A law with its delayed commands, and the commands that act."""

    def __init__(self, sim: SimModel, law: Law, delay: int, record: _InputRecord):
        self.sim, self.law, self.record = sim, law, record
        self.delayed: deque[dict[str, float]] = deque([{}] * delay)
        self.acting: dict[str, float] = {}

    def call(self, t: float, y: np.ndarray) -> None:
        """Call the law at a time with all outputs (outputs,)."""
        inputs = dict(zip(self.sim.inputs, self.record.read(t).tolist(), strict=True))
        outputs = dict(zip(self.sim.outputs, y.tolist(), strict=True))
        command = {}
        for name, value in self.law(t, outputs, inputs).items():
            if name not in inputs:
                raise UnknownName(
                    name, self.sim.inputs, "input", f"the control law returned it at t = {t:g} s"
                )
            if not np.isfinite(value):
                raise OutOfRange(
                    f"the control law returned {value} for {name} at t = {t:g} s; return "
                    f"finite numbers"
                )
            command[name] = float(value)
        # the queue delays each command by `delay` calls
        self.delayed.append(command)
        # an input that the law does not return now keeps its last command
        self.acting = {**self.acting, **self.delayed.popleft()}

    def inputs_at(self, t: float, before: bool = False) -> np.ndarray:
        """Return all inputs (inputs,) at a time; `before` as in `_InputRecord.read`."""
        inputs = self.record.read(t, before)
        for name, value in self.acting.items():
            inputs[self.sim.inputs.index(name)] = value
        return inputs


def _list_instants(time: np.ndarray, period: float) -> list[_Instant]:
    """Return the instants of all samples and of all calls of the law, in order.

    The step between two calls is the period itself, not a difference of times. All these steps
    have therefore the same length.
    """
    count = int(np.floor((time[-1] - time[0] + _CLOCK) / period)) + 1
    calls = time[0] + period * np.arange(count)
    instants = [_Instant(None, True, float(t), step=0.0) for t in calls]
    # a sample at a call is one instant, any other sample an instant of its own
    nearest = np.clip(np.round((time - time[0]) / period).astype(int), 0, count - 1)
    for sample, k in enumerate(nearest.tolist()):
        if np.abs(calls[k] - time[sample]) < _CLOCK:
            instants[k] = instants[k]._replace(sample=sample)
        else:
            instants.append(_Instant(sample, False, float(time[sample]), step=0.0))
    instants.sort(key=lambda instant: instant.time)

    # the last instant has no step
    for i, instant in enumerate(instants[:-1]):
        following = instants[i + 1]
        step = following.time - instant.time
        if instant.is_call and following.is_call:
            step = period
        instants[i] = instant._replace(step=step)
    return instants
