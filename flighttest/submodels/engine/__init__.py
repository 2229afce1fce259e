"""Engine identified from flight: governor and spools, static thrust, start and shut-down, [LR743]
4.5.2.
"""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
