"""Public names of `pom` and where they are defined; ``__init__.py`` loads them from this list."""

from .archive.archive import Archive as Archive
from .archive.archive import read_archive as read_archive
from .archive.origins import provenance as provenance
from .archive.verification import VerificationResult as VerificationResult
from .archive.verification import verify as verify
from .cases.case import PomCase as PomCase
from .cases.case import read_case as read_case
from .diagnosis.diagnosis import diagnose as diagnose
from .diagnosis.swap_table import ranking as ranking
from .diagnosis.swap_table import waterfall as waterfall
from .diagnosis.term_swaps import (
    corrected_aircraft as corrected_aircraft,
)
from .diagnosis.term_swaps import (
    corrected_database as corrected_database,
)
from .diagnosis.term_swaps import (
    corrected_terms as corrected_terms,
)
from .diagnosis.term_swaps import (
    swap_terms as swap_terms,
)
from .drafting.draft import init_case as init_case
from .judging.modal import fit_mode as fit_mode
from .replaying.batch import replay_all as replay_all
from .replaying.offsets import calibration as calibration
from .replaying.offsets import drift as drift
from .replaying.piloting import pilot_activity as pilot_activity
from .replaying.replay_case import replay as replay
from .report.writer import write_report as write_report
from .result import PomResult as PomResult
