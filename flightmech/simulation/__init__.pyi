"""Public names of `flightmech.simulation` and where they are defined; ``__init__.py`` loads them from this list."""

from .batch import simulate_batch as simulate_batch
from .closed_loop import simulate_closed_loop as simulate_closed_loop
from .compiler import SimModel as SimModel
from .compiler import compile as compile
from .kernel import Simulation as Simulation
from .model_files import compile_files as compile_files
from .node_values import nodes_digest as nodes_digest
from .node_values import table_values as table_values
from .node_values import with_table_values as with_table_values
from .run import simulate as simulate
