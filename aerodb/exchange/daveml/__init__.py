"""DAVE-ML (ANSI/AIAA S-119): files read, evaluated and checked; to and from databases."""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
