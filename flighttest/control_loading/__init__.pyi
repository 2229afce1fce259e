"""Public names of `flighttest.control_loading` and where they are defined; ``__init__.py`` loads them from this list."""

from .database import replace_hinge_moments as replace_hinge_moments
from .division import driven_and_free as driven_and_free
from .identification import identify_control_loading as identify_control_loading
from .loading import ControlLoading as ControlLoading
from .regression import TrimForces as TrimForces
from .regression import trim_forces as trim_forces
from .result import IdentifiedLoading as IdentifiedLoading
