"""Public names of `flighttest.special_tests.multibody`."""

from .extraction import air_loads as air_loads
from .extraction import draw_wing_models as draw_wing_models
from .mechanics import energy as energy
from .mechanics import inertial_loads as inertial_loads
from .motion_fit import TreeMotion as TreeMotion
from .motion_fit import fit_tree_motion as fit_tree_motion
from .vehicle import Vehicle as Vehicle
from .vehicle import read_flight as read_flight
from .vehicle import read_vehicle as read_vehicle
