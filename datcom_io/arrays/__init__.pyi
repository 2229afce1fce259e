"""Public names of `datcom_io.arrays`."""

from .grid import join as join
from .grid import to_grid as to_grid
