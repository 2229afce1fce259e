"""Public names of `flightmech`."""

from . import air as air
from . import aircraft as aircraft
from . import axes as axes
from . import errors as errors
from . import flying_qualities as flying_qualities
from . import fmu_export as fmu_export
from . import names as names
from . import simulation as simulation
from . import terms as terms
from . import units as units
from .aircraft.aircraft import Aircraft as Aircraft
from .aircraft.aircraft import read_aircraft as read_aircraft
from .aircraft.writing import write_aircraft as write_aircraft
from .flying_qualities.evaluation import characteristics as characteristics
from .fmu_export.fmu_file import write_fmu as write_fmu
from .simulation.batch import simulate_batch as simulate_batch
from .simulation.compiler import SimModel as SimModel
from .simulation.compiler import compile as compile
from .simulation.run import simulate as simulate
from .simulation.run import simulate_closed_loop as simulate_closed_loop
from .steady_flight.eigenmodes import modes as modes
from .steady_flight.linear_model import linearize as linearize
from .steady_flight.trim_search import start_of as start_of
from .steady_flight.trim_search import trim as trim
