"""A database for another reference, size, grid or height above ground."""

from flightmech.support.lazy import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
