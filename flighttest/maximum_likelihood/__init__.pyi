"""Public names of `flighttest.maximum_likelihood` and where they are defined; ``__init__.py`` loads them from this list."""

from .estimates_to_database import updated_database as updated_database
from .files import open_output_error as open_output_error
from .files import save_output_error as save_output_error
from .frequency_domain import frequency_output_error as frequency_output_error
from .linear_time_domain import linear_output_error as linear_output_error
from .models.state_space import LinearModel as LinearModel
from .models.state_space import linear_model as linear_model
from .parameters import Unknown as Unknown
from .process_noise import filter_error as filter_error
from .result import OutputError as OutputError
from .time_domain import output_error as output_error
