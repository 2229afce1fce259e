"""Namespaces of `pom` by subject, and the names of the usual road; ``__init__.py`` loads them from this list."""

from . import archive as archive
from . import cases as cases
from . import diagnosis as diagnosis
from . import drafting as drafting
from . import fmu as fmu
from . import judging as judging
from . import replaying as replaying
from . import report as report
from . import tolerances as tolerances
from .archive import provenance as provenance
from .archive import read_archive as read_archive
from .archive import verify as verify
from .cases import PomCase as PomCase
from .cases import read_case as read_case
from .diagnosis import corrected_aircraft as corrected_aircraft
from .diagnosis import corrected_database as corrected_database
from .diagnosis import corrected_terms as corrected_terms
from .diagnosis import diagnose as diagnose
from .diagnosis import join_diagnoses as join_diagnoses
from .diagnosis import ranking as ranking
from .diagnosis import waterfall as waterfall
from .drafting import init_case as init_case
from .replaying import replay as replay
from .replaying import replay_all as replay_all
from .report import write_report as write_report
from .result import PomResult as PomResult
