"""Public names of `datcom_io.arrays` and where they are defined; ``__init__.py`` loads them from this list."""

from .grid import join as join
from .grid import to_grid as to_grid
