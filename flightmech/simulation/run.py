"""A whole run of a compiled model in one call of the kernel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from ..errors import SchemaError, UnknownName
from ..names import lookup
from .kernel import AXIS, INPUT, OUTPUT, PARAMETER, Entry, Simulation

if TYPE_CHECKING:
    from .compiler import SimModel


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
        ``time`` [s, rising] and any of the inputs, over time or constant; other quantities of the vocabulary, such as the
        states of a manoeuvre, are not read. [SI]
    parameters : mapping of str to float, optional
        Parameters, and constant values of inputs that `inputs` does not hold; without one an input is zero.  ``mode.step``
        among them goes before `step`. [SI]
    hold : {"linear", "zero"}
        Inputs linear between samples, or held from each sample to the next as an importer without interpolation does.
    step : float
        Largest internal step. [s]
    outputs : sequence of str, optional
        The outputs that are returned; all without it.
    terms : bool
        Return the contribution of every term as well.

    Returns
    -------
    Dataset (time,)
        The outputs; with `terms` also ``contribution`` (time, term), which sums to the coefficients (with ``bias.*``) and to the
        targets of the submodels.  Attribute ``out_of_range`` names the axes whose range was left, with the number of internal
        steps; it is empty when none was.

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
    run = prepared(sim, values, u[0], float(time[0]))
    y, parts = run.record(time, u, hold == "zero", chosen, terms)
    rows = sim.entries(OUTPUT)
    columns: dict[str, Any] = {rows[i].name: ("time", y[:, k], attributes(rows[i])) for k, i in enumerate(chosen)}
    coords: dict[str, Any] = {"time": ("time", time, {"units": "s", "long_name": lookup("time").long_name})}
    if parts is not None:
        columns["contribution"] = (("time", "term"), parts, {"long_name": "contribution of each term to its coefficient"})
        coords["term"] = ("term", list(sim.terms))
    return xr.Dataset(
        columns, coords, {"title": sim.title, "step": float(values["mode.step"]), "hold": hold, "out_of_range": axes_left(sim, run)}
    )


def prepared(sim: SimModel, values: Mapping[str, float], u: np.ndarray, time: float = 0.0) -> Simulation:
    """Return an initialised simulation with parameters and inputs at the start."""
    run = Simulation(sim.model)
    for name, value in values.items():
        if name not in sim.inputs:
            run.set_parameter(index_of_parameter(sim, name), float(value))
    run.set_inputs(u)
    run.initialize(time)
    return run


def index_of_parameter(sim: SimModel, name: str) -> int:
    """Return the index of a parameter, among them those of the tables: ``node.CL.basic[3,1]``, ``table.CL.basic``, ``offset.CL.basic``."""
    index = sim.model.find(PARAMETER, name)
    if index < 0:
        hint = "a table has node.CL.basic[3,1] with one index per axis, table.CL.basic and offset.CL.basic"
        near = [*sim.parameters, *sim.inputs]
        raise UnknownName(name, near, "parameter or input", hint if name.split(".")[0] in ("node", "table", "offset") else "")
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


def attributes(row: Entry) -> dict[str, str]:
    """Return the attributes of an output."""
    return {"units": row.units, "long_name": row.description, "display_units": row.display_units}


def read_time(inputs: xr.Dataset) -> np.ndarray:
    """Return the time (time,) of a record; it must rise. [s]"""
    if "time" not in inputs.coords or inputs["time"].ndim != 1 or inputs.sizes["time"] < 1:
        raise SchemaError("inputs", ["no coordinate time; give the inputs over time in s"])
    time = inputs["time"].values.astype(float)
    if not (np.diff(time) > 0.0).all() or not np.isfinite(time).all():
        at = int(np.flatnonzero(~(np.diff(time) > 0.0))[0]) if len(time) > 1 else 0
        raise SchemaError("inputs", [f"time does not rise after {time[at]:g} s (sample {at}); sort it and drop repeated samples"])
    return time


def read_inputs(sim: SimModel, inputs: xr.Dataset, values: Mapping[str, float], count: int, runs: int = 0) -> np.ndarray:
    """Return the inputs (time, inputs): recorded ones, else the constant ones of `values`, else their start values.

    With `runs`, inputs may have the dimensions (run, time); if one has, the result is (run, time, inputs).
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
            raise SchemaError("inputs", [f"{item.name} has {item.sizes['run']} runs, the varied parameters {runs}"])
    elif item.dims not in ((), ("time",)):
        raise SchemaError("inputs", [f"{item.name} has the dimensions {item.dims}; allowed are ('time',) and none"])
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
