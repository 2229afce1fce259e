"""Manoeuvres found in a record that carries no marks: which control moved, when, and as what
input.
"""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
