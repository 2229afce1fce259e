"""The compiled kernel through ctypes: its structures, its functions and its loading.

The kernel is loaded at the first use, never at import.
"""

from __future__ import annotations

import ctypes
import platform
from collections.abc import Sequence
from ctypes import (
    POINTER,
    c_char_p,
    c_double,
    c_int,
    c_longlong,
    c_size_t,
    c_ubyte,
    c_void_p,
)
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from flightmech.errors import AeromatchError

# The build writes the libraries here, one folder per platform.
FOLDER = Path(__file__).parents[1] / "_binaries"
# Suffix of a shared library by system.
SUFFIX = {"linux": ".so", "windows": ".dll", "darwin": ".dylib"}
# Pointers to arrays of the kernel.
DOUBLES, INTEGERS = POINTER(c_double), POINTER(c_int)
# Names of the processors, where platform.machine() differs from those of the folders.
_PROCESSORS = {"amd64": "x86_64", "arm64": "aarch64"}


class EntryStruct(ctypes.Structure):
    """``am_entry`` of kernel.h: a row of the catalogue."""

    _fields_ = [
        ("name", c_char_p),
        ("units", c_char_p),
        ("display_units", c_char_p),
        ("description", c_char_p),
        ("value", c_double),
        ("low", c_double),
        ("high", c_double),
        ("flags", c_int),
    ]


class MoverStruct(ctypes.Structure):
    """``am_mover`` of kernel.h: a state, input or parameter, and its unknown."""

    _fields_ = [("kind", c_int), ("index", c_int), ("unknown", c_int)]


class TrimTaskStruct(ctypes.Structure):
    """``am_trim_task`` of kernel.h: unknowns with their limits, and outputs with their targets."""

    _fields_ = [
        ("path", c_int),
        ("movers", c_int),
        ("unknowns", c_int),
        ("goals", c_int),
        ("mover", POINTER(MoverStruct)),
        ("low", DOUBLES),
        ("high", DOUBLES),
        ("size", DOUBLES),
        ("goal", INTEGERS),
        ("wanted", DOUBLES),
    ]


class PathStruct(ctypes.Structure):
    """``am_path`` of kernel.h: states, rates, specific force, the step and the surroundings."""

    _fields_ = [
        ("x", DOUBLES),
        ("rates", DOUBLES),
        ("force", DOUBLES),
        ("dt", c_double),
        ("gravity", c_double),
        ("fall", c_double),
        ("level", c_double),
        ("spin", c_double * 3),
        ("transport", c_double * 9),
        ("sensed", c_double * 3),
    ]


class DriveStruct(ctypes.Structure):
    """``am_drive`` of kernel.h."""

    _fields_ = [
        ("path", PathStruct),
        ("states", c_int),
        ("inputs", c_int),
        ("vanes", c_int),
        ("gusts", c_int),
        ("side", c_int * 2),
        ("input", INTEGERS),
        ("slow", POINTER(c_ubyte)),
        ("sensed", DOUBLES),
        ("gain", c_double * 6),
        ("arm", c_double * 3),
        ("wind", c_double * 3),
        ("vane_arm", c_double * 6),
        ("lag", c_double * 3),
        ("lag_slope", c_double * 3),
    ]


class SumsStruct(ctypes.Structure):
    """``am_normal`` of kernel.h."""

    _fields_ = [
        ("states", c_int),
        ("constants", c_int),
        ("D", DOUBLES),
        ("O", DOUBLES),
        ("G", DOUBLES),
        ("C", DOUBLES),
        ("gx", DOUBLES),
        ("gc", DOUBLES),
        ("cost", DOUBLES),
    ]


class DrivenStruct(ctypes.Structure):
    """``am_driven`` of kernel.h."""

    _fields_ = [("states", c_int), ("columns", c_int), ("unknowns", c_int), ("X", DOUBLES)]


class ResidualsStruct(ctypes.Structure):
    """``am_residuals`` of kernel.h."""

    _fields_ = [
        ("rows", c_int),
        ("states", c_int),
        ("columns", c_int),
        ("column", INTEGERS),
        ("r", DOUBLES),
        ("weight", DOUBLES),
        ("J", DOUBLES),
    ]


class GroupStruct(ctypes.Structure):
    """``am_residual_group`` of kernel.h."""

    _fields_ = [
        ("given", ResidualsStruct),
        ("count", c_size_t),
        ("A", DOUBLES),
        ("B", DOUBLES),
        ("drive", POINTER(DriveStruct)),
        ("same", c_int),
        ("k", POINTER(c_longlong)),
        ("f", DOUBLES),
    ]


class LoopStruct(ctypes.Structure):
    """``am_loop`` of kernel.h."""

    _fields_ = [
        ("input", c_int),
        ("output", c_int),
        ("turns", c_int),
        ("gain", c_double),
        ("integral", c_double),
        ("limit", c_double),
        ("target", DOUBLES),
    ]


class BatchTaskStruct(ctypes.Structure):
    """``am_batch_task`` of kernel.h."""

    _fields_ = [
        ("samples", c_size_t),
        ("parameters", c_size_t),
        ("outputs", c_size_t),
        ("t", DOUBLES),
        ("u", DOUBLES),
        ("parameter", INTEGERS),
        ("values", DOUBLES),
        ("output", INTEGERS),
        ("y", DOUBLES),
        ("hold", c_int),
        ("each_inputs", c_int),
        ("lanes", c_int),
        ("loops", c_size_t),
        ("loop", POINTER(LoopStruct)),
    ]


class CircuitStruct(ctypes.Structure):
    """``am_circuit`` of kernel.h."""

    _fields_ = [
        ("bodies", c_int),
        ("bristles", c_int),
        ("unknowns", c_int),
        ("powers", c_int),
        ("parts", c_int),
        ("step", c_double),
        ("gearing", c_double),
        ("constants", DOUBLES),
        ("by_constants", DOUBLES),
        ("start", DOUBLES),
        ("by_start", DOUBLES),
        ("bend", DOUBLES),
        ("by_bend", DOUBLES),
        ("force", DOUBLES),
        ("by_force", DOUBLES),
        ("moment", DOUBLES),
        ("by_moment", DOUBLES),
        ("edge", DOUBLES),
        ("by_edge", DOUBLES),
    ]


# Result and arguments of each function of kernel.h.
SIGNATURES: dict[str, tuple[type | None, list[Any]]] = {
    "am_load": (c_void_p, [c_char_p, c_size_t, c_char_p, c_size_t]),
    "am_free": (None, [c_void_p]),
    "am_format": (c_int, []),
    "am_title": (c_char_p, [c_void_p]),
    "am_meta": (c_char_p, [c_void_p]),
    "am_count": (c_int, [c_void_p, c_int]),
    "am_entry_at": (c_int, [c_void_p, c_int, c_int, POINTER(EntryStruct)]),
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
    "am_get_parameter": (c_int, [c_void_p, c_int, DOUBLES]),
    "am_set_inputs": (c_int, [c_void_p, DOUBLES]),
    "am_initialize": (c_int, [c_void_p, c_double]),
    "am_trim": (c_int, [c_void_p, c_int]),
    "am_trim_for": (c_int, [c_void_p, POINTER(TrimTaskStruct), DOUBLES, DOUBLES, DOUBLES, DOUBLES]),
    "am_step": (c_int, [c_void_p, c_double, c_double, DOUBLES, DOUBLES]),
    "am_outputs": (c_int, [c_void_p, DOUBLES]),
    "am_run": (c_int, [c_void_p, c_size_t, DOUBLES, DOUBLES, c_int, DOUBLES, POINTER(c_size_t)]),
    "am_record": (
        c_int,
        [
            c_void_p,
            c_size_t,
            DOUBLES,
            DOUBLES,
            c_int,
            INTEGERS,
            c_size_t,
            DOUBLES,
            DOUBLES,
            POINTER(c_size_t),
        ],
    ),
    "am_lanes": (c_int, [c_void_p]),
    "am_batch": (
        c_int,
        [c_void_p, c_void_p, c_size_t, c_size_t, INTEGERS, POINTER(c_size_t), c_void_p],
    ),
    "am_state_count": (c_int, [c_void_p]),
    "am_get_state": (c_int, [c_void_p, DOUBLES]),
    "am_set_state": (c_int, [c_void_p, DOUBLES]),
    "am_derivative": (c_int, [c_void_p, DOUBLES, DOUBLES, DOUBLES]),
    "am_complete_step": (c_int, [c_void_p, c_double]),
    "am_evaluate": (c_int, [c_void_p, c_size_t, DOUBLES, DOUBLES, DOUBLES]),
    "am_out_of_range": (c_int, [c_void_p, DOUBLES, DOUBLES]),
    "am_add_residuals": (c_int, [c_void_p, c_size_t, c_void_p, c_int]),
    "am_eliminate": (c_longlong, [c_void_p, c_size_t, DOUBLES, DOUBLES, DOUBLES, DOUBLES]),
    "am_substitute": (None, [c_int, c_size_t, DOUBLES, DOUBLES, c_size_t, DOUBLES]),
    "am_follow": (c_int, [c_void_p, c_size_t, DOUBLES, DOUBLES, DOUBLES]),
    "am_add_driven": (c_int, [c_void_p, c_void_p, DOUBLES, DOUBLES, DOUBLES]),
    "am_add_noise": (c_int, [c_void_p, c_size_t, DOUBLES, c_int, DOUBLES, DOUBLES, DOUBLES]),
    "am_follow_circuit": (c_int, [c_void_p, c_size_t, DOUBLES, DOUBLES]),
}


@cache
def load_kernel() -> ctypes.CDLL:
    """Return the kernel of this machine.

    Raises
    ------
    AeromatchError
        The kernel has not been compiled.
    """
    folder = FOLDER / _platform_name()
    # the suffix of the library depends on the system
    libraries: list[Path] = []
    for suffix in SUFFIX.values():
        libraries += sorted(folder.glob(f"aeromatch_kernel{suffix}"))
    if not libraries:
        raise AeromatchError(
            f"no compiled kernel in {folder}; install the package, or run 'python "
            f"hatch_build.py' in a checkout"
        )
    # without the signatures ctypes would pass pointers as 32-bit integers
    kernel = ctypes.CDLL(str(libraries[0]))
    for name, (result, arguments) in SIGNATURES.items():
        function = getattr(kernel, name)
        function.restype, function.argtypes = result, arguments
    return kernel


def _platform_name() -> str:
    """Return the folder of this machine, such as ``x86_64-linux``."""
    machine = platform.machine().lower()
    return f"{_PROCESSORS.get(machine, machine)}-{platform.system().lower()}"


def double_pointer(array: np.ndarray) -> Any:
    """Return a pointer to the numbers of an array; the array must stay in memory."""
    return array.ctypes.data_as(DOUBLES)


def check_array(array: np.ndarray | Sequence[Any], shape: tuple[int, ...]) -> np.ndarray:
    """Return an array as contiguous doubles.

    Raises
    ------
    ValueError
        The array does not have the shape.
    """
    contiguous = np.ascontiguousarray(array, float)
    if contiguous.shape != shape:
        raise ValueError(f"array has the shape {contiguous.shape}, expected {shape}")
    return contiguous
