"""Public names of `flighttest.submodels.engine`."""

from .bench import fly_deck as fly_deck
from .propellers.identification import identify_propeller as identify_propeller
from .propellers.points import propeller_points as propeller_points
from .propellers.result import PropellerFit as PropellerFit
from .propellers.shaft_dynamics import ShaftDynamics as ShaftDynamics
from .propellers.shaft_dynamics import identify_shaft as identify_shaft
from .records import engine_channels as engine_channels
from .records import power_changes as power_changes
from .result import EngineFit as EngineFit
from .result import identify_engine as identify_engine
from .spools import SpoolFit as SpoolFit
from .spools import identify_spools as identify_spools
from .starting import StartFit as StartFit
from .starting import identify_start as identify_start
from .static_thrust import DeckCorrection as DeckCorrection
from .static_thrust import Polar as Polar
from .static_thrust import correct_deck as correct_deck
from .steady_points import FuelThrust as FuelThrust
from .steady_points import equilibrium_points as equilibrium_points
from .steady_points import fit_fuel_thrust as fit_fuel_thrust
from .steady_tables import SteadyTable as SteadyTable
from .steady_tables import steady_table as steady_table
from .tables import EngineStructure as EngineStructure
from .tables import read_structure as read_structure
from .tables import structure_schema as structure_schema
