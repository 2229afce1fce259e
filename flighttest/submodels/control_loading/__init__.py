"""Control loading from flight: friction, preload, masses, cables and hinge moments of column, wheel
and pedals.
"""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
