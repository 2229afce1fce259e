"""Proof of Match: replay recorded inputs through simulation models and judge them against the flight."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flightmech.lazy import load

if TYPE_CHECKING:
    from .case import PomCase, read_case
    from .diagnosis import corrected_terms, diagnose, swap_terms
    from .modes import fit_mode
    from .origins import provenance
    from .replaying import replay
    from .report import write_report
    from .result import PomResult

_HOME = {
    "PomCase": "case",
    "read_case": "case",
    "corrected_terms": "diagnosis",
    "swap_terms": "diagnosis",
    "diagnose": "diagnosis",
    "fit_mode": "modes",
    "provenance": "origins",
    "replay": "replaying",
    "write_report": "report",
    "PomResult": "result",
}
__all__ = [
    "PomCase",
    "PomResult",
    "corrected_terms",
    "diagnose",
    "fit_mode",
    "provenance",
    "read_case",
    "replay",
    "swap_terms",
    "write_report",
]


def __getattr__(name: str):
    return load(__name__, _HOME, name)


def __dir__() -> list[str]:
    return __all__
