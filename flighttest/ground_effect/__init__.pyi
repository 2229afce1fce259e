"""Public names of `flighttest.ground_effect` and where they are defined; ``__init__.py`` loads them from this list."""

from .database import replace_ground_effect as replace_ground_effect
from .identification import identify_ground_effect as identify_ground_effect
from .result import GroundEffect as GroundEffect
