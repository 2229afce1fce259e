"""State reconstruction: from recordings to one consistent flight path ([LR743] 4.3)."""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
