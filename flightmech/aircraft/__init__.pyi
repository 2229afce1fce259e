"""Public names of `flightmech.aircraft`."""

from . import similarity as similarity
from .aircraft import Aircraft as Aircraft
from .aircraft_file import aircraft_schema as aircraft_schema
from .aircraft_file import read_aircraft as read_aircraft
from .controls import Circuit as Circuit
from .controls import ControlGeometry as Control
from .controls import ControlGeometry as ControlGeometry
from .engine import Engine as Engine
from .fuel import Fuel as Fuel
from .landing_gear import Contact as Contact
from .landing_gear import LandingGear as LandingGear
from .landing_gear import Steering as Steering
from .parts import different_parts as different_parts
from .parts import swap_parts as swap_parts
from .propulsion.electric_motor import ElectricMotor as ElectricMotor
from .propulsion.engine_deck import EngineDeck as Deck
from .propulsion.engine_deck import EngineDeck as EngineDeck
from .propulsion.fuel_transfer import Transfer as Transfer
from .propulsion.piston_engine import PistonEngine as PistonEngine
from .propulsion.propeller import Propeller as Propeller
from .propulsion.tank import Tank as Tank
from .separation import FlowSeparation as FlowSeparation
from .similarity import rescale as rescale
from .writing import write_aircraft as write_aircraft
