"""Public names of `flighttest.special_tests.spin`."""

from .polynomial_models import SPIN as SPIN
from .polynomial_models import Polynomial as Polynomial
from .polynomial_models import models_of_structure as models
from .polynomial_models import models_of_structure as models_of_structure
from .polynomial_models import polynomial_database as polynomial_database
from .polynomial_models import read_polynomials as read_polynomials
from .rotation_rates import nominal_variables as nominal_variables
from .rotation_rates import reconstruct_steep as reconstruct_steep
from .rotation_rates import spin_variables as spin_variables
from .rotation_rates import wind_axis_rates as wind_axis_rates
