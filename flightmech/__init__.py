"""Shared ground of the house: names, units, terms, air, axes; the aircraft and its compiled simulation.

The public names are loaded when they are first used.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .aircraft import Aircraft, Engine, read_aircraft
    from .compile import SimModel, compile
    from .fmu import write_fmu
    from .simulate import simulate
    from .trim import trim

_PUBLIC = {
    "read_aircraft": "aircraft",
    "Aircraft": "aircraft",
    "Engine": "aircraft",
    "compile": "compile",
    "SimModel": "compile",
    "simulate": "simulate",
    "trim": "trim",
    "write_fmu": "fmu",
}
_MODULES = ("air", "axes", "errors", "names", "terms", "units")

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


class _Package(ModuleType):
    """Keeps `compile`, `simulate` and `trim` the functions; the import system would bind the modules of these names."""

    def __getattr__(self, name: str):
        if name in _PUBLIC:
            return getattr(importlib.import_module(f"{self.__name__}.{_PUBLIC[name]}"), name)
        if name in _MODULES:
            return importlib.import_module(f"{self.__name__}.{name}")
        raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}; public are {', '.join(__all__)}")

    def __setattr__(self, name: str, value: object) -> None:
        if not (name in _PUBLIC and isinstance(value, ModuleType)):
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *__all__})


sys.modules[__name__].__class__ = _Package
