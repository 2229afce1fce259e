"""Public names of `pom.diagnosis` and where they are defined; ``__init__.py`` loads them from this list."""

from .diagnosis import diagnose as diagnose
from .joint_correction import diagnose_all as diagnose_all
from .joint_correction import join_diagnoses as join_diagnoses
from .swap_table import ranking as ranking
from .swap_table import waterfall as waterfall
from .term_swaps import by_submodel as by_submodel
from .term_swaps import corrected_aircraft as corrected_aircraft
from .term_swaps import corrected_database as corrected_database
from .term_swaps import corrected_terms as corrected_terms
from .term_swaps import differing as differing
from .term_swaps import joint_terms as joint_terms
from .term_swaps import swap_terms as swap_terms
