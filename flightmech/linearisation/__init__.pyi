"""Public names of `flightmech.linearisation` and where they are defined; ``__init__.py`` loads them from this list."""

from .eigenmodes import modes as modes
from .linear import linearize as linearize
from .linear import subset as subset
