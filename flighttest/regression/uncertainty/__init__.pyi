"""Public names of `flighttest.regression.uncertainty`."""

from .significance import nrmse as nrmse
from .significance import r_squared as r_squared
from .significance import theil as theil
from .significance import theil_shares as theil_shares
from .significance import theil_single_root as theil_single_root
from .significance import validation_report as validation_report
from .significance import validation_table as validation_table
