"""Cases: the file, its parts, and the job that a model is given."""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
