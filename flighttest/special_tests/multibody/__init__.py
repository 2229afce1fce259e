"""Vehicles of several rigid bodies: motion of the whole tree from camera markers, air loads by the
equations of motion.
"""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
