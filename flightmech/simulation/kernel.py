"""Models and simulations of the compiled kernel, with the names that it can compute."""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Iterator, Sequence
from ctypes import POINTER, byref, c_double, c_int, c_size_t, c_void_p
from functools import cache
from typing import NamedTuple

import numpy as np

from flightmech.errors import SchemaError, SimulationError
from flightmech.simulation.kernel_library import (
    EntryStruct,
    MoverStruct,
    TrimTaskStruct,
    check_array,
    double_pointer,
    load_kernel,
)

# Kinds of entries, and flags of an entry, of kernel.h.
INPUT, OUTPUT, PARAMETER, STATE, VARIABLE, TARGET, TERM, AXIS = range(8)
FIXED, INTEGER, LINEAR = 1, 2, 4
_ERROR_SIZE = 400  # of the text of an error [bytes]


class CatalogueEntry(NamedTuple):
    """One row of the catalogue of a model, as in ``am_entry`` of kernel.h."""

    name: str
    units: str
    display_units: str
    description: str
    value: float
    low: float
    high: float
    flags: int


class ComputableName(NamedTuple):
    """A name that the kernel can compute.

    `pattern` has a star in place of the name of an item, `stage` is that of a variable or target.
    """

    group: str
    pattern: str
    stage: int


@cache
def list_name_groups() -> tuple[str, ...]:
    """Return the groups of names, in the order of a block; the core is ``""``."""
    kernel = load_kernel()
    groups: list[str] = []
    # the kernel returns a null pointer after the last group
    while (name := kernel.am_group(len(groups))) is not None:
        groups.append(name.decode())
    return tuple(groups)


@cache
def computable_names(kind: int) -> tuple[ComputableName, ...]:
    """Return the names of one kind that the kernel can compute."""
    kernel = load_kernel()
    names: list[ComputableName] = []
    # the kernel returns a null pointer after the last name
    while (pattern := kernel.am_known(kind, len(names))) is not None:
        group = kernel.am_known_group(kind, len(names)).decode()
        stage = kernel.am_known_stage(kind, len(names))
        names.append(ComputableName(group, pattern.decode(), stage))
    return tuple(names)


class KernelModel:
    """A loaded block; immutable, may be shared by threads."""

    def __init__(self, block: bytes):
        kernel = load_kernel()
        text = ctypes.create_string_buffer(_ERROR_SIZE)
        handle = kernel.am_load(block, len(block), text, len(text))
        if not handle:
            problem = text.value.decode(errors="replace").removeprefix("model block: ")
            raise SchemaError("model block", [problem])
        self.handle = c_void_p(handle)
        weakref.finalize(self, kernel.am_free, self.handle)
        self._entries: dict[int, tuple[CatalogueEntry, ...]] = {}
        # Indices by kind and name: they do not change, and every run sets the same names.
        self._indices: dict[tuple[int, str], int] = {}

    def count(self, kind: int) -> int:
        """Return the number of inputs, outputs and so on."""
        return load_kernel().am_count(self.handle, kind)

    def find(self, kind: int, name: str) -> int:
        """Return the index of a name, or -1.

        Parameters of tables, such as ``node.CL.basic[3,1]``, have an index, but no entry.
        """
        index = self._indices.get((kind, name))
        if index is None:
            index = load_kernel().am_find(self.handle, kind, name.encode())
            self._indices[kind, name] = index
        return index

    def entries(self, kind: int) -> tuple[CatalogueEntry, ...]:
        """Return the catalogue of one kind, in the order of the kernel's arrays."""
        if kind not in self._entries:
            self._entries[kind] = tuple(self._read_entries(kind))
        return self._entries[kind]

    def share_entries(self, source: KernelModel) -> None:
        """Use the catalogues of a model that differs in values of tables only."""
        self._entries = source._entries

    def _read_entries(self, kind: int) -> Iterator[CatalogueEntry]:
        # the kernel fills the same structure for every row
        row = EntryStruct()
        for i in range(self.count(kind)):
            load_kernel().am_entry_at(self.handle, kind, i, byref(row))
            yield CatalogueEntry(
                name=row.name.decode(),
                units=row.units.decode(),
                display_units=row.display_units.decode(),
                description=row.description.decode(),
                value=row.value,
                low=row.low,
                high=row.high,
                flags=row.flags,
            )

    @property
    def title(self) -> str:
        """Name of the aircraft."""
        return load_kernel().am_title(self.handle).decode()

    @property
    def meta(self) -> str:
        """Provenance as JSON text."""
        return load_kernel().am_meta(self.handle).decode()


class Simulation:
    """States, inputs and parameters of one run; `copy` makes a rollback point."""

    def __init__(self, model: KernelModel):
        kernel = load_kernel()
        handle = kernel.am_new(model.handle)
        if not handle:
            raise MemoryError("no memory for a simulation")
        self.model, self.handle = model, c_void_p(handle)
        weakref.finalize(self, kernel.am_delete, self.handle)

    def copy(self) -> Simulation:
        """Return an independent simulation in the same state."""
        # the model is shared; states, inputs and parameters are copied
        copy = Simulation(self.model)
        copy._check(load_kernel().am_copy(copy.handle, self.handle))
        return copy

    def set_parameter(self, index: int, value: float) -> None:
        """Set one parameter."""
        self._check(load_kernel().am_set_parameter(self.handle, index, value))

    def parameter(self, index: int) -> float:
        """Return one parameter."""
        value = c_double()
        self._check(load_kernel().am_get_parameter(self.handle, index, byref(value)))
        return value.value

    def set_inputs(self, u: Sequence[float] | np.ndarray) -> None:
        """Set all inputs, u (inputs,)."""
        inputs = self._check_inputs(u)
        self._check(load_kernel().am_set_inputs(self.handle, double_pointer(inputs)))

    def initialize(self, time: float = 0.0) -> None:
        """Set the state to ``init.*``, with a trim if ``mode.trim`` requires it."""
        self._check(load_kernel().am_initialize(self.handle, time))

    def trim(self, mode: int) -> None:
        """Trim by thrust (1) or throttle (2)."""
        self._check(load_kernel().am_trim(self.handle, mode))

    def trim_for(
        self,
        path: int,
        movers: Sequence[tuple[int, int, int]],
        search: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
        goals: Sequence[int],
        targets: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Solve for unknowns so that outputs reach targets, as ``am_trim_for`` of kernel.h.

        Parameters
        ----------
        path : int
            0 climb angle given, 1 pitch attitude given, 2 on the ground.
        movers : sequence of (int, int, int)
            STATE, PARAMETER or INPUT, its index, the unknown that it follows.
        search : tuple of array (unknown,)
            First guess, lower and upper limits, sizes.
        goals, targets : sequence (goal,)
            Indices of outputs and their target values.

        Returns
        -------
        solution, outputs, residual, jacobian : array
            (unknown,), (output,), (goal,) and (goal, unknown). The last two are weighted as
            accelerations. [m s-2]
        """
        unknown_count, goal_count = len(search[0]), len(goals)
        # copies: the kernel replaces the first guess by the solution
        solution, low, high, size = (np.array(item, float) for item in search)
        target_values = check_array(targets, (goal_count,))
        # results of the kernel
        y = np.empty(self.model.count(OUTPUT))
        residual = np.empty(goal_count)
        jacobian = np.empty((goal_count, unknown_count))
        # ctypes keeps these arrays in memory as long as the task
        structs = [MoverStruct(*mover) for mover in movers]
        task = TrimTaskStruct(path, len(movers), unknown_count, goal_count)
        task.mover = (MoverStruct * len(movers))(*structs)
        task.low, task.high, task.size = map(double_pointer, (low, high, size))
        task.goal = (c_int * goal_count)(*goals)
        task.wanted = double_pointer(target_values)
        results = map(double_pointer, (solution, y, residual, jacobian))
        self._check(load_kernel().am_trim_for(self.handle, byref(task), *results))
        return solution, y, residual, jacobian

    def step(self, time: float, dt: float, u0: np.ndarray, u1: np.ndarray) -> None:
        """Advance by `dt` with inputs linear from `u0` to `u1`. [s]"""
        first, last = self._check_inputs(u0), self._check_inputs(u1)
        pointers = double_pointer(first), double_pointer(last)
        self._check(load_kernel().am_step(self.handle, time, dt, *pointers))

    def outputs(self) -> np.ndarray:
        """Return all outputs (outputs,)."""
        y = np.empty(self.model.count(OUTPUT))
        self._check(load_kernel().am_outputs(self.handle, double_pointer(y)))
        return y

    def run(self, time: np.ndarray, u: np.ndarray, hold: bool) -> np.ndarray:
        """Return the outputs (time, outputs) under the inputs u (time, inputs)."""
        # `done` counts the good samples; a failure raises an error with its time
        t = check_array(time, (len(time),))
        inputs = check_array(u, (len(t), self.model.count(INPUT)))
        y, done = np.empty((len(t), self.model.count(OUTPUT))), c_size_t()
        record = (len(t), double_pointer(t), double_pointer(inputs), int(hold))
        self._check(load_kernel().am_run(self.handle, *record, double_pointer(y), byref(done)))
        return y

    def record(
        self, time: np.ndarray, u: np.ndarray, hold: bool, outputs: np.ndarray, terms: bool
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """Return some outputs of a run, and the contributions of the terms.

        Parameters
        ----------
        time, u : array (time,), (time, inputs)
            The record. [s], [SI]
        hold : bool
            Whether inputs are constant between samples, not linear.
        outputs : array of int (chosen,)
            Indices of the outputs to return.
        terms : bool
            Whether to return the contributions.

        Returns
        -------
        y : array (time, chosen)
        contributions : array (time, terms), or None
        """
        t = check_array(time, (len(time),))
        inputs = check_array(u, (len(t), self.model.count(INPUT)))
        chosen = np.ascontiguousarray(outputs, np.intc)
        y, done = np.empty((len(t), len(chosen))), c_size_t()
        contributions, contribution_pointer = None, None
        if terms:
            contributions = np.empty((len(t), self.model.count(TERM)))
            contribution_pointer = double_pointer(contributions)
        record = (len(t), double_pointer(t), double_pointer(inputs), int(hold))
        columns = (chosen.ctypes.data_as(POINTER(c_int)), len(chosen))
        results = (double_pointer(y), contribution_pointer, byref(done))
        self._check(load_kernel().am_record(self.handle, *record, *columns, *results))
        return y, contributions

    @property
    def state(self) -> np.ndarray:
        """State (states,): position, velocity, quaternion, body rates, then the submodels.

        `entries` of STATE returns the names.
        """
        x = np.empty(load_kernel().am_state_count(self.model.handle))
        self._check(load_kernel().am_get_state(self.handle, double_pointer(x)))
        return x

    @state.setter
    def state(self, x: np.ndarray) -> None:
        state = self._check_state(x)
        self._check(load_kernel().am_set_state(self.handle, double_pointer(state)))

    def derivative(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return the rate of the state `x` under the inputs `u`."""
        state, inputs = self._check_state(x), self._check_inputs(u)
        dx = np.empty(len(x))
        pointers = map(double_pointer, (state, inputs, dx))
        self._check(load_kernel().am_derivative(self.handle, *pointers))
        return dx

    def complete_step(self, time: float) -> None:
        """Update clock, weather and circuits after an integration of the state outside. [s]"""
        self._check(load_kernel().am_complete_step(self.handle, time))

    def evaluate(self, variables: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return coefficients and contributions of the terms at model variables.

        Parameters
        ----------
        variables : array (n, variables)

        Returns
        -------
        coefficients, contributions : array (n, 6), (n, terms)
        """
        # a model of constants has no variables: (n, 0)
        rows = np.atleast_2d(variables)
        rows = check_array(rows, (len(rows), self.model.count(VARIABLE)))
        coefficients = np.empty((len(rows), 6))
        contributions = np.empty((len(rows), self.model.count(TERM)))
        pointers = map(double_pointer, (rows, coefficients, contributions))
        self._check(load_kernel().am_evaluate(self.handle, len(rows), *pointers))
        return coefficients, contributions

    def out_of_range(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the numbers of internal steps below and above the range of each axis (axes,)."""
        below, above = np.empty(self.model.count(AXIS)), np.empty(self.model.count(AXIS))
        pointers = double_pointer(below), double_pointer(above)
        self._check(load_kernel().am_out_of_range(self.handle, *pointers))
        return below, above

    def _check_inputs(self, u: Sequence[float] | np.ndarray) -> np.ndarray:
        return check_array(u, (self.model.count(INPUT),))

    def _check_state(self, x: np.ndarray) -> np.ndarray:
        return check_array(x, (load_kernel().am_state_count(self.model.handle),))

    def _check(self, status: int) -> None:
        """Raise SimulationError with the text and the time of the kernel if a call failed."""
        if status:
            kernel = load_kernel()
            text = kernel.am_error(self.handle).decode(errors="replace")
            raise SimulationError(text, kernel.am_time(self.handle))


class Stepping:
    """Steps and outputs of a simulation through constant arrays.

    It is for loops that are closed sample by sample, where new arrays for each step are slow.

    Attributes
    ----------
    ends : array (2, inputs)
        Inputs at both ends of the next step.
    y : array (outputs,)
        Result of the last call of `outputs`.
    """

    def __init__(self, simulation: Simulation):
        kernel = load_kernel()
        self._simulation, self._step, self._outputs = simulation, kernel.am_step, kernel.am_outputs
        # The pointers stay valid because the arrays are never replaced.
        self.ends = np.zeros((2, simulation.model.count(INPUT)))
        self.y = np.empty(simulation.model.count(OUTPUT))
        self._pointers = double_pointer(self.ends[0]), double_pointer(self.ends[1])
        self._y = double_pointer(self.y)

    def step(self, time: float, dt: float) -> None:
        """Advance by `dt` with inputs linear between `ends`. [s]"""
        self._simulation._check(self._step(self._simulation.handle, time, dt, *self._pointers))

    def outputs(self) -> np.ndarray:
        """Return all outputs (outputs,), in the same array every time."""
        self._simulation._check(self._outputs(self._simulation.handle, self._y))
        return self.y
