"""Public names of `flighttest.regression.errors_in_variables`."""

from .instrumental_variables import regress_instrumental as regress_instrumental
from .total_least_squares import regress_total as regress_total
