"""Spin: rates about and across the flight path, model structures, polynomial models as databases,
simulated recordings.
"""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
