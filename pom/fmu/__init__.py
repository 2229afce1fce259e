"""FMUs: what they offer, their variables, and their simulation in a child process."""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
