"""Public names of `flighttest.regression`."""

from .separable_model import SeparableModel as SeparableModel
from .separable_model import ShapeParameter as ShapeParameter
