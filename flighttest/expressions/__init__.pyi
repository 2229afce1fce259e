"""Public names of `flighttest.expressions` and where they are defined; ``__init__.py`` loads them from this list."""

from .separable_model import SeparableModel as SeparableModel
from .separable_model import ShapeParameter as ShapeParameter
