"""Regression of flight-test records: linear, separable and pooled models with their errors."""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
