"""Public names of `flighttest.reconstruction`."""

from .batch.programme import Batch as Batch
from .batch.programme import observable_constants as observable_constants
from .batch.programme import observable_constants as visible
from .batch.programme import reconstruct_batch as reconstruct_batch
from .channel_signals import compatibility_figure as compatibility_figure
from .combined_biases import combine_biases as combine_biases
from .compatibility import compatibility_report as compatibility_report
from .compatibility import compatibility_table as compatibility_table
from .compatibility import draw_compatibility as draw_compatibility
from .flight_path import FlightPath as FlightPath
from .flight_path import FlightPath as Path
from .flight_programme import open_biases as open_biases
from .flight_programme import reconstruct_programme as reconstruct_programme
from .flight_programme import save_path as save_path
from .smoother import reconstruct as reconstruct
from .states_at_start import start_states as start_states
