"""Public names of `flighttest.regression.model_structure`."""

from .best_prediction import select_by_prediction as select_by_prediction
from .candidates import monomials as monomials
from .candidates import spline_terms as spline_terms
from .deletion_rule import apply_deletion_rule as apply_deletion_rule
from .deletion_rule import apply_deletion_rule as decide
from .search import StepwiseThresholds as StepwiseThresholds
from .search import select_orthogonal as select_orthogonal
from .search import select_stepwise as select_stepwise
from .selection import Selection as Selection
from .selection import count_selections as count_selections
from .selection import count_selections as tally
