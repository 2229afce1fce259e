"""Landing gear from flight: struts, tyres, brakes, rolling friction and nose-wheel steering,
[LR743] 4.5.4.
"""

from flightmech.support.imports import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
