"""Data quality: what is right and wrong with a flight record, as findings with names, as text, JSON
and one HTML page.
"""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
