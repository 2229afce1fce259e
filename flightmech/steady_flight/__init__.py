"""A trimmed condition with its coefficients and derivatives, on which characteristics are built."""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
