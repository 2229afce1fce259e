"""Readers of recordings, one module for each format; `flighttest.readers.opening` chooses by content."""

from flightmech.support.lazy import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
