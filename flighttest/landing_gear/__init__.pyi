"""Public names of `flighttest.landing_gear` and where they are defined; ``__init__.py`` loads them from this list."""

from .curves import fit_side_force as fit_side_force
from .curves import fit_strut as fit_strut
from .identification import identify_landing_gear as identify_landing_gear
from .reconstructed_loads import GroundRecord as GroundRecord
from .reconstructed_loads import wheel_loads as wheel_loads
from .result import GearConstant as GearConstant
from .result import IdentifiedGear as IdentifiedGear
