"""Proof of Match: replay recorded inputs through simulation models and judge them against the
flight.
"""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
