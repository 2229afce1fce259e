"""Public names of `flighttest.maximum_likelihood`."""

from .database_update import updated_database as updated_database
from .linear.filter_error import filter_error as filter_error
from .linear.frequency_domain import frequency_output_error as frequency_output_error
from .linear.gust_states import DrydenGust as DrydenGust
from .linear.output_error import linear_output_error as linear_output_error
from .linear.state_space import LinearModel as LinearModel
from .linear.state_space import linear_model as linear_model
from .nonlinear.simulated_filter_error import simulated_filter_error as simulated_filter_error
from .result import OutputError as OutputError
from .result import open_output_error as open_output_error
from .result import save_output_error as save_output_error
from .time_domain import output_error as output_error
from .unknowns import Unknown as Unknown
