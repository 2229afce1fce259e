"""Public names of `flighttest.model_structure` and where they are defined; ``__init__.py`` loads them from this list."""

from .candidates import monomials as monomials
from .candidates import spline_terms as spline_terms
from .deletion_rule import decide as decide
from .orthogonal_functions import select_orthogonal as select_orthogonal
from .selection import Selection as Selection
from .selection import tally as tally
from .stepwise import select_stepwise as select_stepwise
