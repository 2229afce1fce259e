"""Maximum likelihood over whole responses: output error in time and in frequency, filter error.

Public names are offered by `flighttest` itself."""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
