"""A whole run of a compiled model in one call of the kernel."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import OutOfRange, SchemaError, UnknownName
from flightmech.names import lookup
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import AXIS, INPUT, OUTPUT, PARAMETER, CatalogueEntry, Simulation


def simulate(
    sim: SimModel,
    inputs: xr.Dataset,
    parameters: Mapping[str, float] | None = None,
    hold: str = "linear",
    step: float = 0.01,
    outputs: Sequence[str] | None = None,
    terms: bool = False,
) -> xr.Dataset:
    """Simulate under recorded inputs.

    Parameters
    ----------
    sim : SimModel
        The compiled model.
    inputs : Dataset (time,)
        ``time`` [s, rising] and any of the inputs, over time or constant; other quantities of the
        vocabulary, such as the states of a manoeuvre, are not read. [SI]
    parameters : mapping of str to float, optional
        Parameters, and constant values of inputs that `inputs` does not hold; without one an input
        is zero.  ``mode.step`` among them goes before `step`. [SI]
    hold : {"linear", "zero"}
        Inputs linear between samples, or held from each sample to the next as an importer without
        interpolation does.
    step : float
        Largest internal step. [s]
    outputs : sequence of str, optional
        The outputs that are returned; all without it.
    terms : bool
        Return the contribution of every term as well.

    Returns
    -------
    Dataset (time,)
        The outputs; with `terms` also ``contribution`` (time, term), which sums to the coefficients
        (with ``bias.*``) and to the targets of the submodels.  Attribute ``out_of_range`` names the
        axes whose range was left, with the number of internal steps; it is empty when none was.

    Raises
    ------
    UnknownName
        A parameter or input that the model does not have.
    SchemaError
        No time, time that does not rise.
    SimulationError
        An input or the state is not finite (``time`` states when), a parameter has no meaning.
    """
    check_hold(hold)
    time = read_time(inputs)
    values = {"mode.step": step, **(parameters or {})}
    u = read_inputs(sim, inputs, values, len(time))
    chosen = output_indices(sim, outputs)
    run = initialise_run(sim, values, u[0], float(time[0]))
    y, parts = run.record(time, u, hold == "zero", chosen, terms)
    rows = sim.entries(OUTPUT)
    columns: dict[str, Any] = {
        rows[i].name: ("time", y[:, k], output_attributes(rows[i])) for k, i in enumerate(chosen)
    }
    coords: dict[str, Any] = {
        "time": ("time", time, {"units": "s", "long_name": lookup("time").long_name})
    }
    if parts is not None:
        columns["contribution"] = (
            ("time", "term"),
            parts,
            {"long_name": "contribution of each term to its coefficient"},
        )
        coords["term"] = ("term", list(sim.terms))
    return xr.Dataset(
        columns,
        coords,
        {
            "title": sim.title,
            "step": float(values["mode.step"]),
            "hold": hold,
            "out_of_range": axes_left(sim, run),
        },
    )


def initialise_run(
    sim: SimModel, values: Mapping[str, float], u: np.ndarray, time: float = 0.0
) -> Simulation:
    """Return an initialised simulation with parameters and inputs at the start."""
    run = Simulation(sim.model)
    for name, value in values.items():
        if name not in sim.inputs:
            run.set_parameter(index_of_parameter(sim, name), float(value))
    run.set_inputs(u)
    run.initialize(time)
    return run


def index_of_parameter(sim: SimModel, name: str) -> int:
    """Return the index of a parameter, among them those of the tables: ``node.CL.basic[3,1]``,
    ``table.CL.basic``, ``offset.CL.basic``.
    """
    index = sim.model.find(PARAMETER, name)
    if index < 0:
        hint = (
            "a table has node.CL.basic[3,1] with one index per axis, table.CL.basic and "
            "offset.CL.basic"
        )
        near = [*sim.parameters, *sim.inputs]
        raise UnknownName(
            name,
            near,
            "parameter or input",
            hint if name.split(".")[0] in ("node", "table", "offset") else "",
        )
    return index


def output_indices(sim: SimModel, outputs: Sequence[str] | None) -> np.ndarray:
    """Return the indices of the named outputs, of all when None."""
    if outputs is None:
        return np.arange(len(sim.outputs))
    unknown = [name for name in outputs if name not in sim.outputs]
    if unknown:
        raise UnknownName(unknown[0], sim.outputs, "output")
    return np.array([sim.outputs.index(name) for name in outputs], int)


def check_hold(hold: str) -> None:
    """Refuse a rule of the inputs that is not known."""
    if hold not in ("linear", "zero"):
        raise ValueError(f"hold is {hold!r}; allowed: linear, zero")


def constant_inputs(sim: SimModel, values: Mapping[str, float]) -> np.ndarray:
    """Return the inputs (inputs,) at their start values, with those in `values` set."""
    return np.array([float(values.get(row.name, row.value)) for row in sim.entries(INPUT)])


def output_attributes(row: CatalogueEntry) -> dict[str, str]:
    """Return the attributes of an output."""
    return {"units": row.units, "long_name": row.description, "display_units": row.display_units}


def read_time(inputs: xr.Dataset) -> np.ndarray:
    """Return the time (time,) of a record; it must rise. [s]"""
    if "time" not in inputs.coords or inputs["time"].ndim != 1 or inputs.sizes["time"] < 1:
        raise SchemaError("inputs", ["no coordinate time; give the inputs over time in s"])
    time = inputs["time"].values.astype(float)
    if not (np.diff(time) > 0.0).all() or not np.isfinite(time).all():
        at = int(np.flatnonzero(~(np.diff(time) > 0.0))[0]) if len(time) > 1 else 0
        raise SchemaError(
            "inputs",
            [
                f"time does not rise after {time[at]:g} s (sample {at}); sort it and drop "
                f"repeated samples"
            ],
        )
    return time


def read_inputs(
    sim: SimModel, inputs: xr.Dataset, values: Mapping[str, float], count: int, runs: int = 0
) -> np.ndarray:
    """Return the inputs (time, inputs): recorded ones, else the constant ones of `values`, else
    their start values.

    With `runs`, inputs may have the dimensions (run, time); if one has, the result is (run, time,
    inputs).
    """
    u = np.tile(constant_inputs(sim, values), (count, 1))
    if runs and any("run" in inputs[name].dims for name in inputs.variables if name in sim.inputs):
        u = np.tile(u, (runs, 1, 1))
    for name in map(str, inputs.variables):
        if name in sim.inputs:
            u[..., sim.inputs.index(name)] = _column(inputs[name], runs if u.ndim == 3 else 0)
        elif not _in_vocabulary(name):
            raise UnknownName(name, sim.inputs, "input")
    return u


def _column(item: xr.DataArray, runs: int = 0) -> Any:
    if runs and item.dims == ("run", "time"):
        if item.sizes["run"] != runs:
            raise SchemaError(
                "inputs",
                [f"{item.name} has {item.sizes['run']} runs, the varied parameters {runs}"],
            )
    elif item.dims not in ((), ("time",)):
        raise SchemaError(
            "inputs",
            [f"{item.name} has the dimensions {item.dims}; allowed are ('time',) and none"],
        )
    return item.values.astype(float)


def _in_vocabulary(name: str) -> bool:
    try:
        lookup(name)
    except UnknownName:
        return False
    return True


def axes_left(sim: SimModel, run: Simulation) -> str:
    """Return a short text per axis that was left: where and how long."""
    texts = []
    for row, below, above in zip(sim.entries(AXIS), *run.out_of_range()):
        for count, word, end in ((below, "below", row.low), (above, "above", row.high)):
            if count:
                texts.append(f"{row.name} {word} {end:g} in {int(count)} internal steps")
    return "; ".join(dict.fromkeys(texts))


Law = Callable[[float, Mapping[str, float], Mapping[str, float]], Mapping[str, float]]
"""``law(t, outputs, inputs)``: the inputs it moves, by name, at a sampling instant t [s]; all in SI."""
_CLOCK = 1e-9  # s, rounding of times: instants less apart are one


def simulate_closed_loop(
    sim: SimModel,
    inputs: xr.Dataset,
    law: Law,
    period: float,
    parameters: Mapping[str, float] | None = None,
    delay: int = 0,
    hold: str = "linear",
    step: float = 0.01,
    outputs: Sequence[str] | None = None,
) -> xr.Dataset:
    """Simulate with a control law, autopilot or stability augmentation in the loop.

    The law is called at t0, t0 + period, t0 + 2 period ... with the outputs of that instant.  The
    inputs that it returns act from there, after `delay` periods, and are held until the next call:
    half a period of delay on average, in addition to `delay` periods.

    Parameters
    ----------
    sim : SimModel
        The compiled model.
    inputs : Dataset (time,)
        As in `simulate`; its samples are those of the result.  What the law moves counts at the
        start only, where the model may be trimmed with it. [SI]
    law : callable
        ``law(t, outputs, inputs)`` returns the inputs that it moves by name, absolute values.
        ``outputs`` are all outputs of the model under the inputs that acted until then, ``inputs``
        those of the record at t: an augmentation returns their sum with its own part. It may keep a
        state of its own; it is called once per period, in order. [s, SI]
    period : float
        Sample period of the law. [s]
    parameters, hold, step, outputs
        As in `simulate`; `step` is the largest internal step, a period is a whole number of steps
        not longer than it.
    delay : int
        Periods between the call and the instant from which its inputs act, as of a computer that
        needs the time; 0 for none.

    Returns
    -------
    Dataset (time,)
        The outputs, and the inputs that the law moved, as they act from the sample on:
        accelerations of a sample are those under them.  Attributes as those of `simulate`, with
        ``period`` and ``delay``.

    Raises
    ------
    UnknownName
        A parameter, an output or an input, also one that the law returns, that the model does not
        have.
    OutOfRange
        The law returned a number that is not finite; the text has the time.
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
    values = {"mode.step": step, **(parameters or {})}
    u = read_inputs(sim, inputs, values, len(time))
    chosen = output_indices(sim, outputs)
    loop = _LawState(sim, law, delay, time, u, hold == "zero")
    run = initialise_run(sim, values, u[0], float(time[0]))
    y = np.empty((len(time), len(chosen)))
    commands: list[dict[str, float]] = []
    for sample, called, t, dt in _instants(time, period):
        if called:
            loop.call(t, run.outputs())
            run.set_inputs(loop.at(t))
        if sample is not None:
            y[sample] = run.outputs()[chosen]
            commands.append(dict(loop.acting))
        if dt:
            run.step(t, dt, loop.at(t), loop.at(t + dt, before=True))
    rows = sim.entries(OUTPUT)
    columns: dict[str, Any] = {
        rows[i].name: ("time", y[:, k], output_attributes(rows[i])) for k, i in enumerate(chosen)
    }
    own = {row.name: row for row in sim.entries(INPUT)}
    for name in dict.fromkeys(name for command in commands for name in command):
        base = u[:, sim.inputs.index(name)]
        moved = [command.get(name, value) for command, value in zip(commands, base, strict=True)]
        columns[name] = ("time", np.array(moved), output_attributes(own[name]))
    found = {
        "title": sim.title,
        "step": float(values["mode.step"]),
        "hold": hold,
        "period": period,
        "delay": delay,
    }
    return xr.Dataset(
        columns,
        {"time": ("time", time, {"units": "s"})},
        {**found, "out_of_range": axes_left(sim, run)},
    )


class _LawState:
    """The law, what it has returned that does not act yet, and what acts."""

    def __init__(
        self, sim: SimModel, law: Law, delay: int, time: np.ndarray, u: np.ndarray, held: bool
    ):
        self.sim, self.law, self.time, self.u, self.held = sim, law, time, u, held
        self.waiting: deque[dict[str, float]] = deque([{}] * delay)
        self.acting: dict[str, float] = {}

    def call(self, t: float, y: np.ndarray) -> None:
        recorded = dict(zip(self.sim.inputs, self._recorded(t).tolist(), strict=True))
        found = self.law(t, dict(zip(self.sim.outputs, y.tolist(), strict=True)), recorded)
        command = {}
        for name, value in found.items():
            if name not in recorded:
                raise UnknownName(
                    name, self.sim.inputs, "input", f"the control law returned it at t = {t:g} s"
                )
            if not np.isfinite(value):
                raise OutOfRange(
                    f"the control law returned {value} for {name} at t = {t:g} s; return "
                    f"finite numbers"
                )
            command[name] = float(value)
        self.waiting.append(command)
        self.acting = {**self.acting, **self.waiting.popleft()}

    def at(self, t: float, before: bool = False) -> np.ndarray:
        """Return all inputs at a time; `before` a sample from which others are held."""
        found = self._recorded(t, before)
        for name, value in self.acting.items():
            found[self.sim.inputs.index(name)] = value
        return found

    def _recorded(self, t: float, before: bool = False) -> np.ndarray:
        if self.held:
            return self.u[
                max(
                    int(
                        np.searchsorted(
                            self.time, t + (-_CLOCK if before else _CLOCK), side="right"
                        )
                    )
                    - 1,
                    0,
                )
            ].copy()
        k = min(
            max(int(np.searchsorted(self.time, t, side="right")) - 1, 0), max(len(self.time) - 2, 0)
        )
        if len(self.time) == 1:
            return self.u[0].copy()
        share = min(max((t - self.time[k]) / (self.time[k + 1] - self.time[k]), 0.0), 1.0)
        return (1.0 - share) * self.u[k] + share * self.u[k + 1]


def _instants(time: np.ndarray, period: float) -> list[tuple[int | None, bool, float, float]]:
    """Return every instant with its sample of the record, whether the law is called, its time and
    the step to the next. [s]

    A step between two calls is the period itself, not a difference of times, so that all have the
    same length.
    """
    count = int(np.floor((time[-1] - time[0] + _CLOCK) / period)) + 1
    calls = time[0] + period * np.arange(count)
    nearest = np.clip(np.round((time - time[0]) / period).astype(int), 0, count - 1)
    meets = np.abs(calls[nearest] - time) < _CLOCK
    rows: list[tuple[float, int | None, bool]] = [(float(t), None, True) for t in calls]
    for i, (k, together) in enumerate(zip(nearest.tolist(), meets.tolist(), strict=True)):
        if together:
            rows[k] = rows[k][0], i, True
        else:
            rows.append((float(time[i]), i, False))
    rows.sort(key=lambda row: row[0])
    found: list[tuple[int | None, bool, float, float]] = []
    for (t, sample, called), (following, _, then) in zip(
        rows, [*rows[1:], (rows[-1][0], None, False)], strict=True
    ):
        found.append((sample, called, t, period if called and then else following - t))
    return found
