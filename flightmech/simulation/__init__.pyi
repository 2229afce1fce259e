"""Public names of `flightmech.simulation`."""

from .batch import simulate_batch as simulate_batch
from .closed_loop import simulate_closed_loop as simulate_closed_loop
from .compiler import SimModel as SimModel
from .compiler import compile as compile
from .compiler import compile_files as compile_files
from .kernel import Simulation as Simulation
from .node_values import nodes_digest as nodes_digest
from .node_values import table_values as table_values
from .node_values import with_table_values as with_table_values
from .run import simulate as simulate
