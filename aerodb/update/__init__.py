"""Flight estimates joined with the a-priori tables, and the standard errors of the result."""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
