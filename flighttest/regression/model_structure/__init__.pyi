"""Public names of `flighttest.regression.model_structure`."""

from .candidates import monomials as monomials
from .candidates import spline_terms as spline_terms
from .search import select_orthogonal as select_orthogonal
from .search import select_stepwise as select_stepwise
from .selection import Selection as Selection
from .selection import decide as decide
from .selection import tally as tally
