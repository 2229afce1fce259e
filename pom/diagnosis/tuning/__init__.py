"""Tuning of a model inside its standard errors: rows pass by the changes that the flight evidence
contradicts least.
"""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
