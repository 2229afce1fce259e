"""Public names of `flighttest.multibody` and where they are defined; ``__init__.py`` loads them from this list."""

from .equations_of_motion import energy as energy
from .equations_of_motion import inertial_loads as inertial_loads
from .extraction import air_loads as air_loads
from .figure import draw_wing_models as draw_wing_models
from .motion_fit import TreeMotion as TreeMotion
from .motion_fit import fit_tree_motion as fit_tree_motion
from .recording import read_flight as read_flight
from .vehicle import Vehicle as Vehicle
from .vehicle import read_vehicle as read_vehicle
