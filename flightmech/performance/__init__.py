"""Performance: stall, drag polar, glide, level flight, range, climb ([LR743] section 2.2)."""

from flightmech.support.lazy import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
