"""Public names of `flighttest.flight_programme.input_design`."""

from .design import Designed as Designed
from .design import design_input as design_input
from .design import save_design as save_design
from .input_accuracy import Expected as Expected
from .input_accuracy import cramer_rao as cramer_rao
from .input_accuracy import expected_errors as expected_errors
from .input_shapes import in_sequence as in_sequence
from .input_shapes import multistep as multistep
from .input_shapes import sweep as sweep
from .input_shapes import unit_step as unit_step
from .input_signals import CHANNEL_SETS as CHANNEL_SETS
from .input_signals import axes_of as axes_of
from .input_signals import measures as measures
from .multisines import InputAxis as InputAxis
from .multisines import multisine as multisine
from .predicted_response import amplitude_within as amplitude_within
from .predicted_response import predict_response as predict_response
from .predicted_response import trimmed_start as trimmed_start
from .specification import read_design as read_design
from .timetable import open_timetable as open_timetable
from .timetable import save_timetable as save_timetable
