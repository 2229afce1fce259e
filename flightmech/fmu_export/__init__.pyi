"""Public names of `flightmech.fmu_export` and where they are defined; ``__init__.py`` loads them from this list."""

from .reading import read_fmu as read_fmu
from .writer import write_fmu as write_fmu
