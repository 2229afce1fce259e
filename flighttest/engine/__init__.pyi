"""Public names of `flighttest.engine` and where they are defined; ``__init__.py`` loads them from this list."""

from .records import engine_channels as engine_channels
from .replay import fly_deck as fly_deck
from .result import EngineFit as EngineFit
from .result import identify_engine as identify_engine
from .spools import SpoolFit as SpoolFit
from .spools import identify_spools as identify_spools
from .starting import StartFit as StartFit
from .starting import identify_start as identify_start
from .steady.equilibrium import equilibrium_points as equilibrium_points
from .steady.fuel_thrust import FuelThrust as FuelThrust
from .steady.fuel_thrust import fit_fuel_thrust as fit_fuel_thrust
from .steady.static import DeckCorrection as DeckCorrection
from .steady.static import Polar as Polar
from .steady.static import correct_deck as correct_deck
from .steady.steady_tables import SteadyTable as SteadyTable
from .steady.steady_tables import steady_table as steady_table
from .structure import EngineStructure as EngineStructure
from .structure import read_structure as read_structure
from .structure import structure_schema as structure_schema
from .windows import power_changes as power_changes
