"""Public names of `flightmech.flying_qualities` and where they are defined; ``__init__.py`` loads them from this list."""

from .evaluation import Characteristics as Characteristics
from .evaluation import characteristics as characteristics
