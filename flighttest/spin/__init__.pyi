"""Public names of `flighttest.spin` and where they are defined; ``__init__.py`` loads them from this list."""

from .database import polynomial_database as polynomial_database
from .decomposition import nominal_variables as nominal_variables
from .decomposition import spin_variables as spin_variables
from .decomposition import wind_axis_rates as wind_axis_rates
from .steep_reconstruction import reconstruct_steep as reconstruct_steep
from .structure import SPIN as SPIN
from .structure import models as models
from .tables import Polynomial as Polynomial
from .tables import read_polynomials as read_polynomials
