"""Ground effect from landings, low passes and free-air records, [LR743] 4.5.1."""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
