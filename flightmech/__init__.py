"""Shared ground of the house: names, units, terms, air, axes; the aircraft and its compiled simulation.

The public names are loaded when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from .installation import warn_if_hidden
from .lazy import load

if TYPE_CHECKING:
    from . import air, axes, errors, linear, names, similarity, terms, units
    from .aircraft import Aircraft, Control, Engine, read_aircraft
    from .aircraft_writing import write_aircraft
    from .batch import simulate_batch
    from .compiler import SimModel, compile
    from .eigenmodes import modes
    from .fmu import write_fmu
    from .linear import linearize
    from .parts import different_parts, swap_parts
    from .qualities.assemble import Characteristics, characteristics
    from .similarity import rescale
    from .simulation import simulate
    from .trimming import start_of, trim

_HOME = {
    "read_aircraft": "aircraft",
    "Aircraft": "aircraft",
    "Control": "aircraft",
    "Engine": "aircraft",
    "write_aircraft": "aircraft_writing",
    "compile": "compiler",
    "SimModel": "compiler",
    "linearize": "linear",
    "different_parts": "parts",
    "swap_parts": "parts",
    "modes": "eigenmodes",
    "Characteristics": "qualities.assemble",
    "characteristics": "qualities.assemble",
    "rescale": "similarity",
    "simulate": "simulation",
    "simulate_batch": "batch",
    "start_of": "trimming",
    "trim": "trimming",
    "write_fmu": "fmu",
    "air": "air",
    "axes": "axes",
    "errors": "errors",
    "linear": "linear",
    "names": "names",
    "similarity": "similarity",
    "terms": "terms",
    "units": "units",
}
__all__ = [
    "Aircraft",
    "Characteristics",
    "Control",
    "Engine",
    "SimModel",
    "air",
    "axes",
    "characteristics",
    "compile",
    "different_parts",
    "errors",
    "linear",
    "linearize",
    "modes",
    "names",
    "read_aircraft",
    "rescale",
    "similarity",
    "simulate",
    "simulate_batch",
    "start_of",
    "swap_parts",
    "terms",
    "trim",
    "units",
    "write_aircraft",
    "write_fmu",
]


def __getattr__(name: str):
    return load(__name__, _HOME, name)


def __dir__() -> list[str]:
    return __all__


warn_if_hidden()
