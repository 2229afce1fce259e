"""Public names of `pom.diagnosis`."""

from . import culprits as culprits
from .corrected_model import corrected_aircraft as corrected_aircraft
from .corrected_model import corrected_database as corrected_database
from .corrected_model import corrected_terms as corrected_terms
from .corrected_model import joint_terms as joint_terms
from .diagnosis import diagnose as diagnose
from .joint_correction import diagnose_all as diagnose_all
from .joint_correction import join_diagnoses as join_diagnoses
from .term_swaps import by_submodel as by_submodel
from .term_swaps import differing_terms as differing
from .term_swaps import differing_terms as differing_terms
from .term_swaps import swap_terms as swap_terms
from .waterfall_steps import ranking as ranking
from .waterfall_steps import waterfall as waterfall
