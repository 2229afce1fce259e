"""Runs of a compiled model, each in one call of the kernel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError, UnknownName
from flightmech.names import is_quantity, lookup
from flightmech.quantities import time_text, value_in_si
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import AXIS, INPUT, OUTPUT, PARAMETER, CatalogueEntry, Simulation
from flightmech.simulation.stated_values.odd_values import warn_of_odd_values

RUNWAY = "env.runway_elevation"  # parameter [m]
_CONTRIBUTION = {"long_name": "contribution of each term to its coefficient"}

Stated = float | str
"""A number in SI, or a text with its unit."""


def simulate(
    sim: SimModel,
    inputs: xr.Dataset,
    parameters: Mapping[str, Stated] | None = None,
    hold: str = "linear",
    step: float = 0.01,
    outputs: Sequence[str] | None = None,
    terms: bool = False,
) -> xr.Dataset:
    """Simulate under recorded inputs, with a warning of values that no aeroplane has.

    Parameters
    ----------
    sim : SimModel
        The compiled model.
    inputs : Dataset (time,)
        ``time`` [s, rising] and any of the inputs, over time or constant. Other quantities of the
        vocabulary, such as the states of a manoeuvre, are ignored. [SI]
    parameters : mapping of str to float, optional
        Parameters, and constant values of inputs that are not in `inputs`. The default of an input
        is its start value. ``mode.step`` has priority over `step`.  ``init.gamma`` acts in the trim
        (``mode.trim``) only: without one ``init.theta`` and ``init.alpha`` give the climb angle.
        A text has its unit, as ``"175 kt"``; a number is SI.
    hold : {"linear", "zero"}
        Inputs are linear between samples, or constant from each sample to the next.
    step : float
        Largest internal step. [s]
    outputs : sequence of str, optional
        Outputs to return. Default: all.
    terms : bool
        Whether to return the contribution of every term as well.

    Returns
    -------
    Dataset (time,)
        The outputs. With `terms` also ``contribution`` (time, term), which sums to the coefficients
        (with ``bias.*``) and to the targets of the submodels.  Attribute ``out_of_range`` names the
        axes that the run left, with the number of internal steps, or is empty.  Attribute
        ``below_runway`` states when and how far the c.g. is below the runway, or is empty.

    Raises
    ------
    UnknownName
        A parameter or input that the model does not have.
    SchemaError
        No time, or time that does not rise.
    SimulationError
        An input or the state is not finite (at ``time``), or a parameter has no meaning.
    """
    check_hold(hold)
    time = read_time(inputs)
    # `mode.step` among the parameters replaces the argument
    values = {"mode.step": step, **values_in_si(sim, parameters)}
    u = read_inputs(sim, inputs, values, len(time))
    warn_of_odd_values(sim, values, inputs)
    chosen = output_indices(sim, outputs)
    run = initialise_run(sim, values, u[0], time=float(time[0]))
    # the height is judged, also if the caller does not want it
    seen = np.append(chosen, sim.outputs.index("h"))
    y, contributions = run.record(time, u, hold == "zero", outputs=seen, terms=terms)
    columns = output_columns(sim, y[:, :-1], chosen)
    if terms:
        columns["contribution"] = (("time", "term"), contributions, _CONTRIBUTION)
    attributes = {"title": sim.title, "step": float(values["mode.step"]), "hold": hold}
    attributes["out_of_range"] = axes_left(sim, run)
    runway = run.parameter(sim.parameters.index(RUNWAY))
    attributes["below_runway"] = describe_below_runway(time, y[:, -1] - runway)
    return xr.Dataset(columns, _make_coordinates(sim, time, terms), attributes)


def _make_coordinates(sim: SimModel, time: np.ndarray, terms: bool) -> dict[str, Any]:
    """Return the time [s] and, with `terms`, the names of the terms as coordinates."""
    time_attributes = {"units": "s", "long_name": lookup("time").long_name}
    coords: dict[str, Any] = {"time": ("time", time, time_attributes)}
    if terms:
        coords["term"] = ("term", list(sim.terms))
    return coords


def output_columns(sim: SimModel, y: np.ndarray, chosen: np.ndarray) -> dict[str, Any]:
    """Return outputs y (time, chosen) as variables of a dataset; `chosen` are their indices."""
    rows = sim.entries(OUTPUT)
    columns = {}
    for k, i in enumerate(chosen):
        columns[rows[i].name] = ("time", y[:, k], output_attributes(rows[i]))
    return columns


def initialise_run(
    sim: SimModel, values: Mapping[str, float], u: np.ndarray, time: float = 0.0
) -> Simulation:
    """Return an initialised simulation with parameters and inputs at the start."""
    run = Simulation(sim.model)
    for name, value in values.items():
        # values of inputs are in `u`
        if name not in sim.inputs:
            run.set_parameter(index_of_parameter(sim, name), float(value))
    run.set_inputs(u)
    run.initialize(time)
    return run


def index_of_parameter(sim: SimModel, name: str) -> int:
    """Return the index of a parameter.

    Tables have the parameters ``node.CL.basic[3,1]``, ``table.CL.basic`` and ``offset.CL.basic``.
    """
    index = sim.model.find(PARAMETER, name)
    if index >= 0:
        return index
    hint = ""
    if name.split(".")[0] in ("node", "table", "offset"):
        hint = (
            "a table has node.CL.basic[3,1] with one index per axis, table.CL.basic and "
            "offset.CL.basic"
        )
    raise UnknownName(name, [*sim.parameters, *sim.inputs], "parameter or input", hint)


def output_indices(sim: SimModel, outputs: Sequence[str] | None) -> np.ndarray:
    """Return the indices of some outputs, or of all if `outputs` is None."""
    if outputs is None:
        return np.arange(len(sim.outputs))
    for name in outputs:
        if name not in sim.outputs:
            raise UnknownName(name, sim.outputs, "output")
    return np.array([sim.outputs.index(name) for name in outputs], int)


def check_hold(hold: str) -> None:
    """Raise ValueError if `hold` is not a rule of the inputs between samples."""
    if hold not in ("linear", "zero"):
        raise ValueError(f"hold is {hold!r}; allowed: linear, zero")


def constant_inputs(sim: SimModel, values: Mapping[str, float]) -> np.ndarray:
    """Return the inputs (inputs,): those in `values`, else their start values."""
    return np.array([float(values.get(row.name, row.value)) for row in sim.entries(INPUT)])


def output_attributes(row: CatalogueEntry) -> dict[str, str]:
    """Return the attributes of an output."""
    return {"units": row.units, "long_name": row.description, "display_units": row.display_units}


def read_time(inputs: xr.Dataset) -> np.ndarray:
    """Return the time (time,) of a record; raise SchemaError if it does not rise. [s]"""
    if "time" not in inputs.coords or inputs["time"].ndim != 1 or inputs.sizes["time"] < 1:
        raise SchemaError("inputs", ["no coordinate time; give the inputs over time in s"])
    time = inputs["time"].values.astype(float)
    is_finite = np.isfinite(time)
    if not is_finite.all():
        sample = int(np.flatnonzero(~is_finite)[0])
        raise SchemaError(
            "inputs",
            [f"time is {time[sample]:g} at sample {sample}; give finite times, drop the sample"],
        )
    rises = np.diff(time) > 0.0
    if not rises.all():
        sample = int(np.flatnonzero(~rises)[0])
        raise SchemaError(
            "inputs",
            [
                f"time does not rise after {time_text(time[sample])} s (sample {sample}); sort it "
                f"and drop repeated samples"
            ],
        )
    return time


def read_inputs(
    sim: SimModel, inputs: xr.Dataset, values: Mapping[str, float], count: int, runs: int = 0
) -> np.ndarray:
    """Return the inputs (time, inputs).

    The value of an input is the recorded one, else that of `values`, else its start value. With
    `runs`, inputs may have the dimensions (run, time). If one has them, the result is (run, time,
    inputs).
    """
    # constants first, then recorded inputs replace them
    u = np.tile(constant_inputs(sim, values), (count, 1))
    recorded = [name for name in map(str, inputs.variables) if name in sim.inputs]
    if runs and any("run" in inputs[name].dims for name in recorded):
        u = np.tile(u, (runs, 1, 1))
    else:
        runs = 0
    for name in map(str, inputs.variables):
        if name in sim.inputs:
            u[..., sim.inputs.index(name)] = _read_column(inputs[name], runs)
        # other quantities of a record, such as states, are ignored; misspelt names are not
        elif not is_quantity(name):
            raise UnknownName(name, sim.inputs, "input")
    return u


def _read_column(item: xr.DataArray, runs: int) -> np.ndarray:
    """Return the values of an input: a constant, (time,), or (run, time) if `runs` is not 0."""
    # a batch may have inputs of each run
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


def describe_below_runway(time: np.ndarray, height: np.ndarray) -> str:
    """Return when and how far the c.g. is below the runway; empty if it is not.

    Contacts hold an aircraft from below only, and one without a contact that touches sinks through.

    Parameters
    ----------
    time, height : array (time,)
        Time, and height of the c.g. above the runway. [s, m]
    """
    is_below = height < 0.0
    if not is_below.any():
        return ""
    # NaN after the end of a run that failed
    depth = -float(np.nanmin(height))
    return (
        f"c.g. below the runway from {time[is_below][0]:.1f} s on, by up to {depth:.2g} m; give "
        f"the aircraft contacts that touch, such as skids at belly and wing tips"
    )


def axes_left(sim: SimModel, run: Simulation) -> str:
    """Return the table axes that a run left, each with the end and the number of steps."""
    texts = []
    below, above = run.out_of_range()
    for i, row in enumerate(sim.entries(AXIS)):
        if below[i]:
            texts.append(f"{row.name} below {row.low:g} in {int(below[i])} internal steps")
        if above[i]:
            texts.append(f"{row.name} above {row.high:g} in {int(above[i])} internal steps")
    # several axes of one name may have the same text
    return "; ".join(dict.fromkeys(texts))


def units_of_names(sim: SimModel) -> dict[str, str]:
    """Return the units of all names of a model that a caller may give a value.

    These are outputs, inputs and parameters, start values without ``init.``, and inputs of all
    engines without ``engine1.``.
    """
    rows = [*sim.entries(OUTPUT), *sim.entries(INPUT), *sim.entries(PARAMETER)]
    units: dict[str, str] = {}
    for prefix in ("engine1.", "mass.", "env.", "init."):
        for row in rows:
            if row.name.startswith(prefix):
                units[row.name.removeprefix(prefix)] = row.units
    return units | {row.name: row.units for row in rows}


def values_in_si(sim: SimModel, values: Mapping[str, Stated] | None) -> dict[str, float]:
    """Return stated values as numbers in SI.

    Raises
    ------
    UnknownName
        A text for a name that the model does not have.
    UnitError
        A text without a unit, or with a unit of another dimension.
    """
    given = dict(values or {})
    # Most calls have numbers only, and thousands of them follow each other in a search.
    if not any(isinstance(value, str) for value in given.values()):
        return given  # type: ignore[return-value]
    units = units_of_names(sim)
    converted: dict[str, float] = {}
    for name, value in given.items():
        if isinstance(value, str) and name not in units:
            raise UnknownName(name, units, "parameter, input or quantity")
        converted[name] = value_in_si(value, units.get(name, ""), name)
    return converted
