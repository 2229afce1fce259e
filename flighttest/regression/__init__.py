"""Models with parameters that they are not linear in: expressions, their derivatives, their text."""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
