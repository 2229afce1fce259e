"""Checks before a batch: whether every case can be flown, and whether its flight record is sound."""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
