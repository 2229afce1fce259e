"""Public names of `flighttest.records.sensors`."""

from .instruments import Instrument as Instrument
from .instruments import pick_up_errors as pick_up_errors
from .position_corrections import force_at_cg as force_at_cg
from .position_corrections import incidence_at_cg as incidence_at_cg
from .position_corrections import true_pressures as true_pressures
from .position_corrections import vane_angles as vane_angles
from .position_corrections import vane_at_cg as vane_at_cg
from .position_corrections import vane_true as vane_true
from .position_corrections import velocity_at as velocity_at
