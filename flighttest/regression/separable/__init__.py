"""Models that are linear in most parameters and nonlinear in a few: separable least squares."""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
