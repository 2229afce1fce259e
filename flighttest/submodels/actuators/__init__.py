"""Actuators from bench and flight logs: inertia, damping, stiffness, input gain, dead time and
limits of servos and motors.
"""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
