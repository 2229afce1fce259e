"""Public names of `flighttest.submodels.landing_gear`."""

from .identification import identify_landing_gear as identify_landing_gear
from .measured_loads import fit_side_force as fit_side_force
from .measured_loads import fit_strut as fit_strut
from .reconstructed_loads import GroundRecord as GroundRecord
from .reconstructed_loads import wheel_loads as wheel_loads
from .result import GearConstant as GearConstant
from .result import IdentifiedGear as IdentifiedGear
