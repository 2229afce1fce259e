"""Public names of `aerodb.estimators`."""

from . import programs as programs
from .build import from_estimate as from_estimate
from .coefficient_set import CoefficientSet as CoefficientSet
from .coefficient_set import EstimateReference as EstimateReference
from .column_map import ColumnMap as ColumnMap
from .column_map import read_column_map as read_column_map
from .reading import read_estimate as read_estimate
from .reading import read_estimates as read_estimates
from .vortex_lattice.estimate import from_decks as from_decks
