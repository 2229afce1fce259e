"""Public names of `flighttest.submodels.control_loading`."""

from .hinge_terms import replace_hinge_moments as replace_hinge_moments
from .identification import identify_control_loading as identify_control_loading
from .loading import ControlLoading as ControlLoading
from .motion import driven_and_free as driven_and_free
from .regression import TrimForces as TrimForces
from .regression import trim_forces as trim_forces
from .result import IdentifiedLoading as IdentifiedLoading
