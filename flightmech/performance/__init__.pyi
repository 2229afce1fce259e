"""Public names of `flightmech.performance` and where they are defined; ``__init__.py`` loads them from this list."""

from .polar_and_range import one_g as one_g
from .polar_and_range import performance_curves as performance_curves
from .polar_and_range import polar as polar
from .polar_and_range import stall as stall
