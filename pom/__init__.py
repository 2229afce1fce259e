"""Proof of Match: replay recorded inputs through simulation models and judge them against the flight."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flightmech.lazy import load

if TYPE_CHECKING:
    from .archive import Archive, read_archive
    from .batch import replay_all
    from .case import PomCase, read_case
    from .case_init import init_case
    from .diagnosis import diagnose
    from .modes import fit_mode
    from .offsets import calibration, drift
    from .origins import provenance
    from .piloting import pilot_activity
    from .replaying import replay
    from .report import write_report
    from .result import PomResult
    from .swap_table import ranking, waterfall
    from .swaps import corrected_aircraft, corrected_database, corrected_terms, swap_terms
    from .verification import Finding, verify

_HOME = {
    "Archive": "archive",
    "read_archive": "archive",
    "PomCase": "case",
    "read_case": "case",
    "init_case": "case_init",
    "calibration": "offsets",
    "drift": "offsets",
    "pilot_activity": "piloting",
    "corrected_aircraft": "swaps",
    "corrected_database": "swaps",
    "corrected_terms": "swaps",
    "swap_terms": "swaps",
    "ranking": "swap_table",
    "waterfall": "swap_table",
    "diagnose": "diagnosis",
    "fit_mode": "modes",
    "provenance": "origins",
    "replay": "replaying",
    "replay_all": "batch",
    "write_report": "report",
    "Finding": "verification",
    "verify": "verification",
    "PomResult": "result",
}
__all__ = [
    "Archive",
    "Finding",
    "PomCase",
    "PomResult",
    "calibration",
    "corrected_aircraft",
    "corrected_database",
    "corrected_terms",
    "diagnose",
    "drift",
    "fit_mode",
    "init_case",
    "pilot_activity",
    "provenance",
    "ranking",
    "read_archive",
    "read_case",
    "replay",
    "replay_all",
    "swap_terms",
    "verify",
    "waterfall",
    "write_report",
]


def __getattr__(name: str):
    return load(__name__, _HOME, name)


def __dir__() -> list[str]:
    return __all__
