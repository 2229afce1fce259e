"""Wind-tunnel balance data as a source of aerodynamic models: points to coefficients, tare and
interference, fits for the database.
"""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
