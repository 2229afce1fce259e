"""Public names of `aerodb.update`."""

from .classical_join import join_submodels as join_submodels
from .expectation import Expectation as Expectation
from .posterior import common_errors as common_errors
from .posterior import covariance as covariance
from .posterior import draw as draw
from .posterior import with_node_values as drawn
from .posterior import with_node_values as with_node_values
from .regression import regress_tables as regress_tables
from .shapes import Shape as Shape
from .standard_errors import standard_error as standard_error
from .standard_errors import with_standard_errors as with_standard_errors
from .tabulation import tabulate as tabulate
from .term_decisions import decisions as decisions
from .ways_compared import compare_ways as compare_ways
