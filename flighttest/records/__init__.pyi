"""Public names of `flighttest.records`."""

from .files import contents as contents
from .files import save_record as save_record
from .manoeuvre_table import read_manoeuvres as read_manoeuvres
from .manoeuvre_table import with_manoeuvres as marked
from .manoeuvre_table import with_manoeuvres as with_manoeuvres
from .manoeuvre_table import write_manoeuvres as write_manoeuvres
from .record import faults as faults
from .record import flight_modes as flight_modes
from .record import flight_modes as modes
from .record import marked_manoeuvres as marked_manoeuvres
from .record import merge as merge
from .record import needs_names as needs_names
from .record import overview as overview
from .record import read as read
from .shared_samples import find_shared_samples as find_shared_samples
from .shared_samples import inertial_channels as inertial_channels
from .time_histories import record_figure as record_figure
from .time_histories import states_figure as states_figure
