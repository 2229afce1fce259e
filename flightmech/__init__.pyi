"""Namespaces of `flightmech` by subject, and the names of the usual road; ``__init__.py`` loads them from this list."""

from . import air as air
from . import aircraft as aircraft
from . import axes as axes
from . import errors as errors
from . import flying_qualities as flying_qualities
from . import fmu_export as fmu_export
from . import linearisation as linearisation
from . import names as names
from . import performance as performance
from . import simulation as simulation
from . import terms as terms
from . import trimming as trimming
from . import units as units
from .aircraft import Aircraft as Aircraft
from .aircraft import read_aircraft as read_aircraft
from .aircraft import write_aircraft as write_aircraft
from .flying_qualities import characteristics as characteristics
from .fmu_export import write_fmu as write_fmu
from .linearisation import linearize as linearize
from .linearisation import modes as modes
from .simulation import SimModel as SimModel
from .simulation import compile as compile
from .simulation import simulate as simulate
from .simulation import simulate_batch as simulate_batch
from .trimming import start_of as start_of
from .trimming import trim as trim
