"""A whole flight against what is known of the aeroplane: consistency, stationary points,
coefficients, eigenmotions, bounds.
"""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
