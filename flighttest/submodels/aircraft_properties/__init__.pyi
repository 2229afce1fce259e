"""Public names of `flighttest.submodels.aircraft_properties`."""

from .eigenmotion import Eigenmotion as Eigenmotion
from .eigenmotion import Eigenmotion as Motion
from .eigenmotion import fit_motion as fit_motion
from .inertia import Inertia as Inertia
from .inertia import inertia_from_flight as inertia_from_flight
from .thrust_table import fit_thrust as fit_thrust
