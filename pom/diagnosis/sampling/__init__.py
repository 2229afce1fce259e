"""Replays by draws from the posterior of database and instruments: the probability of a match, its
spread, and which errors make it.
"""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
