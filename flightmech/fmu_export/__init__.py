"""A compiled model as a Functional Mock-up Unit (FMI 2.0 and 3.0)."""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
