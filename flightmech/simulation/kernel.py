"""The compiled kernel through ctypes: loaded at the first use, never at import."""

from __future__ import annotations

import ctypes
import platform
import weakref
from collections.abc import Iterator, Sequence
from ctypes import POINTER, byref, c_char_p, c_double, c_int, c_longlong, c_size_t, c_void_p
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flightmech.errors import AeromatchError, SchemaError, SimulationError

FOLDER = Path(__file__).parents[1] / "_binaries"
SUFFIX = {"linux": ".so", "windows": ".dll", "darwin": ".dylib"}

INPUT, OUTPUT, PARAMETER, STATE, VARIABLE, TARGET, TERM, AXIS = range(8)
FIXED, INTEGER, LINEAR = 1, 2, 4

_doubles = POINTER(c_double)


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


class _EntryStruct(ctypes.Structure):
    _fields_ = (
        [(name, c_char_p) for name in CatalogueEntry._fields[:4]]
        + [(name, c_double) for name in CatalogueEntry._fields[4:7]]
        + [("flags", c_int)]
    )


class _Mover(ctypes.Structure):
    _fields_ = [("kind", c_int), ("index", c_int), ("unknown", c_int)]


class _TrimTask(ctypes.Structure):
    _fields_ = [(name, c_int) for name in ("path", "movers", "unknowns", "goals")]
    _fields_ += [
        ("mover", POINTER(_Mover)),
        ("low", _doubles),
        ("high", _doubles),
        ("size", _doubles),
    ]
    _fields_ += [("goal", POINTER(c_int)), ("wanted", _doubles)]


_SIGNATURES: dict[str, tuple[type | None, list]] = {
    "am_load": (c_void_p, [c_char_p, c_size_t, c_char_p, c_size_t]),
    "am_free": (None, [c_void_p]),
    "am_format": (c_int, []),
    "am_title": (c_char_p, [c_void_p]),
    "am_meta": (c_char_p, [c_void_p]),
    "am_count": (c_int, [c_void_p, c_int]),
    "am_entry_at": (c_int, [c_void_p, c_int, c_int, POINTER(_EntryStruct)]),
    "am_find": (c_int, [c_void_p, c_int, c_char_p]),
    "am_known": (c_char_p, [c_int, c_int]),
    "am_known_group": (c_char_p, [c_int, c_int]),
    "am_known_stage": (c_int, [c_int, c_int]),
    "am_group": (c_char_p, [c_int]),
    "am_new": (c_void_p, [c_void_p]),
    "am_delete": (None, [c_void_p]),
    "am_copy": (c_int, [c_void_p, c_void_p]),
    "am_error": (c_char_p, [c_void_p]),
    "am_time": (c_double, [c_void_p]),
    "am_set_parameter": (c_int, [c_void_p, c_int, c_double]),
    "am_get_parameter": (c_int, [c_void_p, c_int, _doubles]),
    "am_set_inputs": (c_int, [c_void_p, _doubles]),
    "am_initialize": (c_int, [c_void_p, c_double]),
    "am_trim": (c_int, [c_void_p, c_int]),
    "am_trim_for": (c_int, [c_void_p, POINTER(_TrimTask), _doubles, _doubles, _doubles, _doubles]),
    "am_step": (c_int, [c_void_p, c_double, c_double, _doubles, _doubles]),
    "am_outputs": (c_int, [c_void_p, _doubles]),
    "am_run": (c_int, [c_void_p, c_size_t, _doubles, _doubles, c_int, _doubles, POINTER(c_size_t)]),
    "am_record": (
        c_int,
        [
            c_void_p,
            c_size_t,
            _doubles,
            _doubles,
            c_int,
            POINTER(c_int),
            c_size_t,
            _doubles,
            _doubles,
            POINTER(c_size_t),
        ],
    ),
    "am_lanes": (c_int, [c_void_p]),
    "am_batch": (
        c_int,
        [c_void_p, c_void_p, c_size_t, c_size_t, POINTER(c_int), POINTER(c_size_t), c_void_p],
    ),
    "am_state_count": (c_int, [c_void_p]),
    "am_get_state": (c_int, [c_void_p, _doubles]),
    "am_set_state": (c_int, [c_void_p, _doubles]),
    "am_derivative": (c_int, [c_void_p, _doubles, _doubles, _doubles]),
    "am_complete_step": (c_int, [c_void_p, c_double]),
    "am_evaluate": (c_int, [c_void_p, c_size_t, _doubles, _doubles, _doubles]),
    "am_out_of_range": (c_int, [c_void_p, _doubles, _doubles]),
    "am_add_residuals": (c_int, [c_void_p, c_size_t, c_void_p, c_int]),
    "am_eliminate": (c_longlong, [c_void_p, c_size_t, _doubles, _doubles, _doubles, _doubles]),
    "am_substitute": (None, [c_int, c_size_t, _doubles, _doubles, c_size_t, _doubles]),
    "am_follow": (c_int, [c_void_p, c_size_t, _doubles, _doubles, _doubles]),
    "am_add_driven": (c_int, [c_void_p, c_void_p, _doubles, _doubles, _doubles]),
    "am_add_noise": (c_int, [c_void_p, c_size_t, _doubles, c_int, _doubles, _doubles, _doubles]),
}


@cache
def load_kernel() -> ctypes.CDLL:
    """Return the kernel of this machine.

    Raises
    ------
    AeromatchError
        When it has not been compiled.
    """
    folder = FOLDER / _platform()
    found = [folder / f"aeromatch_kernel{suffix}" for suffix in SUFFIX.values()]
    found = [path for path in found if path.is_file()]
    if not found:
        raise AeromatchError(
            f"no compiled kernel in {folder}; install the package, or run 'python "
            f"hatch_build.py' in a checkout"
        )
    kernel = ctypes.CDLL(str(found[0]))
    for name, (result, arguments) in _SIGNATURES.items():
        function = getattr(kernel, name)
        function.restype, function.argtypes = result, arguments
    return kernel


def _platform() -> str:

    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(
        platform.machine().lower(), platform.machine().lower()
    )
    return f"{machine}-{platform.system().lower()}"


class ComputableName(NamedTuple):
    """A name that the kernel can compute: its group, the pattern with a star for the item's name,
    the stage of a variable or target.
    """

    group: str
    pattern: str
    stage: int


@cache
def list_name_groups() -> tuple[str, ...]:
    """Return the groups of names, in the order of a block; the core is ``""``."""
    found: list[str] = []
    while (name := load_kernel().am_group(len(found))) is not None:
        found.append(name.decode())
    return tuple(found)


@cache
def computable_names(kind: int) -> tuple[ComputableName, ...]:
    """Return the names of one kind that the kernel can compute."""
    kernel = load_kernel()
    found: list[ComputableName] = []
    while (name := kernel.am_known(kind, len(found))) is not None:
        i = len(found)
        found.append(
            ComputableName(
                kernel.am_known_group(kind, i).decode(),
                name.decode(),
                kernel.am_known_stage(kind, i),
            )
        )
    return tuple(found)


class KernelModel:
    """A loaded block; immutable, may be shared by threads."""

    def __init__(self, block: bytes):
        kernel = load_kernel()
        text = ctypes.create_string_buffer(400)
        handle = kernel.am_load(block, len(block), text, len(text))
        if not handle:
            raise SchemaError(
                "model block", [text.value.decode(errors="replace").removeprefix("model block: ")]
            )
        self.handle = c_void_p(handle)
        weakref.finalize(self, kernel.am_free, self.handle)
        self._entries: dict[int, tuple[CatalogueEntry, ...]] = {}
        self._found: dict[
            tuple[int, str], int
        ] = {}  # names do not move, and every run sets the same ones

    def count(self, kind: int) -> int:
        """Return the number of inputs, outputs and so on."""
        return load_kernel().am_count(self.handle, kind)

    def find(self, kind: int, name: str) -> int:
        """Return the index of a name, -1 when there is none; parameters of tables are found here
        only, such as ``node.CL.basic[3,1]``.
        """
        index = self._found.get((kind, name))
        if index is None:
            index = self._found[kind, name] = load_kernel().am_find(
                self.handle, kind, name.encode()
            )
        return index

    def entries(self, kind: int) -> tuple[CatalogueEntry, ...]:
        """Return the catalogue of one kind, in the order of the kernel's arrays."""
        if kind not in self._entries:
            self._entries[kind] = tuple(self._read(kind))
        return self._entries[kind]

    def share_entries(self, other: KernelModel) -> None:
        """Take the catalogues that are read, or will be, of a model that differs in values of
        tables only.
        """
        self._entries = other._entries

    def _read(self, kind: int) -> Iterator[CatalogueEntry]:
        row = _EntryStruct()
        for i in range(self.count(kind)):
            load_kernel().am_entry_at(self.handle, kind, i, byref(row))
            name, units, display_units, description = (
                getattr(row, column).decode() for column in CatalogueEntry._fields[:4]
            )
            yield CatalogueEntry(
                name, units, display_units, description, row.value, row.low, row.high, row.flags
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
        copy = Simulation(self.model)
        copy._demand(load_kernel().am_copy(copy.handle, self.handle))
        return copy

    def set_parameter(self, index: int, value: float) -> None:
        """Set one parameter."""
        self._demand(load_kernel().am_set_parameter(self.handle, index, value))

    def parameter(self, index: int) -> float:
        """Return one parameter."""
        value = c_double()
        self._demand(load_kernel().am_get_parameter(self.handle, index, byref(value)))
        return value.value

    def set_inputs(self, u: Sequence[float] | np.ndarray) -> None:
        """Set all inputs, u (inputs,)."""
        self._demand(
            load_kernel().am_set_inputs(
                self.handle, _pointer(_checked(u, (self.model.count(INPUT),)))
            )
        )

    def initialize(self, time: float = 0.0) -> None:
        """Put the state to ``init.*``; trim when ``mode.trim`` requires it."""
        self._demand(load_kernel().am_initialize(self.handle, time))

    def trim(self, mode: int) -> None:
        """Trim by thrust (1) or throttle (2)."""
        self._demand(load_kernel().am_trim(self.handle, mode))

    def trim_for(
        self,
        path: int,
        movers: Sequence[tuple[int, int, int]],
        search: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
        goals: Sequence[int],
        wanted: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Solve for unknowns so that outputs take wanted values, as ``am_trim_for`` of kernel.h.

        Parameters
        ----------
        path : int
            0 climb angle given, 1 pitch attitude given, 2 on the ground.
        movers : sequence of (int, int, int)
            INPUT or PARAMETER, its index, the unknown it follows.
        search : tuple of array (unknown,)
            First guess, lower and upper limits, sizes.
        goals, wanted : sequence (goal,)
            Indices of outputs and their wanted values.

        Returns
        -------
        found, outputs, left, jacobian : array
            (unknown,), (output,), (goal,) and (goal, unknown), the last two weighed as
            accelerations. [m s-2]
        """
        n, m = len(search[0]), len(goals)
        found, low, high, size = (np.array(item, float) for item in search)
        aims = _checked(wanted, (m,))
        y, left, jacobian = np.empty(self.model.count(OUTPUT)), np.empty(m), np.empty((m, n))
        task = _TrimTask(
            path, len(movers), n, m, (_Mover * len(movers))(*(_Mover(*mover) for mover in movers))
        )
        task.low, task.high, task.size = map(_pointer, (low, high, size))
        task.goal, task.wanted = (c_int * m)(*goals), _pointer(aims)
        self._demand(
            load_kernel().am_trim_for(
                self.handle, byref(task), *map(_pointer, (found, y, left, jacobian))
            )
        )
        return found, y, left, jacobian

    def step(self, time: float, dt: float, u0: np.ndarray, u1: np.ndarray) -> None:
        """Advance by `dt` with inputs linear from `u0` to `u1`. [s]"""
        shape = (self.model.count(INPUT),)
        self._demand(
            load_kernel().am_step(
                self.handle, time, dt, _pointer(_checked(u0, shape)), _pointer(_checked(u1, shape))
            )
        )

    def outputs(self) -> np.ndarray:
        """Return all outputs (outputs,)."""
        y = np.empty(self.model.count(OUTPUT))
        self._demand(load_kernel().am_outputs(self.handle, _pointer(y)))
        return y

    def run(self, time: np.ndarray, u: np.ndarray, hold: bool) -> np.ndarray:
        """Return the outputs (time, outputs) under the inputs u (time, inputs)."""
        t = _checked(time, (len(time),))
        inputs = _checked(u, (len(t), self.model.count(INPUT)))
        y, done = np.empty((len(t), self.model.count(OUTPUT))), c_size_t()
        self._demand(
            load_kernel().am_run(
                self.handle,
                len(t),
                _pointer(t),
                _pointer(inputs),
                int(hold),
                _pointer(y),
                byref(done),
            )
        )
        return y

    def record(
        self, time: np.ndarray, u: np.ndarray, hold: bool, outputs: np.ndarray, terms: bool
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """Return the outputs of the indices `outputs` (time, chosen) and, on demand, the
        contribution of every term (time, terms).
        """
        t = _checked(time, (len(time),))
        inputs = _checked(u, (len(t), self.model.count(INPUT)))
        chosen = np.ascontiguousarray(outputs, np.intc)
        y, done = np.empty((len(t), len(chosen))), c_size_t()
        parts = np.empty((len(t), self.model.count(TERM))) if terms else None
        pointers = (
            _pointer(t),
            _pointer(inputs),
            int(hold),
            chosen.ctypes.data_as(POINTER(c_int)),
            len(chosen),
            _pointer(y),
        )
        self._demand(
            load_kernel().am_record(
                self.handle,
                len(t),
                *pointers,
                None if parts is None else _pointer(parts),
                byref(done),
            )
        )
        return y, parts

    @property
    def state(self) -> np.ndarray:
        """State (states,): position, velocity, quaternion, body rates, then the submodels;
        `entries` of STATE names them.
        """
        x = np.empty(load_kernel().am_state_count(self.model.handle))
        self._demand(load_kernel().am_get_state(self.handle, _pointer(x)))
        return x

    @state.setter
    def state(self, x: np.ndarray) -> None:
        self._demand(
            load_kernel().am_set_state(
                self.handle,
                _pointer(_checked(x, (load_kernel().am_state_count(self.model.handle),))),
            )
        )

    def derivative(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return the rate of the state `x` under the inputs `u`."""
        state, dx = (
            _checked(x, (load_kernel().am_state_count(self.model.handle),)),
            np.empty(len(x)),
        )
        inputs = _checked(u, (self.model.count(INPUT),))
        self._demand(
            load_kernel().am_derivative(
                self.handle, _pointer(state), _pointer(inputs), _pointer(dx)
            )
        )
        return dx

    def complete_step(self, time: float) -> None:
        """Let the clock and what is stepped discretely (weather, circuits) follow a state that was
        integrated outside. [s]
        """
        self._demand(load_kernel().am_complete_step(self.handle, time))

    def evaluate(self, variables: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return coefficients (n, 6) and contributions (n, terms) at model variables (n,
        variables).
        """
        v = np.atleast_2d(variables)  # a model of constants has no variables: (n, 0)
        v = _checked(v, (len(v), self.model.count(VARIABLE)))
        coefficients, terms = np.empty((len(v), 6)), np.empty((len(v), self.model.count(TERM)))
        self._demand(
            load_kernel().am_evaluate(
                self.handle, len(v), _pointer(v), _pointer(coefficients), _pointer(terms)
            )
        )
        return coefficients, terms

    def out_of_range(self) -> tuple[np.ndarray, np.ndarray]:
        """Return how many internal steps lay below and above the range of each axis (axes,)."""
        below, above = np.empty(self.model.count(AXIS)), np.empty(self.model.count(AXIS))
        self._demand(load_kernel().am_out_of_range(self.handle, _pointer(below), _pointer(above)))
        return below, above

    def _demand(self, status: int) -> None:
        if status:
            raise SimulationError(
                load_kernel().am_error(self.handle).decode(errors="replace"),
                load_kernel().am_time(self.handle),
            )


class Stepping:
    """Steps and outputs of a simulation through arrays that stay in place: for loops that are
    closed sample by sample.

    Attributes
    ----------
    ends : array (2, inputs)
        Inputs at both ends of the next step.
    y : array (outputs,)
        What `outputs` found last.
    """

    def __init__(self, simulation: Simulation):
        kernel = load_kernel()
        self._simulation, self._step, self._outputs = simulation, kernel.am_step, kernel.am_outputs
        self.ends, self.y = (
            np.zeros((2, simulation.model.count(INPUT))),
            np.empty(simulation.model.count(OUTPUT)),
        )
        self._pointers = _pointer(self.ends[0]), _pointer(self.ends[1])
        self._y = _pointer(self.y)

    def step(self, time: float, dt: float) -> None:
        """Advance by `dt` with inputs linear between `ends`. [s]"""
        self._simulation._demand(self._step(self._simulation.handle, time, dt, *self._pointers))

    def outputs(self) -> np.ndarray:
        """Return all outputs (outputs,), in the same array every time."""
        self._simulation._demand(self._outputs(self._simulation.handle, self._y))
        return self.y


def _pointer(array: np.ndarray):
    return array.ctypes.data_as(_doubles)


def _checked(array, shape: tuple[int, ...]) -> np.ndarray:
    found = np.ascontiguousarray(array, float)
    if found.shape != shape:
        raise ValueError(f"array has the shape {found.shape}, expected {shape}")
    return found
