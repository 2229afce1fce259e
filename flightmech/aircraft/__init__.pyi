"""Public names of `flightmech.aircraft` and where they are defined; ``__init__.py`` loads them from this list."""

from . import similarity as similarity
from .aircraft import Aircraft as Aircraft
from .aircraft import aircraft_schema as aircraft_schema
from .aircraft import read_aircraft as read_aircraft
from .control_surface import Control as Control
from .parts import different_parts as different_parts
from .parts import swap_parts as swap_parts
from .similarity import rescale as rescale
from .systems.control_circuits import Circuit as Circuit
from .systems.engine import Engine as Engine
from .systems.engine_deck import Deck as Deck
from .systems.fuel import Fuel as Fuel
from .systems.fuel import Tank as Tank
from .systems.landing_gear import Contact as Contact
from .systems.landing_gear import LandingGear as LandingGear
from .systems.landing_gear import Steering as Steering
from .writing import write_aircraft as write_aircraft
