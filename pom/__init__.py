"""Proof of Match: replay recorded inputs through simulation models and judge them against the flight."""

from __future__ import annotations

import importlib
import sys
import types
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .case import PomCase, read_case
    from .diagnose import corrected_terms, diagnose, swap_terms
    from .modes import fit_mode
    from .replay import replay
    from .report import write_report
    from .result import PomResult

_HOME = {
    "PomCase": "case",
    "read_case": "case",
    "corrected_terms": "diagnose",
    "swap_terms": "diagnose",
    "diagnose": "diagnose",
    "fit_mode": "modes",
    "replay": "replay",
    "write_report": "report",
    "PomResult": "result",
}
__all__ = [
    "PomCase",
    "PomResult",
    "corrected_terms",
    "diagnose",
    "fit_mode",
    "read_case",
    "replay",
    "swap_terms",
    "write_report",
]


class _Package(types.ModuleType):
    """The package itself: a function wins over the module of the same name, which the import system would bind."""

    def __setattr__(self, name: str, value) -> None:
        if not (name in _HOME and isinstance(value, types.ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str):
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return __all__
