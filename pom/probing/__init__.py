"""Probes of a model that passes: whether its answer is driven by the inputs, or by the record."""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
