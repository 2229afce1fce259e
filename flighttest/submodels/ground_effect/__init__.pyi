"""Public names of `flighttest.submodels.ground_effect`."""

from .database_terms import replace_ground_effect as replace_ground_effect
from .identification import identify_ground_effect as identify_ground_effect
from .result import GroundEffect as GroundEffect
