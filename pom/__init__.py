"""Proof of Match: replay recorded inputs through simulation models and judge them against the flight."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flightmech.support.lazy import load

if TYPE_CHECKING:
    from .archive.archive import Archive, read_archive
    from .archive.origins import provenance
    from .archive.verification import Finding, verify
    from .cases.case import PomCase, read_case
    from .diagnosis.diagnosis import diagnose
    from .diagnosis.swap_table import ranking, waterfall
    from .diagnosis.term_swaps import corrected_aircraft, corrected_database, corrected_terms, swap_terms
    from .drafting.draft import init_case
    from .judging.modal import fit_mode
    from .replaying.batch import replay_all
    from .replaying.offsets import calibration, drift
    from .replaying.piloting import pilot_activity
    from .replaying.replay_case import replay
    from .report.writer import write_report
    from .result import PomResult

_HOME = {
    "Archive": "archive.archive",
    "read_archive": "archive.archive",
    "PomCase": "cases.case",
    "read_case": "cases.case",
    "init_case": "drafting.draft",
    "calibration": "replaying.offsets",
    "drift": "replaying.offsets",
    "pilot_activity": "replaying.piloting",
    "corrected_aircraft": "diagnosis.term_swaps",
    "corrected_database": "diagnosis.term_swaps",
    "corrected_terms": "diagnosis.term_swaps",
    "swap_terms": "diagnosis.term_swaps",
    "ranking": "diagnosis.swap_table",
    "waterfall": "diagnosis.swap_table",
    "diagnose": "diagnosis.diagnosis",
    "fit_mode": "judging.modal",
    "provenance": "archive.origins",
    "replay": "replaying.replay_case",
    "replay_all": "replaying.batch",
    "write_report": "report.writer",
    "Finding": "archive.verification",
    "verify": "archive.verification",
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
