"""Readers of the outputs of programs, each recognised by its content."""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
