"""Flight and model compared: signals, events, applicability of rows, verdicts."""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
