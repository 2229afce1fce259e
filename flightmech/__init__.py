"""Foundation of all packages: names, units, terms, air, axes; the aircraft and its compiled
simulation.

The public names are loaded when they are first used."""

from flightmech.support.imports import attach_stub, warn_if_hidden

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)

warn_if_hidden()
