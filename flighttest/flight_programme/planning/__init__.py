"""A flight-test programme before it is flown: what manoeuvres would add to a database, and the
smallest choice that is enough.
"""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
