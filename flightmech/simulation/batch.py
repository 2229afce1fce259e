"""Many runs of one record, each with its own parameters, on all processors."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from ctypes import POINTER, byref, c_double, c_int, c_size_t
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError, SimulationError
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import OUTPUT, Simulation
from flightmech.simulation.kernel_library import load_kernel
from flightmech.simulation.run import (
    check_hold,
    index_of_parameter,
    output_attributes,
    output_indices,
    read_inputs,
    read_time,
)

_TEXT = 200  # AM_TEXT of kernel.h
# samples of all runs, 2 to 10 ms of work, below which threads of their own cost more than they save
_ALONE = 10_000


MOST_LOOPS = 16  # AM_MOST_LOOPS of kernel.h


class ControlLoop(NamedTuple):
    """A loop that is closed sample by sample: ``gain e + integral * Int e dt`` is added to an
    input, e = target - output.

    Attributes
    ----------
    input, output : str
    gain, integral, limit : float
        Of the correction, which is at most `limit` in size. [input / output], [input / output / s],
        [input]
    target : array (time,)
        What the output shall be. [SI]
    turns : bool
        Whether the output is an angle, whose error is taken below half a turn.
    """

    input: str
    output: str
    gain: float
    integral: float
    limit: float
    target: np.ndarray
    turns: bool = False


class _LoopStruct(ctypes.Structure):
    """``am_loop`` of kernel.h."""

    _fields_ = [
        ("input", c_int),
        ("output", c_int),
        ("turns", c_int),
        ("gain", c_double),
        ("integral", c_double),
        ("limit", c_double),
        ("target", POINTER(c_double)),
    ]


class _Task(ctypes.Structure):
    """``am_batch_task`` of kernel.h."""

    _fields_ = [
        ("samples", c_size_t),
        ("parameters", c_size_t),
        ("outputs", c_size_t),
        ("t", POINTER(c_double)),
        ("u", POINTER(c_double)),
        ("parameter", POINTER(c_int)),
        ("values", POINTER(c_double)),
        ("output", POINTER(c_int)),
        ("y", POINTER(c_double)),
        ("hold", c_int),
        ("each_inputs", c_int),
        ("lanes", c_int),
        ("loops", c_size_t),
        ("loop", POINTER(_LoopStruct)),
    ]


def simulate_batch(
    sim: SimModel,
    inputs: xr.Dataset,
    varied: Mapping[str, Sequence[float] | np.ndarray],
    parameters: Mapping[str, float] | None = None,
    outputs: Sequence[str] | None = None,
    hold: str = "linear",
    step: float = 0.01,
    threads: int | None = None,
    failed: str = "raise",
    lanes: int = 0,
) -> xr.Dataset:
    """Simulate one record many times with different parameters.

    The runs share the compiled model and are flown by threads, in each of them several side by side
    in the lanes of the processor; a run's result depends on neither number.

    Parameters
    ----------
    sim : SimModel
        The compiled model.
    inputs, parameters, hold, step
        As in `simulate`; they hold for all runs, but that a variable of `inputs` may have the
        dimensions (run, time).
    varied : mapping of str to array (run,)
        The parameters that differ: any parameter of the model, or a part of a table,
        ``node.CL.basic[3,1]``, ``table.CL.basic`` (its scale), ``offset.CL.gear.K1``. [SI]
    outputs : sequence of str, optional
        What is returned; all outputs without it.
    threads : int, optional
        Without it one per processor, and one alone for a small batch.
    failed : {"raise", "nan"}
        What a run that fails does: raise, or leave NaN behind the last good sample and its reason
        in ``failure``.
    lanes : int, optional
        Most runs side by side: as many as the processor has lanes for (0), one after the other (1),
        or 4.

    Returns
    -------
    Dataset (run, time)
        The chosen outputs; ``failure`` (run,) is empty for a run that went through.

    Raises
    ------
    UnknownName
        A parameter or output that the model does not have.
    SchemaError
        Varied parameters of different lengths.
    SimulationError
        A run failed and `failed` is "raise"; the text names the run.
    """
    check_hold(hold)
    if failed not in ("raise", "nan"):
        raise ValueError(f"failed is {failed!r}; allowed: raise, nan")
    values = _table(varied)
    time = read_time(inputs)
    constant = {"mode.step": step, **(parameters or {})}
    u = read_inputs(sim, inputs, constant, len(time), len(values))
    y, done, texts = fly_batch(
        sim, time, u, list(varied), values, constant, outputs, hold, threads, lanes
    )
    if failed == "raise":
        for run in (run for run, text in enumerate(texts) if text):
            raise SimulationError(
                f"run {run}: {texts[run]}", float(time[min(done[run], len(time) - 1)])
            )
    chosen = output_indices(sim, outputs)
    rows = [sim.entries(OUTPUT)[i] for i in chosen]
    columns: dict[str, Any] = {
        row.name: (("run", "time"), y[:, :, k], output_attributes(row))
        for k, row in enumerate(rows)
    }
    columns["failure"] = ("run", np.array(texts, object), {"long_name": "why a run ended early"})
    coords = {
        "time": ("time", time, {"units": "s"}),
        **{name: ("run", values[:, k]) for k, name in enumerate(varied)},
    }
    return xr.Dataset(
        columns, coords, {"title": sim.title, "step": float(constant["mode.step"]), "hold": hold}
    )


def fly_batch(
    sim: SimModel,
    time: np.ndarray,
    u: np.ndarray,
    varied: Sequence[str],
    values: np.ndarray,
    constant: Mapping[str, float],
    outputs: Sequence[str] | None = None,
    hold: str = "linear",
    threads: int | None = None,
    lanes: int = 0,
    loops: Sequence[ControlLoop] = (),
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Fly a batch on plain arrays, as `simulate_batch` does with names and checks around it: for
    many small batches.

    Parameters
    ----------
    sim, outputs, hold, threads, lanes
        As in `simulate_batch`.
    time : array (time,)
        Rising. [s]
    u : array (time, inputs) or (run, time, inputs)
    varied, values : names, and array (run, name)
        The parameters that differ.
    constant : mapping of str to float
        Parameters of all runs.
    loops : sequence of Loop
        At most `MOST_LOOPS`; a correction is in force from its sample to the next, at both ends of
        the step.

    Returns
    -------
    y : array (run, time, output)
        NaN behind the last good sample of a run that failed.
    done : array of int (run,)
        Good samples.
    failures : list of str
        Empty for a run that went through.
    """
    base = Simulation(sim.model)
    for name, value in constant.items():
        if name not in sim.inputs:
            base.set_parameter(index_of_parameter(sim, name), float(value))
    chosen, changed = (
        output_indices(sim, outputs),
        [index_of_parameter(sim, name) for name in varied],
    )
    held = output_indices(sim, [one.output for one in loops]).tolist()
    targets = [
        np.ascontiguousarray(np.broadcast_to(one.target, time.shape), float) for one in loops
    ]  # kept while they are flown
    closed = [
        _LoopStruct(
            sim.inputs.index(one.input),
            output,
            one.turns,
            *one[2:5],
            target.ctypes.data_as(POINTER(c_double)),
        )
        for one, output, target in zip(loops, held, targets, strict=True)
    ]
    y, status, done, texts = _fly(
        base, time, u, changed, values, chosen, hold, threads, lanes, closed
    )
    for run in np.flatnonzero(status):
        y[run, done[run] :] = np.nan
    return y, done, texts


def _table(varied: Mapping[str, Sequence[float] | np.ndarray]) -> np.ndarray:
    """Return the values (run, parameter)."""
    lengths = {name: np.size(column) for name, column in varied.items()}
    if not lengths or len(set(lengths.values())) != 1:
        found = ", ".join(f"{name} {n}" for name, n in lengths.items()) or "none"
        raise SchemaError(
            "varied parameters",
            [f"every parameter needs one value per run; lengths found: {found}"],
        )
    return np.ascontiguousarray(
        np.column_stack([np.asarray(column, float).ravel() for column in varied.values()])
    )


def _fly(base, time, u, parameter, values, chosen, hold, threads, lanes, loops):
    runs, samples = len(values), len(time)
    y = np.empty((runs, samples, len(chosen)))
    status, done = np.zeros(runs, np.intc), np.zeros(runs, np.uintp)
    texts = ctypes.create_string_buffer(runs * _TEXT)
    arrays = [np.ascontiguousarray(time), np.ascontiguousarray(u), np.array(parameter, np.intc)]
    arrays += [np.ascontiguousarray(values, float), np.array(chosen, np.intc), y]
    t, inputs, names, table, output, result = (
        a.ctypes.data_as(POINTER(c_int if a.dtype == np.intc else c_double)) for a in arrays
    )
    modes = int(hold == "zero"), int(u.ndim == 3), lanes
    task = _Task(
        samples,
        len(parameter),
        len(chosen),
        t,
        inputs,
        names,
        table,
        output,
        result,
        *modes,
        len(loops),
        (_LoopStruct * len(loops))(*loops),
    )
    width = load_kernel().am_lanes(base.model.handle)
    statuses, counts = status.ctypes.data_as(POINTER(c_int)), done.ctypes.data_as(POINTER(c_size_t))

    def fly(first: int) -> None:
        if load_kernel().am_batch(
            base.handle, byref(task), first, min(first + width, runs), statuses, counts, texts
        ):
            raise MemoryError("no memory for a simulation of the batch")

    if runs <= width or (threads is None and runs * samples < _ALONE):
        for first in range(0, runs, width):
            fly(first)
    else:
        with ThreadPoolExecutor(max(1, min(runs, threads or os.cpu_count() or 1))) as pool:
            list(pool.map(fly, range(0, runs, width)))
    raw = texts.raw
    found = [
        raw[k * _TEXT : (k + 1) * _TEXT].split(b"\0", 1)[0].decode(errors="replace")
        for k in range(runs)
    ]
    return y, status, done.astype(int), found
