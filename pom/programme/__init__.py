"""Rows of a proof of match before the flights: their cases on the a-priori model, and the gradients
of their results by the nodes of a database.
"""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
