"""Public names of `flighttest.regression.uncertainty`."""

from .prediction_errors import nrmse as nrmse
from .prediction_errors import r_squared as r_squared
from .prediction_errors import theil as theil
from .prediction_errors import theil_shares as theil_shares
from .prediction_errors import theil_single_root as theil_single_root
from .prediction_errors import validation_report as validation_report
from .prediction_errors import validation_table as validation_table
