"""Regression with noisy regressors: instrumental variables and total least squares."""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
