"""Foundation of all packages: names, units, terms, air, axes; the aircraft and its compiled simulation.

The public names are loaded when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from .support.installation import warn_if_hidden
from .support.lazy import load

if TYPE_CHECKING:
    from . import air, axes, errors, names, terms, units
    from .aircraft import similarity
    from .aircraft.aircraft import Aircraft, read_aircraft
    from .aircraft.control_surface import Control
    from .aircraft.parts import different_parts, swap_parts
    from .aircraft.similarity import rescale
    from .aircraft.systems.engine import Engine
    from .aircraft.writing import write_aircraft
    from .flying_qualities.evaluation import Characteristics, characteristics
    from .fmu_export.writer import write_fmu
    from .linearisation import linear
    from .linearisation.eigenmodes import modes
    from .linearisation.linear import linearize
    from .simulation.batch import simulate_batch
    from .simulation.compiler import SimModel, compile
    from .simulation.run import simulate
    from .trimming.search import start_of, trim

_HOME = {
    "read_aircraft": "aircraft.aircraft",
    "Aircraft": "aircraft.aircraft",
    "Control": "aircraft.control_surface",
    "Engine": "aircraft.systems.engine",
    "write_aircraft": "aircraft.writing",
    "compile": "simulation.compiler",
    "SimModel": "simulation.compiler",
    "linearize": "linearisation.linear",
    "different_parts": "aircraft.parts",
    "swap_parts": "aircraft.parts",
    "modes": "linearisation.eigenmodes",
    "Characteristics": "flying_qualities.evaluation",
    "characteristics": "flying_qualities.evaluation",
    "rescale": "aircraft.similarity",
    "simulate": "simulation.run",
    "simulate_batch": "simulation.batch",
    "start_of": "trimming.search",
    "trim": "trimming.search",
    "write_fmu": "fmu_export.writer",
    "air": "air",
    "axes": "axes",
    "errors": "errors",
    "linear": "linearisation.linear",
    "names": "names",
    "similarity": "aircraft.similarity",
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
