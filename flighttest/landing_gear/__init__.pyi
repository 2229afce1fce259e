"""Public names of `flighttest.landing_gear` and where they are defined; ``__init__.py`` loads them from this list."""

from .identification import identify_landing_gear as identify_landing_gear
from .reconstructed_loads import GroundRecord as GroundRecord
from .reconstructed_loads import wheel_loads as wheel_loads
from .result import GearConstant as GearConstant
from .result import IdentifiedGear as IdentifiedGear
