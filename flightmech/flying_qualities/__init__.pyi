"""Public names of `flightmech.flying_qualities`."""

from .evaluation import Characteristics as Characteristics
from .evaluation import characteristics as characteristics
from .level_flight import performance_curves as performance_curves
from .performance import one_g as one_g
from .performance import polar as polar
from .performance import stall as stall
