"""Outputs of other estimators of aerodynamics in one neutral form, and databases of them."""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
