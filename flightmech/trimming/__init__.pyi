"""Public names of `flightmech.trimming` and where they are defined; ``__init__.py`` loads them from this list."""

from .search import start_of as start_of
from .search import trim as trim
