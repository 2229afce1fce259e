"""Three-view drawings of input decks."""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
