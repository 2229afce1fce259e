"""Public names of `flighttest.separable` and where they are defined; ``__init__.py`` loads them from this list."""

from .regression import regress_separable as regress_separable
from .result import SeparableFit as SeparableFit
