"""Public names of `flighttest.submodels.stall`."""

from .database_terms import add_stall as add_stall
from .database_terms import continue_attached_flow as continue_attached_flow
from .identification import identify_stall as identify_stall
from .result import StallIdentification as StallIdentification
