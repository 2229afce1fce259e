"""Stall models from flight: flow separation of both wing halves and the terms that it changes."""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
