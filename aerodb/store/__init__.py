"""What a database is: its scheme, rules, file, history and evaluation."""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
