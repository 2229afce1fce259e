"""Public names of `flightmech.steady_flight`."""

from .eigenmodes import modes as modes
from .linear_model import linearize as linearize
from .linear_model import subset as subset
from .trim_search import start_of as start_of
from .trim_search import trim as trim
