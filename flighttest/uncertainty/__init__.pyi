"""Public names of `flighttest.uncertainty` and where they are defined; ``__init__.py`` loads them from this list."""

from .goodness_of_fit import nrmse as nrmse
from .goodness_of_fit import r_squared as r_squared
from .goodness_of_fit import theil as theil
from .goodness_of_fit import theil_shares as theil_shares
from .goodness_of_fit import theil_single_root as theil_single_root
from .goodness_of_fit import validation_report as validation_report
from .goodness_of_fit import validation_table as validation_table
