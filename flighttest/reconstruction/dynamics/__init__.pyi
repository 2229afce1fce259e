"""Public names of `flighttest.reconstruction.dynamics`."""

from .derived_channels import add_derived_channels as add_derived_channels
from .derived_channels import add_derived_channels as complete
from .derived_channels import airspeed_from_pressures as airspeed_from_pressures
from .derived_channels import angular_accelerations as angular_accelerations
from .derived_channels import forces_from_velocity as forces_from_velocity
from .derived_channels import incidence_from_velocity as incidence_from_velocity
from .derived_channels import rates_from_attitude as rates_from_attitude
from .force_coefficients import coefficients as coefficients
from .force_coefficients import select_time as between
from .force_coefficients import select_time as select_time
from .saved_paths import SavedPath as SavedPath
from .saved_paths import open_path as open_path
from .saved_paths import open_states as open_states
