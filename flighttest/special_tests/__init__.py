"""Motion capture as an instrument: camera markers to the pose, rates and accelerations of rigid
bodies, as a flight record.
"""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
