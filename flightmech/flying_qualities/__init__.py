"""Flying qualities and performance of any database: the quantities of the Smetana program ([LR743]
section 2.2), one module per subject.
"""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
