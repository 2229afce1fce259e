"""Public names of `flighttest.regression.separable`."""

from .fit import SeparableFit as SeparableFit
from .fit import regress_separable as regress_separable
