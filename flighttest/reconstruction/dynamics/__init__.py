"""Kinematics of the flight path, channels that follow from others, forces and moments as
coefficients.
"""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
