"""Public names of `flighttest.regression.equation_error`."""

from .fit import Fit as Fit
from .fit_file import open_fit as open_fit
from .fit_file import save_fit as save_fit
from .frequency.frequency_domain import regress_frequency as regress_frequency
from .model import RegressionModel as Model
from .model import RegressionModel as RegressionModel
from .resampling import Bootstrap as Bootstrap
from .resampling import MonteCarlo as MonteCarlo
from .resampling import MonteCarlo as Study
from .resampling import bootstrap as bootstrap
from .resampling import monte_carlo as monte_carlo
from .time_domain import regress as regress
