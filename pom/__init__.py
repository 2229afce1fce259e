"""Proof of Match: replay recorded inputs through simulation models and judge them against the flight."""

from __future__ import annotations

import importlib

_NAMES = {
    "PomCase": "case",
    "read_case": "case",
    "PomResult": "result",
    "replay": "replay",
    "diagnose": "diagnose",
    "corrected_terms": "diagnose",
    "fit_mode": "measures",
    "write_report": "report",
}
__all__ = list(_NAMES)


def __getattr__(name: str):
    if name not in _NAMES:
        raise AttributeError(f"module 'pom' has no attribute {name!r}")
    return getattr(importlib.import_module(f"pom.{_NAMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
