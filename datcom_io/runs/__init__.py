"""Runs of the user's own DATCOM program: a study split into decks, and run."""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
