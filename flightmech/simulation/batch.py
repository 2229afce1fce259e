"""Many runs of one record with different parameters, on all processors."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from ctypes import POINTER, byref, c_size_t
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError, SimulationError
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import OUTPUT, Simulation
from flightmech.simulation.kernel_library import (
    DOUBLES,
    INTEGERS,
    BatchTaskStruct,
    LoopStruct,
    load_kernel,
)
from flightmech.simulation.run import (
    Stated,
    check_hold,
    index_of_parameter,
    output_attributes,
    output_indices,
    read_inputs,
    read_time,
    values_in_si,
)
from flightmech.simulation.stated_values.odd_values import warn_of_odd_values

MOST_LOOPS = 16  # AM_MOST_LOOPS of kernel.h
_TEXT_SIZE = 200  # AM_TEXT of kernel.h: size of the text of a failure [bytes]
# Samples of all runs below which the start of threads takes longer than it saves.
_SINGLE_THREAD = 10_000


class Parallelism(NamedTuple):
    """Division of the runs of a batch among threads and the lanes of the processor.

    Attributes
    ----------
    threads : int or None
        Number of threads. None: one per processor, or one for a small batch.
    lanes : int
        Largest number of runs at once in a thread: that of the lanes of the processor (0), 1, or 4.
    """

    threads: int | None = None
    lanes: int = 0


class ControlLoop(NamedTuple):
    """A proportional and integral loop, closed at each sample.

    ``gain e + integral * Int e dt`` is added to an input, with e = target - output.

    Attributes
    ----------
    input, output : str
        Names of the input and of the output.
    gain, integral, limit : float
        Gains, and largest size of the correction. [input / output], [input / output / s], [input]
    target : array (time,)
        Target of the output. [SI]
    turns : bool
        Whether the output is an angle. Its error is then reduced to less than half a turn.
    """

    input: str
    output: str
    gain: float
    integral: float
    limit: float
    target: np.ndarray
    turns: bool = False


def simulate_batch(
    sim: SimModel,
    inputs: xr.Dataset,
    varied: Mapping[str, Sequence[float] | np.ndarray],
    parameters: Mapping[str, Stated] | None = None,
    outputs: Sequence[str] | None = None,
    hold: str = "linear",
    step: float = 0.01,
    threads: int | None = None,
    failed: str = "raise",
    lanes: int = 0,
) -> xr.Dataset:
    """Simulate one record many times with different parameters.

    The runs share the compiled model.  Each thread computes several runs at once in the lanes of
    the processor.  The result of a run depends neither on the number of threads nor on that of
    lanes.

    Parameters
    ----------
    sim : SimModel
        The compiled model.
    inputs, parameters, hold, step
        As in `simulate`, for all runs. A variable of `inputs` may also have the dimensions (run,
        time).
    varied : mapping of str to array (run,)
        The parameters that differ: any parameter of the model, or a part of a table,
        ``node.CL.basic[3,1]``, ``table.CL.basic`` (its scale), ``offset.CL.gear.K1``. [SI]
    outputs : sequence of str, optional
        Outputs to return. Default: all.
    threads : int, optional
        Number of threads. Default: one per processor, or one for a small batch.
    failed : {"raise", "nan"}
        Effect of a run that fails: an error, or NaN after the last good sample with the reason in
        ``failure``.
    lanes : int, optional
        Largest number of runs at once in a thread: that of the lanes of the processor (0), 1, or 4.

    Returns
    -------
    Dataset (run, time)
        The chosen outputs. ``failure`` (run,) is empty for a complete run.

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
    # values (run, parameter)
    values = _join_columns(varied)
    time = read_time(inputs)
    constant = {"mode.step": step, **values_in_si(sim, parameters)}
    u = read_inputs(sim, inputs, constant, count=len(time), runs=len(values))
    warn_of_odd_values(sim, constant, inputs)
    y, done, failures = fly_batch(
        sim,
        time,
        u=u,
        varied=list(varied),
        values=values,
        constant=constant,
        outputs=outputs,
        hold=hold,
        parallelism=Parallelism(threads, lanes),
    )
    # a text means that the run failed; its time is that of the first missing sample
    if failed == "raise":
        for run, text in enumerate(failures):
            if text:
                failure_time = float(time[min(done[run], len(time) - 1)])
                raise SimulationError(f"run {run}: {text}", failure_time)
    columns: dict[str, Any] = {}
    for k, i in enumerate(output_indices(sim, outputs)):
        row = sim.entries(OUTPUT)[i]
        columns[row.name] = (("run", "time"), y[:, :, k], output_attributes(row))
    meaning = {"long_name": "why a run ended early"}
    columns["failure"] = ("run", np.array(failures, object), meaning)
    coords: dict[str, Any] = {"time": ("time", time, {"units": "s"})}
    for k, name in enumerate(varied):
        coords[name] = ("run", values[:, k])
    attributes = {"title": sim.title, "step": float(constant["mode.step"]), "hold": hold}
    return xr.Dataset(columns, coords, attributes)


def fly_batch(
    sim: SimModel,
    time: np.ndarray,
    u: np.ndarray,
    varied: Sequence[str],
    values: np.ndarray,
    constant: Mapping[str, float],
    outputs: Sequence[str] | None = None,
    hold: str = "linear",
    parallelism: Parallelism | None = None,
    loops: Sequence[ControlLoop] = (),
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Simulate a batch on plain arrays, without the checks of `simulate_batch`.

    It is for many small batches.

    Parameters
    ----------
    sim, outputs, hold
        As in `simulate_batch`.
    time : array (time,)
        Rising. [s]
    u : array (time, inputs) or (run, time, inputs)
    varied, values : names, and array (run, name)
        The parameters that differ.
    constant : mapping of str to float
        Parameters of all runs.
    parallelism : Parallelism, optional
    loops : sequence of ControlLoop
        At most `MOST_LOOPS`. A correction acts from its sample to the next, at both ends of the
        step.

    Returns
    -------
    y : array (run, time, output)
        NaN after the last good sample of a run that failed.
    done : array of int (run,)
        Numbers of good samples.
    failures : list of str
        Empty for a complete run.
    """
    parallelism = parallelism or Parallelism()
    base = _make_base(sim, constant)
    task = _BatchTask(
        sim,
        time,
        u=u,
        parameters=[index_of_parameter(sim, name) for name in varied],
        values=values,
        chosen=output_indices(sim, outputs),
        is_constant=hold == "zero",
        lanes=parallelism.lanes,
        loops=loops,
    )
    task.run(base, parallelism.threads)
    # the kernel does not write samples after a failure
    for run in np.flatnonzero(task.status):
        task.y[run, task.done[run] :] = np.nan
    return task.y, task.done.astype(int), task.failures()


def _make_base(sim: SimModel, constant: Mapping[str, float]) -> Simulation:
    """Return a simulation with the parameters of all runs, of which every run is a copy."""
    base = Simulation(sim.model)
    for name, value in constant.items():
        if name not in sim.inputs:
            base.set_parameter(index_of_parameter(sim, name), float(value))
    return base


def _join_columns(varied: Mapping[str, Sequence[float] | np.ndarray]) -> np.ndarray:
    """Return the values (run, parameter) of the varied parameters."""
    lengths = {name: np.size(column) for name, column in varied.items()}
    if not lengths or len(set(lengths.values())) != 1:
        text = ", ".join(f"{name} {length}" for name, length in lengths.items()) or "none"
        raise SchemaError(
            "varied parameters",
            [f"every parameter needs one value per run; lengths found: {text}"],
        )
    columns = [np.asarray(column, float).ravel() for column in varied.values()]
    return np.ascontiguousarray(np.column_stack(columns))


class _BatchTask:
    """The task of a batch for the kernel, with the arrays that it reads and writes.

    `y` (run, time, output) are the outputs, `status` (run,) is not zero for a failure, and `done`
    (run,) are the numbers of good samples.
    """

    def __init__(
        self,
        sim: SimModel,
        time: np.ndarray,
        *,
        u: np.ndarray,
        parameters: Sequence[int],
        values: np.ndarray,
        chosen: np.ndarray,
        is_constant: bool,
        lanes: int,
        loops: Sequence[ControlLoop],
    ):
        self.runs, self.samples = len(values), len(time)
        self.y = np.empty((self.runs, self.samples, len(chosen)))
        self.status = np.zeros(self.runs, np.intc)
        self.done = np.zeros(self.runs, np.uintp)
        self.texts = ctypes.create_string_buffer(self.runs * _TEXT_SIZE)
        # attributes: the arrays must stay in memory as long as the task
        self.time = np.ascontiguousarray(time)
        self.inputs = np.ascontiguousarray(u)
        self.parameters = np.array(parameters, np.intc)
        self.values = np.ascontiguousarray(values, float)
        self.chosen = np.array(chosen, np.intc)
        self.targets = [
            np.ascontiguousarray(np.broadcast_to(loop.target, time.shape), float) for loop in loops
        ]
        # the structure has pointers to all these arrays
        structs = _pack_loops(sim, loops, self.targets)
        self.struct = BatchTaskStruct(
            samples=self.samples,
            parameters=len(parameters),
            outputs=len(chosen),
            t=self.time.ctypes.data_as(DOUBLES),
            u=self.inputs.ctypes.data_as(DOUBLES),
            parameter=self.parameters.ctypes.data_as(INTEGERS),
            values=self.values.ctypes.data_as(DOUBLES),
            output=self.chosen.ctypes.data_as(INTEGERS),
            y=self.y.ctypes.data_as(DOUBLES),
            # 1: inputs are constant between samples, 0: linear
            hold=int(is_constant),
            # 1: every run has inputs of its own, (run, time, inputs)
            each_inputs=int(u.ndim == 3),
            lanes=lanes,
            loops=len(structs),
            loop=(LoopStruct * len(structs))(*structs),
        )

    def run(self, base: Simulation, threads: int | None) -> None:
        """Simulate all runs, from copies of `base`."""
        kernel = load_kernel()
        # the kernel computes `width` runs in one call
        width = kernel.am_lanes(base.model.handle)
        status = self.status.ctypes.data_as(INTEGERS)
        done = self.done.ctypes.data_as(POINTER(c_size_t))

        def run_group(first: int) -> None:
            runs = (first, min(first + width, self.runs))
            results = (status, done, self.texts)
            if kernel.am_batch(base.handle, byref(self.struct), *runs, *results):
                raise MemoryError("no memory for a simulation of the batch")

        groups = range(0, self.runs, width)
        is_small = threads is None and self.runs * self.samples < _SINGLE_THREAD
        if self.runs <= width or is_small:
            for first in groups:
                run_group(first)
            return
        workers = min(self.runs, threads or os.cpu_count() or 1)
        with ThreadPoolExecutor(max(1, workers)) as pool:
            list(pool.map(run_group, groups))  # list raises the errors of the threads

    def failures(self) -> list[str]:
        """Return the text of each run, empty for a complete run."""
        raw = self.texts.raw
        texts = []
        for start in range(0, len(raw), _TEXT_SIZE):
            # texts have a fixed size and end with a zero byte
            text = raw[start : start + _TEXT_SIZE].split(b"\0", 1)[0]
            texts.append(text.decode(errors="replace"))
        return texts[: self.runs]


def _pack_loops(
    sim: SimModel, loops: Sequence[ControlLoop], targets: Sequence[np.ndarray]
) -> list[LoopStruct]:
    """Return the structures of loops, with pointers to their targets."""
    structs = []
    outputs = output_indices(sim, [loop.output for loop in loops]).tolist()
    for loop, output, target in zip(loops, outputs, targets, strict=True):
        structs.append(
            LoopStruct(
                input=sim.inputs.index(loop.input),
                output=output,
                turns=loop.turns,
                gain=loop.gain,
                integral=loop.integral,
                limit=loop.limit,
                target=target.ctypes.data_as(DOUBLES),
            )
        )
    return structs
