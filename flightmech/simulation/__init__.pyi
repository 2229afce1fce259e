"""Public names of `flightmech.simulation` and where they are defined; ``__init__.py`` loads them from this list."""

from .batch import simulate_batch as simulate_batch
from .compiler import SimModel as SimModel
from .compiler import compile as compile
from .kernel import Simulation as Simulation
from .model_files import compile_files as compile_files
from .run import simulate as simulate
