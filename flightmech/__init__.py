"""Shared ground of the house: names, units, terms, air, axes; the aircraft and its compiled simulation.

The public names are loaded when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from .lazy import load

if TYPE_CHECKING:
    from . import air, axes, errors, names, terms, units
    from .aircraft import Aircraft, Engine, read_aircraft
    from .compiler import SimModel, compile
    from .fmu import write_fmu
    from .simulation import simulate
    from .trimming import trim

_HOME = {
    "read_aircraft": "aircraft",
    "Aircraft": "aircraft",
    "Engine": "aircraft",
    "compile": "compiler",
    "SimModel": "compiler",
    "simulate": "simulation",
    "trim": "trimming",
    "write_fmu": "fmu",
    "air": "air",
    "axes": "axes",
    "errors": "errors",
    "names": "names",
    "terms": "terms",
    "units": "units",
}
__all__ = [
    "Aircraft",
    "Engine",
    "SimModel",
    "air",
    "axes",
    "compile",
    "errors",
    "names",
    "read_aircraft",
    "simulate",
    "terms",
    "trim",
    "units",
    "write_fmu",
]


def __getattr__(name: str):
    return load(__name__, _HOME, name)


def __dir__() -> list[str]:
    return __all__
