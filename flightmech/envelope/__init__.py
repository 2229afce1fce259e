"""Validity envelope of a model: where flights support it, and where they do not."""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
